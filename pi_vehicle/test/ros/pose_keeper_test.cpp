// Judge of pose_keeper.test.

#include "ros/child_node.h"
#include "ros/pose_conversions.h"

#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_vehicle/LocalisationState.h>
#include <pi_vehicle/decision/pose2.h>
#include <ros/ros.h>
#include <tf2_ros/transform_broadcaster.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

namespace pi_vehicle
{

using namespace pi_node::test_support;
using test::ChildNode;
namespace
{

constexpr double MAX_ERROR_M = 0.1;
constexpr double MAX_ERROR_RAD = 2.0 * M_PI / 180.0;

Pose2 fromPose(const geometry_msgs::Pose& pose)
{
  return {pose.position.x, pose.position.y, 2.0 * std::atan2(pose.orientation.z, pose.orientation.w)};
}

bool isNear(const Pose2& a, const Pose2& b)
{
  return (a.position() - b.position()).norm() < MAX_ERROR_M &&
         std::abs(wrapAngle(a.heading - b.heading)) < MAX_ERROR_RAD;
}

/// A vehicle in wall time, with wheels that are never silent and a localisation that may die.
class Vehicle
{
public:
  Vehicle()
  {
    wheels_ = node_.advertise<nav_msgs::Odometry>("wheel_odometry", 10);
    initial_pose_ = node_.subscribe("initialpose", 10, &Vehicle::onInitialPose, this);
    thread_ = std::thread([this] { run(); });
  }
  ~Vehicle()
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      stopping_ = true;
    }
    thread_.join();
  }
  Vehicle(const Vehicle&) = delete;
  Vehicle& operator=(const Vehicle&) = delete;

  void steer(double speed, double curvature)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    speed_ = speed;
    curvature_ = curvature;
  }
  /// As a new process: odometry at the origin, T_map_odom the identity.
  void startLocalisation()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    odometry_ = node_.advertise<nav_msgs::Odometry>("odometry", 100);
    T_map_start_ = truth_;
    T_map_odom_ = Pose2();
    odom_poses_.clear();
    speaks_ = true;
  }
  void killLocalisation()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    speaks_ = false;
    odometry_.shutdown();
  }
  /// It lives on without a word.
  void setSpeaks(bool speaks)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    speaks_ = speaks;
  }
  void closeLoop(const Pose2& jump)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    T_map_odom_ = jump * T_map_odom_;
  }
  Pose2 truth() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return truth_;
  }
  /// Where the localisation has the vehicle.
  Pose2 localised() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return T_map_odom_ * T_map_start_.inverse() * truth_;
  }
  /// Of the true path, at a stamp.
  std::optional<Pose2> truthAt(const ros::Time& stamp) const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const auto found = truths_.lower_bound(stamp);
    return found == truths_.end() ? std::nullopt : std::make_optional(found->second);
  }
  /// Sets the truth, as if the vehicle had been there before it was switched on.
  void put(const Pose2& pose)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    truth_ = pose;
  }
  /// Until it has driven so far.
  bool waitForWay(double way_m) const
  {
    double from = 0.0;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      from = way_;
    }
    return until(TIMEOUT_S,
                 [&]
                 {
                   std::lock_guard<std::mutex> lock(mutex_);
                   return way_ >= from + way_m;
                 });
  }

private:
  void onInitialPose(const geometry_msgs::PoseWithCovarianceStampedConstPtr& message)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const auto odometry = odom_poses_.lower_bound(message->header.stamp);
    if (speaks_ && odometry != odom_poses_.end())
    {
      T_map_odom_ = fromPose(message->pose.pose) * odometry->second.inverse();
    }
  }

  void run()
  {
    using Clock = std::chrono::steady_clock;
    Clock::time_point last = Clock::now();
    for (uint32_t count = 0;; ++count)
    {
      std::this_thread::sleep_until(last + std::chrono::milliseconds(5));
      const Clock::time_point now = Clock::now();
      const double dt = std::chrono::duration<double>(now - last).count();
      last = now;
      std::lock_guard<std::mutex> lock(mutex_);
      if (stopping_)
      {
        return;
      }
      const ros::Time stamp = ros::Time::now();
      truth_ = truth_.moved(speed_ * dt, curvature_);
      wheel_pose_ = wheel_pose_.moved(1.01 * speed_ * dt, curvature_);
      way_ += std::abs(speed_) * dt;
      truths_[stamp] = truth_;
      if (count % 4 == 0)
      {
        publishWheels(stamp);
      }
      if (speaks_)
      {
        publishLocalisation(stamp, count % 4 == 0);
      }
    }
  }

  void publishWheels(const ros::Time& stamp)
  {
    nav_msgs::Odometry message;
    message.header.stamp = stamp;
    message.header.frame_id = "odom";
    message.child_frame_id = "base_link";
    message.pose.pose = toPose(wheel_pose_);
    message.twist.twist.linear.x = speed_;
    message.twist.twist.angular.z = speed_ * curvature_;
    wheels_.publish(message);
  }

  void publishLocalisation(const ros::Time& stamp, bool with_tf)
  {
    const Pose2 T_odom_base = T_map_start_.inverse() * truth_;
    odom_poses_[stamp] = T_odom_base;
    nav_msgs::Odometry message;
    message.header.stamp = stamp;
    message.header.frame_id = "odom";
    message.child_frame_id = "base_link";
    message.pose.pose = toPose(T_odom_base);
    message.twist.twist.linear.x = speed_;
    odometry_.publish(message);
    if (with_tf)
    {
      geometry_msgs::TransformStamped transform;
      transform.header.stamp = stamp;
      transform.header.frame_id = "map";
      transform.child_frame_id = "odom";
      const geometry_msgs::Pose pose = toPose(T_map_odom_);
      transform.transform.translation.x = pose.position.x;
      transform.transform.translation.y = pose.position.y;
      transform.transform.rotation = pose.orientation;
      broadcaster_.sendTransform(transform);
    }
  }

  ros::NodeHandle node_;
  ros::Publisher odometry_;
  ros::Publisher wheels_;
  ros::Subscriber initial_pose_;
  tf2_ros::TransformBroadcaster broadcaster_;
  mutable std::mutex mutex_;
  bool stopping_ = false;
  bool speaks_ = false;
  double speed_ = 0.0;
  double curvature_ = 0.0;
  double way_ = 0.0;
  Pose2 truth_;
  Pose2 wheel_pose_{-30.0, 50.0, 1.0};
  Pose2 T_map_start_;  ///< of this life
  Pose2 T_map_odom_;
  std::map<ros::Time, Pose2> odom_poses_;  ///< of this life
  std::map<ros::Time, Pose2> truths_;
  std::thread thread_;
};

class PoseKeeperTest : public ::testing::Test
{
protected:
  using InitialPose = geometry_msgs::PoseWithCovarianceStamped;

  bool waitForValid(bool valid)
  {
    return until(TIMEOUT_S,
                 [&]
                 {
                   const auto last = localisation_.last();
                   return last && last->valid == valid;
                 });
  }
  void expectLastPoseIsRight()
  {
    const auto pose = initial_poses_.last();
    ASSERT_TRUE(pose);
    EXPECT_EQ("map", pose->header.frame_id);
    const auto truth = vehicle_.truthAt(pose->header.stamp);
    ASSERT_TRUE(truth);
    const Pose2 error = truth->inverse() * fromPose(pose->pose.pose);
    EXPECT_LT(error.position().norm(), MAX_ERROR_M);
    EXPECT_LT(std::abs(error.heading), MAX_ERROR_RAD);
    EXPECT_GT(pose->pose.covariance[0], 0.0);
    EXPECT_GT(pose->pose.covariance[35], 0.0);
  }
  /// The localisation dies and comes back, while the vehicle goes on as it does.
  void killAndWait(double way_m)
  {
    vehicle_.killLocalisation();
    ASSERT_TRUE(waitForValid(false)) << log_.text();
    ASSERT_TRUE(vehicle_.waitForWay(way_m));
    vehicle_.steer(0.0, 0.0);  // as navigation does
    initial_poses_.clear();
    localisation_.clear();
    vehicle_.startLocalisation();
    ASSERT_TRUE(waitForValid(true)) << log_.text();
    EXPECT_TRUE(isNear(vehicle_.localised(), vehicle_.truth()));
    expectLastPoseIsRight();
  }

  LogCollector log_;
  Collector<InitialPose> initial_poses_{"initialpose"};
  Collector<LocalisationState> localisation_{"localisation"};
  DiagnosticCollector diagnostics_;
  Vehicle vehicle_;
};

TEST_F(PoseKeeperTest, TellsALocalisationThatBeganAnewAndNoOther)
{
  ASSERT_TRUE(loadNodelet("pose_keeper", "pi_vehicle/pose_keeper")) << log_.text();
  ASSERT_TRUE(waitForValid(false));
  EXPECT_TRUE(diagnostics_.waitForSummary("pose", diagnostic_msgs::DiagnosticStatus::WARN, "waiting"))
      << diagnostics_.text();
  vehicle_.startLocalisation();
  ASSERT_TRUE(waitForValid(true)) << log_.text();
  vehicle_.steer(2.0, 0.15);
  ASSERT_TRUE(vehicle_.waitForWay(4.0));

  // Healthy: a gap, a loop closure, both.
  vehicle_.setSpeaks(false);
  ASSERT_TRUE(waitForValid(false)) << log_.text();
  vehicle_.setSpeaks(true);
  ASSERT_TRUE(waitForValid(true)) << log_.text();
  vehicle_.closeLoop({1.5, 0.7, 0.3});
  ASSERT_TRUE(vehicle_.waitForWay(1.0));
  vehicle_.closeLoop(Pose2{1.5, 0.7, 0.3}.inverse());
  ASSERT_TRUE(vehicle_.waitForWay(3.0));
  vehicle_.setSpeaks(false);
  ASSERT_TRUE(waitForValid(false)) << log_.text();
  ASSERT_TRUE(vehicle_.waitForWay(2.0));
  vehicle_.setSpeaks(true);
  ASSERT_TRUE(waitForValid(true)) << log_.text();
  EXPECT_EQ(0u, initial_poses_.messages().size()) << log_.text();
  EXPECT_TRUE(diagnostics_.waitForValue("pose", "times that odometry began anew", "0"));

  // In motion, at standstill, in motion again.
  killAndWait(2.0);
  killAndWait(0.0);
  vehicle_.steer(1.5, -0.1);
  ASSERT_TRUE(vehicle_.waitForWay(4.0));
  killAndWait(1.5);
  EXPECT_TRUE(diagnostics_.waitForValue("pose", "times that odometry began anew", "3")) << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForSummary("pose", diagnostic_msgs::DiagnosticStatus::OK, "localised"));

  // The keeper itself begins anew: it takes what the localisation says.
  ASSERT_TRUE(unloadNodelet("pose_keeper"));
  initial_poses_.clear();
  localisation_.clear();
  ASSERT_TRUE(loadNodelet("pose_keeper", "pi_vehicle/pose_keeper"));
  ASSERT_TRUE(waitForValid(true)) << log_.text();
  EXPECT_EQ(0u, initial_poses_.messages().size());
  ASSERT_TRUE(unloadNodelet("pose_keeper"));
}

TEST_F(PoseKeeperTest, GoesOnFromItsFile)
{
  const TemporaryFolder folder;
  const std::string file = folder.path() + "/pose.yaml";
  ros::param::set("/keeper_1/file", file);
  ros::param::set("/keeper_1/resume", true);
  vehicle_.startLocalisation();
  {
    ChildNode keeper(POSE_KEEPER_NODE, "keeper_1");
    ASSERT_TRUE(waitForValid(true)) << log_.text();  // that there is no file yet is no fault
    vehicle_.steer(2.0, 0.2);
    ASSERT_TRUE(vehicle_.waitForWay(6.0));
    vehicle_.steer(0.0, 0.0);
    const auto written = [&]
    {
      std::ifstream stream(file);
      std::string content((std::istreambuf_iterator<char>(stream)), std::istreambuf_iterator<char>());
      return content.find("speed: 0\n") != std::string::npos;
    };
    ASSERT_TRUE(until(TIMEOUT_S, written)) << log_.text();
    EXPECT_EQ(0, keeper.end(SIGINT));
  }
  EXPECT_EQ(0u, initial_poses_.messages().size());
  vehicle_.killLocalisation();
  localisation_.clear();

  // A night later. The localisation is there before the keeper.
  vehicle_.startLocalisation();
  {
    ChildNode keeper(POSE_KEEPER_NODE, "keeper_1");
    ASSERT_TRUE(waitForValid(true)) << log_.text();
    EXPECT_GE(initial_poses_.messages().size(), 1u) << log_.text();
    EXPECT_TRUE(isNear(vehicle_.localised(), vehicle_.truth()));
    expectLastPoseIsRight();
  }

  // A file that cannot be used is said, and the localisation believed.
  std::ofstream(file) << "position: over there\n";
  initial_poses_.clear();
  localisation_.clear();
  {
    ChildNode keeper(POSE_KEEPER_NODE, "keeper_1");
    ASSERT_TRUE(waitForValid(true)) << log_.text();
    EXPECT_TRUE(diagnostics_.waitForSummary("pose", diagnostic_msgs::DiagnosticStatus::WARN, "not gone on from it"))
        << diagnostics_.text();
    EXPECT_EQ(0u, initial_poses_.messages().size());
    EXPECT_EQ(0, keeper.end(SIGINT));
  }
  ros::param::set("/keeper_1/file", "pose.yaml");
  // Not by its log: a node that ends at once may end before anybody subscribes it.
  ChildNode keeper(POSE_KEEPER_NODE, "keeper_1", true);
  EXPECT_EQ(1, keeper.wait());
  EXPECT_NE(std::string::npos,
            keeper.errors().find("parameter /keeper_1/file = \"pose.yaml\", must be an absolute path"))
      << keeper.errors();
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "pose_keeper_test");
}
