#include <gtest/gtest.h>
#include <pi_slam/spline_trajectory.h>

#include <cmath>

using namespace pi_slam;

namespace
{

constexpr int64_t SPLINE_START_NS = 1700000000123456789LL;

/// A tumbling flight, all axes in motion.
Eigen::Isometry3d poseAt(double t)
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = Eigen::Vector3d(2.0 * std::sin(0.9 * t), std::cos(0.7 * t), 0.5 * std::sin(1.3 * t) + 0.1 * t);
  pose.linear() = (Eigen::AngleAxisd(1.1 * t, Eigen::Vector3d::UnitZ()) *
                   Eigen::AngleAxisd(0.6 * std::sin(1.7 * t), Eigen::Vector3d::UnitY()) *
                   Eigen::AngleAxisd(0.4 * std::cos(0.8 * t), Eigen::Vector3d::UnitX()))
                      .toRotationMatrix();
  return pose;
}

std::vector<StampedPose> sample(double duration_s, double interval_s)
{
  std::vector<StampedPose> poses;
  for (int i = 0; i * interval_s <= duration_s; ++i)
  {
    poses.push_back({SPLINE_START_NS + std::llround(i * interval_s * 1e9), poseAt(i * interval_s)});
  }
  return poses;
}

Eigen::Vector3d rotationBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b)
{
  return logSo3(Eigen::Quaterniond(Eigen::Matrix3d(a.linear().transpose() * b.linear())));
}

}  // namespace

TEST(SplineTrajectory, FollowsTheSampledMotion)
{
  const SplineTrajectory spline = SplineTrajectory::fit(sample(8.0, 0.02));
  for (double t = 0.0; t < 8.0; t += 0.0173)
  {
    const Eigen::Isometry3d pose = spline.atSeconds(t).T_world_body;
    // The interpolation error of a cubic at 0.08 s knots is h^4 / 384 of the fourth derivative, here below 20 um; the
    // ends, which have samples on one side only, converge to 1 mm.
    const double bound = t < 0.3 || t > 7.7 ? 2e-3 : 1e-4;
    EXPECT_LT((pose.translation() - poseAt(t).translation()).norm(), bound) << t;
    EXPECT_LT(rotationBetween(pose, poseAt(t)).norm(), bound) << t;
  }
}

TEST(SplineTrajectory, DerivativesAreThoseOfThePose)
{
  const SplineTrajectory spline = SplineTrajectory::fit(sample(5.0, 0.02));
  constexpr double H = 1e-5;  // rounding of a second difference: 1e-15 / H^2 = 1e-5
  for (double t = 0.1; t < 4.9; t += 0.0371)
  {
    const auto before = spline.atSeconds(t - H);
    const auto at = spline.atSeconds(t);
    const auto after = spline.atSeconds(t + H);
    const Eigen::Vector3d v = (after.T_world_body.translation() - before.T_world_body.translation()) / (2.0 * H);
    EXPECT_LT((v - at.v_world).norm(), 1e-6) << t;
    EXPECT_LT(((after.v_world - before.v_world) / (2.0 * H) - at.a_world).norm(), 1e-3) << t;
    const Eigen::Vector3d w = rotationBetween(before.T_world_body, after.T_world_body) / (2.0 * H);
    EXPECT_LT((w - at.w_body).norm(), 1e-6) << t;
    EXPECT_LT(((after.w_body - before.w_body) / (2.0 * H) - at.alpha_body).norm(), 1e-3) << t;
  }
}

TEST(SplineTrajectory, IsTwiceContinuouslyDifferentiableAtItsKnots)
{
  const SplineTrajectory spline = SplineTrajectory::fit(sample(3.0, 0.02));
  for (int k = 1; k * spline.knotInterval() < 2.9; ++k)
  {
    const double knot = k * spline.knotInterval();
    const auto before = spline.atSeconds(knot - 1e-9);
    const auto after = spline.atSeconds(knot + 1e-9);
    EXPECT_LT((before.a_world - after.a_world).norm(), 1e-5);
    EXPECT_LT((before.v_world - after.v_world).norm(), 1e-6);
    EXPECT_LT((before.alpha_body - after.alpha_body).norm(), 1e-5);
    EXPECT_LT((before.w_body - after.w_body).norm(), 1e-6);
  }
}

TEST(SplineTrajectory, StandsStillWhereThePosesDo)
{
  std::vector<StampedPose> poses;
  for (int i = 0; i < 100; ++i)
  {
    poses.push_back({SPLINE_START_NS + i * 20000000LL, poseAt(1.0)});
  }
  const auto state = SplineTrajectory::fit(poses).atSeconds(1.0);
  EXPECT_LT(state.v_world.norm(), 1e-9);
  EXPECT_LT(state.a_world.norm(), 1e-9);
  EXPECT_LT(state.w_body.norm(), 1e-9);
}

TEST(SplineTrajectory, TakesIrregularSamplesAndQuaternionsOfEitherSign)
{
  std::vector<StampedPose> poses = sample(6.0, 0.05);
  for (size_t i = 1; i + 1 < poses.size(); ++i)
  {
    const int64_t jitter_ns = static_cast<int64_t>(i * 7919 % 11) * 1000000LL - 5000000LL;
    poses[i].stamp_ns += jitter_ns;
    poses[i].T_world_body = poseAt(1e-9 * static_cast<double>(poses[i].stamp_ns - SPLINE_START_NS));
  }
  const SplineTrajectory spline = SplineTrajectory::fit(poses);
  for (double t = 0.5; t < 5.5; t += 0.031)
  {
    EXPECT_LT((spline.atSeconds(t).T_world_body.translation() - poseAt(t).translation()).norm(), 1e-3) << t;
    EXPECT_LT(rotationBetween(spline.atSeconds(t).T_world_body, poseAt(t)).norm(), 1e-3) << t;
  }
}

TEST(SplineTrajectory, RefusesBadInputByName)
{
  EXPECT_THROW(SplineTrajectory::fit({}), std::invalid_argument);
  std::vector<StampedPose> poses = sample(1.0, 0.1);
  EXPECT_THROW(SplineTrajectory::fit(poses, 1e-6), std::invalid_argument);
  std::swap(poses[2], poses[3]);
  EXPECT_THROW(SplineTrajectory::fit(poses), std::invalid_argument);
  const SplineTrajectory spline = SplineTrajectory::fit(sample(1.0, 0.1));
  EXPECT_THROW(spline.at(spline.startNs() - 1), std::out_of_range);
  EXPECT_THROW(spline.at(spline.endNs() + 1), std::out_of_range);
  EXPECT_NO_THROW(spline.at(spline.endNs()));
}
