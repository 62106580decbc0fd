#include "vehicle/motion_window.h"

#include "vehicle/road_surface.h"

#include <gtest/gtest.h>

#include <cmath>

namespace pi_simulation
{
namespace
{

constexpr double GRAVITY = 9.81;

Eigen::Isometry3d mount(double x, double z)
{
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << x, 0.0, z;
  return T;
}

/// The window around time_s of a motion that says the pose at a time.
template <typename PoseAt>
MotionWindow windowAround(double time_s, const PoseAt& poseAt)
{
  MotionWindow window;
  const auto middle = static_cast<int64_t>(std::llround(1e9 * time_s));
  for (int k = -MotionWindow::REACH; k <= MotionWindow::REACH; ++k)
  {
    const int64_t stamp_ns = middle + k * MotionWindow::PERIOD_NS;
    window.add(stamp_ns, poseAt(1e-9 * static_cast<double>(stamp_ns)));
  }
  return window;
}

TEST(MotionWindow, IsReadyOnlyWithANeighbourhood)
{
  MotionWindow window;
  for (int i = 0; i < 2 * MotionWindow::REACH; ++i)
  {
    window.add(i * MotionWindow::PERIOD_NS, Eigen::Isometry3d::Identity());
    EXPECT_FALSE(window.ready());
  }
  window.add(2 * MotionWindow::REACH * MotionWindow::PERIOD_NS, Eigen::Isometry3d::Identity());
  EXPECT_TRUE(window.ready());
  EXPECT_EQ(MotionWindow::REACH * MotionWindow::PERIOD_NS, window.stampNs());
  window.add(1'000'000'000, Eigen::Isometry3d::Identity());  // a gap
  EXPECT_FALSE(window.ready());
}

TEST(MotionWindow, ImuOfAStraightMotionFeelsItsAcceleration)
{
  const MotionWindow window = windowAround(2.0,
                                           [](double t)
                                           {
                                             Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
                                             pose.translation().x() = 0.5 * 0.8 * t * t;
                                             return pose;
                                           });
  const pi_slam::ImuSample sample = window.imu(mount(0.8, 1.0), GRAVITY);
  EXPECT_NEAR(0.0, (sample.f - Eigen::Vector3d(0.8, 0.0, GRAVITY)).norm(), 1e-6);
  EXPECT_NEAR(0.0, sample.w.norm(), 1e-9);
  EXPECT_NEAR(0.0, (window.velocity() - Eigen::Vector3d(1.6, 0.0, 0.0)).norm(), 1e-9);
}

TEST(MotionWindow, ImuOfACurveFeelsTheCentripetalForceAtItsPlace)
{
  constexpr double SPEED = 2.0;
  constexpr double CURVATURE = 0.25;
  constexpr double RATE = SPEED * CURVATURE;
  const MotionWindow window =
      windowAround(3.0,
                   [](double t)
                   {
                     Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
                     const double heading = RATE * t;
                     pose.linear() = Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
                     pose.translation() << std::sin(heading) / CURVATURE, (1.0 - std::cos(heading)) / CURVATURE, 0.0;
                     return pose;
                   });
  // At x ahead of the axle: -w^2 x along x, v w along y.
  const pi_slam::ImuSample sample = window.imu(mount(0.8, 1.0), GRAVITY);
  EXPECT_NEAR(-RATE * RATE * 0.8, sample.f.x(), 1e-4);
  EXPECT_NEAR(SPEED * RATE, sample.f.y(), 1e-4);
  EXPECT_NEAR(GRAVITY, sample.f.z(), 1e-6);
  EXPECT_NEAR(0.0, (sample.w - Eigen::Vector3d(0.0, 0.0, RATE)).norm(), 1e-9);
  EXPECT_NEAR(0.0, (window.velocity() - Eigen::Vector3d(SPEED, 0.0, 0.0)).norm(), 1e-4);
}

TEST(MotionWindow, IntegratedSamplesGiveTheTrueMotionBackOverABumpyRoad)
{
  const RoadSurface surface(1.0, 3);
  const auto poseAt = [&surface](double t)
  {
    const double heading = 0.4 * std::sin(0.5 * t);
    return surface.T_world_base(2.0 * t, 1.5 * std::sin(0.4 * t), heading);
  };
  const Eigen::Isometry3d T_base_imu = mount(0.8, 1.0);
  constexpr double PERIOD_S = 0.005;
  MotionWindow first = windowAround(0.0, poseAt);
  Eigen::Matrix3d R = first.pose().linear();
  Eigen::Vector3d p = first.pose() * T_base_imu.translation();
  Eigen::Vector3d v = first.pose().linear() * (first.velocity() + first.angularRate().cross(T_base_imu.translation()));
  pi_slam::ImuSample before = first.imu(T_base_imu, GRAVITY);
  double end = 0.0;
  for (int i = 1; i <= 2000; ++i)  // 10 s
  {
    end = i * PERIOD_S;
    const pi_slam::ImuSample now = windowAround(end, poseAt).imu(T_base_imu, GRAVITY);
    const Eigen::Vector3d w = 0.5 * (before.w + now.w);
    const Eigen::Matrix3d next =
        R * Eigen::AngleAxisd(w.norm() * PERIOD_S, w.norm() > 1e-12 ? w.normalized() : Eigen::Vector3d::UnitX())
                .toRotationMatrix();
    const Eigen::Vector3d a = 0.5 * (R * before.f + next * now.f) - Eigen::Vector3d(0.0, 0.0, GRAVITY);
    p += v * PERIOD_S + 0.5 * a * PERIOD_S * PERIOD_S;
    v += a * PERIOD_S;
    R = next;
    before = now;
  }
  const Eigen::Isometry3d truth = poseAt(end);
  EXPECT_LT((p - truth * T_base_imu.translation()).norm(), 0.05);
  EXPECT_LT(Eigen::AngleAxisd(Eigen::Matrix3d(R.transpose() * truth.linear())).angle(), 1e-3);
}

TEST(RoadSurface, IsSmoothAndOfTheStatedSize)
{
  const RoadSurface surface(1.0, 3);
  double highest = 0.0;
  for (double x = 0.0; x < 50.0; x += 0.01)
  {
    const Eigen::Isometry3d pose = surface.T_world_base(x, 2.0, 0.0);
    const Eigen::Isometry3d next = surface.T_world_base(x + 0.01, 2.0, 0.0);
    highest = std::max(highest, std::abs(pose.translation().z()));
    EXPECT_LT(std::abs(next.translation().z() - pose.translation().z()), 0.0005);
  }
  EXPECT_GT(highest, 0.004);
  EXPECT_LE(highest, 0.015);
  EXPECT_EQ(0.0, RoadSurface(0.0, 3).T_world_base(7.0, 8.0, 1.0).translation().z());
}

}  // namespace
}  // namespace pi_simulation
