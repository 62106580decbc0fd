// What pictures tell of the IMU: its scales, and where it lies.
#include <gtest/gtest.h>
#include <pi_slam/imu_simulator.h>
#include "odometry/rig_calibrator.h"

#include <cmath>
#include <iostream>

#include "../estimator/simulated_features.h"

namespace
{

using namespace pi_slam;

constexpr int64_t INTERVAL_NS = 200000000;
constexpr double DURATION_S = 150.0;

/// Swings, turns and tilts, as a drone does that is flown by hand.
SplineTrajectory flight()
{
  std::vector<StampedPose> poses;
  for (int i = 0; i <= 20 * static_cast<int>(DURATION_S + 1.0); ++i)
  {
    const double t = 0.05 * i;
    StampedPose pose;
    pose.stamp_ns = 1000000000 + 50000000LL * i;
    pose.T_world_body.translation() =
        Eigen::Vector3d(2.0 * std::sin(0.5 * t), 1.5 * std::sin(0.8 * t), 0.6 * std::sin(1.1 * t));
    pose.T_world_body.linear() = (Eigen::AngleAxisd(0.9 * std::sin(0.7 * t), Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(0.35 * std::sin(1.3 * t), Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(0.4 * std::sin(1.7 * t), Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    poses.push_back(pose);
  }
  return SplineTrajectory::fit(poses);
}

/// Bends on flat ground at 3 m/s, with a stop now and then.
SplineTrajectory drive()
{
  std::vector<StampedPose> poses;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  for (int i = 0; i <= 20 * static_cast<int>(DURATION_S + 1.0); ++i)
  {
    const double t = 0.05 * i;
    const double yaw = 1.5 * std::sin(0.2 * t);
    StampedPose pose;
    pose.stamp_ns = 1000000000 + 50000000LL * i;
    pose.T_world_body.translation() = p;
    pose.T_world_body.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    p += 0.05 * (2.0 + std::cos(0.5 * t)) * Eigen::Vector3d(std::cos(yaw), std::sin(yaw), 0.0);
    poses.push_back(pose);
  }
  return SplineTrajectory::fit(poses);
}

struct RigCalibratorTest : testing::Test
{
  /// Runs along the whole trajectory. @param fault  of the IMU: what turns true samples into those that it says.
  void run(const SplineTrajectory& trajectory, const ImuCorrection& fault)
  {
    const StereoCalibration calibration = StereoCalibration::makeForwardPair(752, 480, 0.11);
    SimulatedFeaturesOptions options;
    options.landmarks = 2000;
    options.max_range = 15.0;
    options.max_features = 160;
    SimulatedFeatures world(trajectory, calibration, options);
    ImuModel model;
    const int64_t end_ns = trajectory.startNs() + std::llround(1e9 * DURATION_S);
    std::vector<ImuSample> samples =
        ImuSimulator(ImuSimulatorOptions()).simulate(trajectory, trajectory.startNs(), end_ns);
    fault.correct(&samples);
    RigCalibrator rig(calibration, model);
    ImuBuffer imu(model);
    auto next = samples.begin();
    for (int64_t stamp_ns = trajectory.startNs() + INTERVAL_NS; stamp_ns + INTERVAL_NS < end_ns;
         stamp_ns += INTERVAL_NS)
    {
      for (; next != samples.end() && next->stamp_ns <= stamp_ns; ++next)
      {
        imu.add(used_(*next, before_ ? &*before_ : nullptr));
        before_ = used_(*next, before_ ? &*before_ : nullptr);
      }
      rig.add(world.at(stamp_ns), imu);
      if (const std::optional<ImuCorrection> due = rig.take())
      {
        imu.correct(*due);
        used_ = due->after(used_);
        ++corrections_;
      }
      imu.forgetBefore(stamp_ns - INTERVAL_NS);
    }
    found_ = rig.report();
    std::cout << "place [mm] " << 1e3 * found_.p_body_imu.transpose() << " +- "
              << 1e3 * found_.p_body_imu_deviation.transpose() << ", taken " << 1e3 * found_.used.p_body_imu.transpose()
              << "\ngyro " << found_.gyro_scale.transpose() << " +- " << found_.gyro_scale_deviation.transpose()
              << ", taken " << found_.used.gyro_scale.transpose() << "\nturn " << found_.turn.transpose() << ", late "
              << found_.late_s << " taken " << found_.used.late_s << ", corrections " << corrections_ << "\n";
  }

  RigReport found_;
  int corrections_ = 0;

private:
  ImuCorrection used_;
  std::optional<ImuSample> before_;
};

TEST_F(RigCalibratorTest, FindsNothingInARightCalibration)
{
  run(flight(), ImuCorrection());
  EXPECT_EQ(corrections_, 0);
  EXPECT_LT(found_.p_body_imu.norm(), 4e-3);
  EXPECT_LT((found_.gyro_scale - Eigen::Vector3d::Ones()).norm(), 3e-3);
}

TEST_F(RigCalibratorTest, FindsNothingOnGround)
{
  run(drive(), ImuCorrection());
  EXPECT_EQ(corrections_, 0);
}

TEST_F(RigCalibratorTest, FindsWhereTheImuLies)
{
  ImuCorrection fault;
  fault.p_body_imu = -Eigen::Vector3d(0.01, -0.012, 0.008);
  run(flight(), fault);
  EXPECT_LT((found_.p_body_imu + fault.p_body_imu).norm(), 4e-3);
  EXPECT_LT((found_.used.p_body_imu + fault.p_body_imu).norm(), 6e-3);
}

TEST_F(RigCalibratorTest, FindsTheScaleOfTheGyroscope)
{
  ImuCorrection fault;  // it divides
  fault.gyro_scale = Eigen::Vector3d(1.0 / 1.015, 1.0, 1.0 / 0.985);
  run(flight(), fault);
  EXPECT_LT((found_.used.gyro_scale.cwiseProduct(fault.gyro_scale) - Eigen::Vector3d::Ones()).norm(), 4e-3);
  EXPECT_TRUE(found_.used.p_body_imu.isZero());
}

/// The scale of the force is not looked for, and must not be taken for something else.
TEST_F(RigCalibratorTest, IsNotMisledByTheScaleOfTheForce)
{
  ImuCorrection fault;
  fault.accel_scale = Eigen::Vector3d(1.0 / 1.005, 1.0 / 0.995, 1.0 / 1.005);
  run(flight(), fault);
  EXPECT_EQ(corrections_, 0);
}

TEST_F(RigCalibratorTest, TakesOverOnGroundOnlyWhatTheMotionTells)
{
  ImuCorrection fault;
  fault.gyro_scale = Eigen::Vector3d::Constant(1.0 / 1.015);
  fault.p_body_imu = -Eigen::Vector3d(0.0, 0.0, 0.01);
  run(drive(), fault);
  EXPECT_NEAR(found_.used.gyro_scale.z(), 1.015, 7e-3);
  EXPECT_EQ(found_.used.gyro_scale.head<2>(), Eigen::Vector2d::Ones());
  EXPECT_EQ(found_.used.p_body_imu.z(), 0.0);
  EXPECT_GT(found_.p_body_imu_deviation.z(), 9e-3);  // as at first
}

}  // namespace
