#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include "evaluation/trajectory_metrics.h"

#include <cmath>
#include <limits>
#include <random>

namespace
{

using namespace pi_slam;
using pi_node::test_support::messageOf;

constexpr int64_t SECOND = 1000000000;
constexpr double NOT_A_NUMBER = std::numeric_limits<double>::quiet_NaN();

Eigen::Isometry3d poseOf(const Eigen::Vector3d& p, const Eigen::Vector3d& rotation_vector = Eigen::Vector3d::Zero())
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = p;
  const double angle = rotation_vector.norm();
  if (angle > 0.0)
  {
    pose.linear() = Eigen::AngleAxisd(angle, rotation_vector / angle).toRotationMatrix();
  }
  return pose;
}

/// A curve through space with turns about all axes, 100 poses a second.
std::vector<StampedPose> makeCurve(size_t count)
{
  std::vector<StampedPose> poses;
  for (size_t i = 0; i < count; ++i)
  {
    const double t = 0.01 * static_cast<double>(i);
    poses.push_back({1000 * SECOND + static_cast<int64_t>(i) * SECOND / 100,
                     poseOf({2.0 * std::cos(t), 3.0 * std::sin(t), 0.5 * std::sin(2.0 * t)},
                            {0.3 * std::sin(t), 0.2 * std::cos(t), t})});
  }
  return poses;
}

std::vector<StampedPose> makeLine(size_t count, double step_m)
{
  std::vector<StampedPose> poses;
  for (size_t i = 0; i < count; ++i)
  {
    poses.push_back({SECOND + static_cast<int64_t>(i) * SECOND / 10, poseOf({step_m * static_cast<double>(i), 0, 0})});
  }
  return poses;
}

double angleBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b)
{
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

TEST(Associate, PairsEveryPoseWithTheTruthOfItsTime)
{
  const std::vector<StampedPose> truth = makeCurve(50);
  const std::vector<PosePair> pairs = associate({truth[3], truth[20], truth[49]}, truth);
  ASSERT_EQ(pairs.size(), 3u);
  EXPECT_EQ(pairs[1].stamp_ns, truth[20].stamp_ns);
  EXPECT_TRUE(pairs[2].T_truth_body.isApprox(truth[49].T_world_body, 1e-12));
}

TEST(Associate, InterpolatesBetweenTruePoses)
{
  const std::vector<StampedPose> truth = {{10 * SECOND, poseOf({1, 2, 3}, {0, 0, 0.2})},
                                          {10 * SECOND + 80000000, poseOf({2, 4, 7}, {0, 0, 0.6})}};
  const std::vector<PosePair> pairs = associate({{10 * SECOND + 20000000, poseOf({0, 0, 0})}}, truth);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_TRUE(pairs[0].T_truth_body.isApprox(poseOf({1.25, 2.5, 4.0}, {0, 0, 0.3}), 1e-12));
}

TEST(Associate, LeavesOutWhatLiesOutsideOfTheTruthOrInAHoleOfIt)
{
  std::vector<StampedPose> truth = makeCurve(100);
  truth.erase(truth.begin() + 40, truth.begin() + 60);  // 0.2 s
  std::vector<StampedPose> estimate = makeCurve(120);
  estimate.front().stamp_ns -= SECOND;
  for (StampedPose& pose : estimate)
  {
    pose.stamp_ns += 1000;
  }
  const std::vector<PosePair> pairs = associate(estimate, truth, 0.1);
  // Pose 0 and those from 99 on are outside, 39 to 59 in the hole.
  EXPECT_EQ(pairs.size(), 120u - 1u - 21u - 21u);
  for (const PosePair& pair : pairs)
  {
    EXPECT_FALSE(pair.stamp_ns > estimate[38].stamp_ns && pair.stamp_ns < estimate[60].stamp_ns);
  }
}

TEST(Associate, RefusesTrajectoriesThatAreEmptyOrBroken)
{
  const std::vector<StampedPose> good = makeCurve(10);
  const auto message = [](const std::vector<StampedPose>& estimate, const std::vector<StampedPose>& truth, double gap_s)
  { return messageOf<TrajectoryError>([&] { associate(estimate, truth, gap_s); }); };
  EXPECT_NE(message({}, good, 0.1).find("estimate: has no poses"), std::string::npos);
  EXPECT_NE(message(good, {}, 0.1).find("ground truth: has no poses"), std::string::npos);
  EXPECT_NE(message(good, good, NOT_A_NUMBER).find("must be above 0"), std::string::npos);
  std::vector<StampedPose> broken = good;
  broken[4].T_world_body.translation().y() = NOT_A_NUMBER;
  EXPECT_NE(message(broken, good, 0.1).find("pose 4 at 1000.040000000 s is not finite"), std::string::npos);
  broken = good;
  broken[7].stamp_ns = broken[6].stamp_ns;
  EXPECT_NE(message(good, broken, 0.1).find("pose 7 is not after the one before"), std::string::npos);
}

TEST(Align, FindsAnyTransformBetweenTwoWorlds)
{
  const Eigen::Isometry3d T_truth_estimate = poseOf({5, -7, 2}, {0.8, -1.1, 2.0});
  const std::vector<StampedPose> truth = makeCurve(300);
  const std::vector<PosePair> pairs = associate(transformed(truth, T_truth_estimate.inverse()), truth);
  const AbsoluteError error = absoluteError(pairs, Alignment::SE3);
  EXPECT_TRUE(error.T_truth_estimate.isApprox(T_truth_estimate, 1e-9));
  EXPECT_LT(error.position.max, 1e-9);
  EXPECT_LT(error.rotation.max, 1e-7);  // angles below are lost in a rotation matrix of doubles
}

TEST(Align, ByYawLeavesATiltAsAnError)
{
  const double tilt = 0.1;
  const Eigen::Isometry3d T_truth_estimate = poseOf({1, 2, 3}, {0, 0, 2.5});
  const std::vector<StampedPose> truth = makeCurve(629);
  const Eigen::Isometry3d tilted = poseOf({0, 0, 0}, {tilt, 0, 0}) * T_truth_estimate.inverse();
  const std::vector<PosePair> pairs = associate(transformed(truth, tilted), truth);

  const AbsoluteError by_yaw = absoluteError(pairs, Alignment::YAW);
  const Eigen::Matrix3d R = by_yaw.T_truth_estimate.linear();
  EXPECT_NEAR(R(2, 2), 1.0, 1e-12);
  EXPECT_NEAR(by_yaw.rotation.mean, tilt, 0.02 * tilt);  // the best heading gives a little of it up for positions
  EXPECT_GT(by_yaw.position.rmse, 0.1);
  EXPECT_LT(absoluteError(pairs, Alignment::SE3).position.rmse, 1e-9);
  // Without a tilt it finds heading and position exactly.
  const std::vector<PosePair> level = associate(transformed(truth, T_truth_estimate.inverse()), truth);
  EXPECT_TRUE(align(level, Alignment::YAW).isApprox(T_truth_estimate, 1e-9));
}

TEST(Align, DoesNotMirrorAFlatPath)
{
  // Positions in a plane fit their mirror image as well: the result must be a rotation.
  std::vector<StampedPose> truth = makeCurve(300);
  for (StampedPose& pose : truth)
  {
    pose.T_world_body.translation().z() = 0.0;
  }
  const Eigen::Isometry3d turned = poseOf({0, 0, 0}, {M_PI, 0, 0});
  const Eigen::Isometry3d T = align(associate(transformed(truth, turned), truth), Alignment::SE3);
  EXPECT_NEAR(T.linear().determinant(), 1.0, 1e-9);
  EXPECT_TRUE(T.isApprox(turned.inverse(), 1e-9));
}

TEST(Align, SettlesTheTurnAboutAStraightDriveByOrientations)
{
  const std::vector<StampedPose> truth = makeLine(100, 0.1);
  const Eigen::Isometry3d T_truth_estimate = poseOf({0, 1, 0}, {2.0, 0.3, -0.4});
  const std::vector<PosePair> pairs = associate(transformed(truth, T_truth_estimate.inverse()), truth);
  EXPECT_TRUE(align(pairs, Alignment::SE3).isApprox(T_truth_estimate, 1e-9));
}

TEST(Align, SettlesStandstillByOrientations)
{
  const std::vector<StampedPose> truth = makeLine(100, 0.0);
  for (const Alignment alignment : {Alignment::SE3, Alignment::YAW})
  {
    const Eigen::Isometry3d T_truth_estimate = poseOf({0, 1, 0}, {0.0, 0.0, -0.4});
    const AbsoluteError error =
        absoluteError(associate(transformed(truth, T_truth_estimate.inverse()), truth), alignment);
    EXPECT_TRUE(error.T_truth_estimate.isApprox(T_truth_estimate, 1e-9)) << static_cast<int>(alignment);
    EXPECT_EQ(error.driftPercent(), 0.0);
  }
}

TEST(Align, RefusesTooFewAndNotFinitePairs)
{
  const std::vector<StampedPose> truth = makeCurve(10);
  std::vector<PosePair> pairs = associate({truth[0], truth[5]}, truth);
  EXPECT_NE(messageOf<TrajectoryError>([&] { align(pairs, Alignment::SE3); }).find("2 poses"), std::string::npos);
  EXPECT_THROW(absoluteError({}, Alignment::YAW), TrajectoryError);
  pairs = associate(truth, truth);
  pairs[3].T_estimate_body.translation().x() = NOT_A_NUMBER;
  EXPECT_NE(messageOf<TrajectoryError>([&] { align(pairs, Alignment::SE3); }).find("1000.030000000"),
            std::string::npos);
}

TEST(Statistics, OfKnownValues)
{
  const ErrorStatistics odd = statisticsOf({3.0, 1.0, 2.0});
  EXPECT_EQ(odd.count, 3u);
  EXPECT_DOUBLE_EQ(odd.mean, 2.0);
  EXPECT_DOUBLE_EQ(odd.median, 2.0);
  EXPECT_DOUBLE_EQ(odd.max, 3.0);
  EXPECT_DOUBLE_EQ(odd.rmse, std::sqrt(14.0 / 3.0));
  EXPECT_DOUBLE_EQ(statisticsOf({8.0, 1.0, 3.0, 4.0}).median, 3.5);
  EXPECT_THROW(statisticsOf({}), TrajectoryError);
  EXPECT_THROW(statisticsOf({1.0, NOT_A_NUMBER}), TrajectoryError);
}

TEST(AbsoluteError, OfAnOscillationAcrossAStraightPath)
{
  // +-5 mm in turns: alignment cannot take away anything of it but the odd one out.
  const std::vector<StampedPose> truth = makeLine(1000, 0.02);
  std::vector<StampedPose> estimate = truth;
  for (size_t i = 0; i < estimate.size(); ++i)
  {
    estimate[i].T_world_body.translation().z() += i % 2 == 0 ? 0.005 : -0.005;
  }
  const AbsoluteError error = absoluteError(associate(estimate, truth), Alignment::SE3);
  EXPECT_NEAR(error.position.rmse, 0.005, 1e-6);
  EXPECT_NEAR(error.position.median, 0.005, 1e-5);
  EXPECT_NEAR(error.length_m, 19.98, 1e-9);
  EXPECT_NEAR(error.driftPercent(), 100.0 * 0.005 / 19.98, 1e-4);
  EXPECT_EQ(error.position_errors.size(), truth.size());
}

TEST(AbsoluteError, OfNoiseIsItsStandardDeviation)
{
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0.0, 0.01);
  const std::vector<StampedPose> truth = makeCurve(3000);
  std::vector<StampedPose> estimate = truth;
  for (StampedPose& pose : estimate)
  {
    pose.T_world_body.translation() += Eigen::Vector3d{noise(random), noise(random), noise(random)};
  }
  const AbsoluteError error = absoluteError(associate(estimate, truth), Alignment::SE3);
  // sqrt(3) sigma; of 9000 values known to 1 / sqrt(18000), three times that.
  EXPECT_NEAR(error.position.rmse, std::sqrt(3.0) * 0.01, 0.0225 * std::sqrt(3.0) * 0.01);
}

TEST(RelativeError, OfAScaleIsThatPartOfTheDistance)
{
  const std::vector<StampedPose> truth = makeLine(501, 0.1);
  std::vector<StampedPose> estimate = truth;
  for (StampedPose& pose : estimate)
  {
    pose.T_world_body.translation() *= 1.02;
  }
  const std::vector<PosePair> pairs = associate(estimate, truth);
  for (const double distance_m : {1.05, 5.05, 10.05})
  {
    // Ends are at the next pose: 0.05 m beyond.
    const std::optional<RelativeError> error = relativeErrorOverDistance(pairs, distance_m);
    ASSERT_TRUE(error);
    EXPECT_NEAR(error->drift_percent, 2.0, 1e-9) << distance_m;
    EXPECT_NEAR(error->position.rmse, 0.02 * (distance_m + 0.05), 1e-9);
    EXPECT_NEAR(error->position.max, error->position.median, 1e-9);
    EXPECT_LT(error->rotation.max, 1e-9);
    EXPECT_EQ(error->position.count, 501u - static_cast<size_t>(std::lround((distance_m + 0.05) * 10.0)));
  }
  EXPECT_FALSE(relativeErrorOverDistance(pairs, 60.0));
}

TEST(RelativeError, OfATurningRateIsItsAngle)
{
  std::vector<StampedPose> truth = makeLine(101, 0.1);
  std::vector<StampedPose> estimate = truth;
  for (size_t i = 0; i < estimate.size(); ++i)
  {
    estimate[i].T_world_body = truth[i].T_world_body * poseOf({0, 0, 0}, {0, 0, 0.002 * static_cast<double>(i)});
  }
  const std::optional<RelativeError> error = relativeErrorOverTime(associate(estimate, truth), 1.0);
  ASSERT_TRUE(error);
  EXPECT_NEAR(error->rotation.mean, 0.02, 1e-9);  // ten poses a second
  EXPECT_EQ(error->drift_percent, 0.0);
}

TEST(RelativeError, DoesNotDependOnTheWorldsFrame)
{
  const std::vector<StampedPose> truth = makeCurve(500);
  const std::vector<PosePair> pairs = associate(transformed(truth, poseOf({4, 4, 4}, {1, 1, 1})), truth);
  EXPECT_LT(relativeErrorOverTime(pairs, 1.0)->position.max, 1e-9);
  EXPECT_LT(relativeErrorOverDistance(pairs, 2.0)->position.max, 1e-9);
}

TEST(RelativeError, LeavesOutStretchesWithPosesMissing)
{
  const std::vector<StampedPose> truth = makeLine(200, 0.1);
  std::vector<StampedPose> estimate = truth;
  estimate.erase(estimate.begin() + 100, estimate.begin() + 120);  // 2 m and 2 s
  const std::vector<PosePair> pairs = associate(estimate, truth);
  // Stretches of 1 m from 90 to 99 would end in the hole: those have no end within a tenth.
  EXPECT_EQ(relativeErrorOverDistance(pairs, 0.999)->position.count, 180u - 10u - 10u);
  EXPECT_EQ(relativeErrorOverTime(pairs, 1.0)->position.count, 180u - 10u - 10u);
}

TEST(RelativeError, RefusesStretchesWithoutLength)
{
  const std::vector<PosePair> pairs = associate(makeCurve(10), makeCurve(10));
  EXPECT_THROW(relativeErrorOverDistance(pairs, 0.0), TrajectoryError);
  EXPECT_THROW(relativeErrorOverTime(pairs, -1.0), TrajectoryError);
  EXPECT_THROW(relativeErrorOverTime(pairs, NOT_A_NUMBER), TrajectoryError);
  EXPECT_FALSE(relativeErrorOverTime({}, 1.0));
  EXPECT_EQ(pathLength({}), 0.0);
}

TEST(Transformed, MovesPosesIntoTheOtherWorld)
{
  const Eigen::Isometry3d T = poseOf({1, 0, 0}, {0, 0, M_PI / 2.0});
  const std::vector<StampedPose> moved = transformed(makeLine(2, 3.0), T);
  EXPECT_TRUE(moved[1].T_world_body.translation().isApprox(Eigen::Vector3d(1, 3, 0), 1e-12));
  EXPECT_NEAR(angleBetween(moved[1].T_world_body, T), 0.0, 1e-9);
}

}  // namespace
