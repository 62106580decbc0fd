#include "decision/pose_keeper.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_vehicle
{
namespace
{

constexpr double STEP_S = 0.005;
constexpr int64_t STEP_NS = 5000000;

Eigen::Isometry3d lifted(const Pose2& pose, double z = 0.0)
{
  return Eigen::Translation3d(pose.x, pose.y, z) * Eigen::AngleAxisd(pose.heading, Eigen::Vector3d::UnitZ());
}

/// A vehicle with odometry, wheels and keeper, in steps of 5 ms.
class Drive : public ::testing::Test
{
protected:
  explicit Drive(const PoseKeeperOptions& options = PoseKeeperOptions()) : keeper_(options) {}

  /// Odometry begins at the origin of odom where the vehicle is, and knows nothing of the map.
  void startOdometry(bool counted = true)
  {
    alive_ = true;
    counted_ = counted;
    ++connection_;
    count_ = 0;
    begin_ = truth_;
    map_odom_ = Eigen::Isometry3d::Identity();
  }
  /// It is where it says in the map.
  void drive(double duration_s, double speed, double curvature = 0.0)
  {
    for (int i = 0; i < static_cast<int>(std::lround(duration_s / STEP_S)); ++i)
    {
      step(speed, curvature);
    }
  }
  void step(double speed, double curvature)
  {
    now_ns_ += STEP_NS;
    ++steps_;
    truth_ = truth_.moved(speed * STEP_S, curvature);
    wheels_ = wheels_.moved(wheel_scale_ * (speed + slip_) * STEP_S, curvature);
    if (steps_ % 4 == 0 && wheels_alive_)
    {
      keeper_.addWheels(now_ns_, wheels_, wheel_scale_ * (speed + slip_), speed * curvature);
    }
    if (alive_)
    {
      OdometryPose odometry;
      odometry.stamp_ns = now_ns_ - 2 * STEP_NS;  // it comes late
      const Pose2 then = truth_.moved(-2.0 * speed * STEP_S, curvature);
      odometry.T_odom_base = lifted(begin_.inverse() * then, 0.1);
      odometry.speed = speed;
      odometry.connection = connection_;
      odometry.count = counted_ ? count_++ : 0;
      if (count_ % 4 == 0)
      {
        keeper_.addMapTransform(odometry.stamp_ns, map_odom_);
      }
      problems_ += keeper_.addOdometry(odometry, now_ns_);
    }
    if (steps_ % 4 == 0)
    {
      if (const auto pose = keeper_.update(now_ns_))
      {
        told_.push_back(*pose);
        if (alive_ && listens_)
        {
          // As the localisation does: by odometry at the stamp.
          const double age_s = 1e-9 * static_cast<double>(now_ns_ - pose->stamp_ns);
          const Pose2 then = truth_.moved(-speed * age_s, curvature);
          map_odom_ = pose->T_map_base * lifted(begin_.inverse() * then, 0.1).inverse();
        }
      }
    }
  }
  Eigen::Isometry3d localised() const { return map_odom_ * lifted(begin_.inverse() * truth_); }
  void expectLocalised(double tolerance_m, double tolerance_rad)
  {
    const Eigen::Isometry3d error = lifted(truth_).inverse() * localised();
    EXPECT_TRUE(keeper_.valid()) << keeper_.reason();
    EXPECT_LT(error.translation().head<2>().norm(), tolerance_m);
    EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), tolerance_rad);
  }

  PoseKeeper keeper_;
  int64_t now_ns_ = 1700000000000000000;
  int steps_ = 0;
  Pose2 truth_;  // in map, where the first odometry begins at the origin
  Pose2 wheels_{40.0, 20.0, 2.5};
  Pose2 begin_;
  Eigen::Isometry3d map_odom_ = Eigen::Isometry3d::Identity();
  bool alive_ = false;
  bool counted_ = true;
  bool listens_ = true;
  bool wheels_alive_ = true;
  double wheel_scale_ = 1.0;
  double slip_ = 0.0;
  uint64_t connection_ = 0;
  uint32_t count_ = 0;
  std::vector<KeptPose> told_;
  std::string problems_;
};

TEST(PoseKeeperOptions, NamesFieldValueAndBound)
{
  PoseKeeperOptions options;
  options.validate();
  options.silence_s = 0.0;
  EXPECT_THROW(PoseKeeper{options}, std::invalid_argument);
  options = PoseKeeperOptions();
  options.heading_error = std::nan("");
  try
  {
    options.validate();
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_EQ("heading_error = nan, must be in [0, 1]", std::string(error.what()));
  }
}

TEST_F(Drive, IsValidAsLongAsOdometryLives)
{
  drive(0.5, 0.0);
  EXPECT_EQ(KeeperState::WAITING, keeper_.state());
  EXPECT_FALSE(keeper_.pose());
  EXPECT_FALSE(keeper_.toSave());
  startOdometry();
  drive(20.0, 3.0, 0.1);
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(keeper_.wheelsTrusted());
  EXPECT_TRUE(told_.empty());
  EXPECT_EQ("", problems_);
  EXPECT_NEAR(truth_.x, keeper_.pose()->T_map_base.translation().x(), 0.05);
  EXPECT_NEAR(3.0, keeper_.toSave()->speed, 1e-9);
}

TEST_F(Drive, TellsOdometryThatBeganAnewAtStandstill)
{
  startOdometry();
  drive(5.0, 2.0, 0.2);
  drive(1.0, 0.0);
  alive_ = false;
  drive(1.5, 0.0);
  EXPECT_EQ(KeeperState::SILENT, keeper_.state());
  EXPECT_FALSE(keeper_.valid());
  startOdometry();
  step(0.0, 0.0);
  EXPECT_FALSE(keeper_.valid());  // never in between
  drive(0.2, 0.0);
  EXPECT_EQ(1u, told_.size());
  expectLocalised(1e-6, 1e-6);
  EXPECT_NEAR(0.05, told_[0].position_deviation, 1e-6);
  EXPECT_EQ(1u, keeper_.restarts());
  drive(5.0, 2.0);
  EXPECT_EQ(1u, told_.size());
}

TEST_F(Drive, TellsOdometryThatBeganAnewInMotionAgainAndAgain)
{
  startOdometry();
  drive(10.0, 3.0, 0.05);
  for (int i = 0; i < 5; ++i)
  {
    alive_ = false;
    drive(0.3, 3.0, 0.05);
    drive(1.2, 1.0, -0.3);
    startOdometry();
    for (int k = 0; k < 40 && !keeper_.valid(); ++k)
    {
      step(1.0, -0.3);
    }
    expectLocalised(0.02, 0.01);
    drive(5.0, 2.5, 0.1);
    expectLocalised(0.02, 0.01);
  }
  EXPECT_EQ(5u, told_.size());
  EXPECT_GT(told_[0].position_deviation, 0.06);
  EXPECT_LT(told_[0].position_deviation, 0.3);
}

TEST_F(Drive, AsksUntilOdometryListens)
{
  startOdometry();
  drive(5.0, 2.0);
  alive_ = false;
  drive(1.0, 0.0);
  listens_ = false;
  startOdometry();
  drive(4.0, 0.0);
  EXPECT_FALSE(keeper_.valid());
  EXPECT_NEAR(13.0, static_cast<double>(told_.size()), 2.0);
  EXPECT_NE(std::string::npos, keeper_.reason().find("initialpose"));
  listens_ = true;
  drive(1.0, 0.5);
  expectLocalised(1e-3, 1e-3);
}

TEST_F(Drive, LeavesOdometryAloneThatOnlyBridgedAGap)
{
  startOdometry();
  drive(5.0, 2.5, 0.1);
  for (const double gap_s : {0.15, 0.3, 2.0})
  {
    alive_ = false;
    drive(gap_s, 2.5, 0.1);
    alive_ = true;
    drive(1.0, 2.5, 0.1);
    EXPECT_TRUE(keeper_.valid()) << keeper_.reason();
  }
  ++connection_;  // the network came back: the count goes on
  drive(1.0, 2.5);
  alive_ = false;
  drive(1.0, 2.5);
  ++connection_;
  count_ += 200;
  alive_ = true;
  drive(1.0, 2.5);
  EXPECT_TRUE(keeper_.valid()) << keeper_.reason();
  EXPECT_TRUE(told_.empty());
  EXPECT_EQ(0u, keeper_.restarts());
}

TEST_F(Drive, TakesTheJumpsOfALoopClosure)
{
  startOdometry();
  drive(5.0, 2.0);
  map_odom_ = lifted({3.0, -2.0, 0.4}) * map_odom_;
  drive(1.0, 2.0);
  EXPECT_TRUE(keeper_.valid());
  alive_ = false;
  drive(0.5, 2.0);
  map_odom_ = lifted({-1.0, -2.0, 0.2}) * map_odom_;  // found before it was silent
  alive_ = true;
  drive(1.0, 2.0);
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(told_.empty());
  const Eigen::Isometry3d error = keeper_.pose()->T_map_base.inverse() * localised();
  EXPECT_LT(error.translation().head<2>().norm(), 0.05);
}

TEST_F(Drive, FindsAnotherLifeWhereMessagesAreNotCounted)
{
  startOdometry(false);
  drive(5.0, 2.0);
  drive(1.0, 0.0);
  alive_ = false;
  drive(1.0, 0.0);
  startOdometry(false);
  drive(0.5, 0.0);
  EXPECT_EQ(1u, told_.size());
  expectLocalised(1e-3, 1e-3);
  // Again before it moved: odometry is where it was, its place in map is not.
  alive_ = false;
  drive(1.0, 0.0);
  startOdometry(false);
  drive(0.5, 0.0);
  EXPECT_EQ(2u, told_.size());
  expectLocalised(1e-3, 1e-3);
  // Odometry that began anew in the same process.
  drive(2.0, 2.0);
  alive_ = false;
  drive(0.5, 0.0);
  startOdometry(false);
  --connection_;
  drive(0.5, 0.0);
  EXPECT_EQ(3u, told_.size());
  expectLocalised(1e-3, 1e-3);
}

TEST_F(Drive, BelievesOdometryThatKnowsTheMapItself)
{
  startOdometry();
  drive(5.0, 2.0, 0.1);
  alive_ = false;
  drive(1.0, 1.0, 0.1);
  startOdometry();
  map_odom_ = lifted({0.1, -0.1, 0.01}) * lifted(begin_);  // recognised in its first picture
  drive(1.0, 1.0, 0.1);
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(told_.empty());
}

TEST_F(Drive, DoesNotTakeWrongWheelsForANewLife)
{
  startOdometry();
  wheel_scale_ = 0.3;
  drive(5.0, 2.0);
  EXPECT_FALSE(keeper_.wheelsTrusted());
  EXPECT_NEAR(0.7, keeper_.wheelDisagreement(), 0.05);
  alive_ = false;
  drive(1.0, 2.0);
  alive_ = true;
  drive(1.0, 2.0);
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(told_.empty());
  wheel_scale_ = 1.0;
  drive(3.0, 2.0);
  EXPECT_TRUE(keeper_.wheelsTrusted());
  // On ice: they turn, and the vehicle stands.
  slip_ = 2.0;
  drive(3.0, 0.0);
  EXPECT_FALSE(keeper_.wheelsTrusted());
  alive_ = false;
  drive(1.0, 0.0);
  alive_ = true;
  drive(1.0, 0.0);
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(told_.empty());
}

TEST_F(Drive, SaysThatItIsLostRatherThanTellingAGuess)
{
  startOdometry();
  wheel_scale_ = 0.5;
  drive(5.0, 3.0);
  alive_ = false;
  drive(2.0, 3.0);  // 3 m by wheels that are known to be wrong
  startOdometry();
  drive(1.0, 0.0);
  EXPECT_EQ(KeeperState::LOST, keeper_.state());
  EXPECT_TRUE(told_.empty());
  EXPECT_NE(std::string::npos, keeper_.reason().find("2D Pose Estimate")) << keeper_.reason();
  EXPECT_FALSE(keeper_.pose());
  EXPECT_FALSE(keeper_.toSave());
  map_odom_ = lifted(begin_);  // somebody did
  drive(0.1, 0.0);
  expectLocalised(1e-6, 1e-6);
}

TEST_F(Drive, KnowsWithoutWheelsWhereItStood)
{
  wheels_alive_ = false;
  startOdometry();
  drive(5.0, 2.0);
  drive(1.0, 0.0);
  alive_ = false;
  drive(2.0, 0.0);
  startOdometry();
  drive(0.5, 0.0);
  EXPECT_EQ(1u, told_.size());
  expectLocalised(1e-6, 1e-6);
  drive(2.0, 3.0);
  alive_ = false;
  drive(0.3, 3.0);
  startOdometry();
  drive(0.5, 0.0);
  EXPECT_EQ(1u, told_.size()) << keeper_.reason();
  drive(3.0, 3.0);
  alive_ = false;
  drive(1.5, 0.0);
  startOdometry();
  drive(0.5, 0.0);
  EXPECT_EQ(KeeperState::LOST, keeper_.state());
}

TEST_F(Drive, GoesOnOverAChassisThatBeginsAnewToo)
{
  startOdometry();
  drive(5.0, 2.0, 0.1);
  alive_ = false;
  drive(0.5, 1.0, 0.1);
  wheels_ = Pose2();
  drive(0.5, 1.0, 0.1);
  startOdometry();
  drive(0.5, 0.0);
  EXPECT_EQ(1u, told_.size());
  expectLocalised(0.05, 0.02);
}

TEST_F(Drive, TakesWhatOdometrySaysAfterItsOwnRestartAndInAnotherTime)
{
  startOdometry();
  map_odom_ = lifted({7.0, 8.0, 1.0});
  drive(1.0, 2.0);  // the keeper comes in the middle
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(told_.empty());
  now_ns_ -= 100000000000;  // a recording that began anew
  startOdometry();
  drive(1.0, 2.0);
  EXPECT_TRUE(keeper_.valid()) << keeper_.reason();
  EXPECT_TRUE(told_.empty());
}

TEST_F(Drive, BelievesTheLaterOfTwoPublishers)
{
  startOdometry();
  drive(2.0, 1.0);
  const uint64_t first = connection_;
  ++connection_;
  drive(0.1, 1.0);
  OdometryPose other;
  other.stamp_ns = now_ns_;
  other.connection = first;
  EXPECT_NE(std::string::npos, keeper_.addOdometry(other, now_ns_).find("two publishers"));
  other.connection = connection_;
  other.T_odom_base.translation().x() = std::nan("");
  EXPECT_NE("", keeper_.addOdometry(other, now_ns_));
  EXPECT_FALSE(keeper_.addWheels(now_ns_, {0.0, std::nan(""), 0.0}, 0.0, 0.0));
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(told_.empty());
}

/// A saved pose of a vehicle that stands at (12, 5).
class Resume : public Drive
{
protected:
  Resume()
  {
    saved_.T_map_base = lifted({12.0, 5.0, 2.0}, 0.3);
    saved_.count = 60000;
    saved_.age_s = 30000.0;
    truth_ = {12.0, 5.0, 2.0};
  }
  SavedPose saved_;
};

TEST_F(Resume, GoesOnWhereTheVehicleWasSwitchedOff)
{
  keeper_.resume(saved_);
  startOdometry();
  drive(0.5, 0.0);
  ASSERT_EQ(1u, told_.size());
  EXPECT_NEAR(0.3, told_[0].T_map_base.translation().z(), 1e-9);
  expectLocalised(1e-6, 1e-6);
  drive(5.0, 2.0);
  expectLocalised(1e-3, 1e-3);
  EXPECT_EQ(1u, told_.size());
}

TEST_F(Resume, DoesNotDisturbOdometryThatLivedOn)
{
  saved_.age_s = 3.0;  // only the keeper was restarted; the vehicle drives
  keeper_.resume(saved_);
  startOdometry();
  count_ = saved_.count + 600;
  drive(1.0, 3.0);
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(told_.empty());
}

TEST_F(Resume, DoesNotDisturbOdometryThatKnowsWhereItIs)
{
  keeper_.resume(saved_);
  startOdometry();
  map_odom_ = lifted({40.0, 20.0, 0.0});
  drive(1.0, 0.0);
  EXPECT_TRUE(keeper_.valid());
  EXPECT_TRUE(told_.empty());
}

TEST_F(Resume, DoesNotBelieveAPoseThatWasWrittenInFastMotion)
{
  saved_.speed = 3.0;
  keeper_.resume(saved_);
  startOdometry();
  drive(1.0, 0.0);
  EXPECT_EQ(KeeperState::LOST, keeper_.state());
  EXPECT_TRUE(told_.empty());
}

}  // namespace
}  // namespace pi_vehicle
