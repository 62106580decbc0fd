// Judge of twist_base.test.

#include <geometry_msgs/Twist.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <pi_vehicle/decision/pose2.h>
#include <ros/ros.h>
#include <std_msgs/Bool.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <cmath>
#include <mutex>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr double PERIOD_S = 0.02;

/// A differential base: does what cmd_vel says, and nothing without it.
class Base
{
public:
  Base()
  {
    publisher_ = node_.advertise<nav_msgs::Odometry>("odom", 10);
    subscriber_ = node_.subscribe("cmd_vel", 1, &Base::onTwist, this);
    timer_ = node_.createSteadyTimer(ros::WallDuration(PERIOD_S), [this](const ros::SteadyTimerEvent&) { step(); });
  }
  void setSilent(bool silent) { silent_ = silent; }
  double speed() const { return speed_; }

private:
  void onTwist(const geometry_msgs::Twist& twist)
  {
    speed_ = twist.linear.x;
    yaw_rate_ = twist.angular.z;
  }
  void step()
  {
    const double speed = speed_;
    pose_ = pose_.moved(speed * PERIOD_S, std::abs(speed) > 1e-6 ? yaw_rate_ / speed : 0.0);
    nav_msgs::Odometry message;
    message.header.stamp = ros::Time::now();
    message.header.frame_id = "wheels";
    message.pose.pose.position.x = pose_.x;
    message.pose.pose.position.y = pose_.y;
    message.pose.pose.orientation.z = std::sin(0.5 * pose_.heading);
    message.pose.pose.orientation.w = std::cos(0.5 * pose_.heading);
    message.twist.twist.linear.x = speed;
    message.twist.twist.angular.z = yaw_rate_;
    if (!silent_)
    {
      publisher_.publish(message);
    }
  }

  ros::NodeHandle node_;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
  ros::SteadyTimer timer_;
  Pose2 pose_;
  std::atomic<double> speed_{0.0};
  std::atomic<double> yaw_rate_{0.0};
  std::atomic<bool> silent_{false};
};

class TwistBaseNode : public testing::Test
{
protected:
  void SetUp() override
  {
    commands_ = node_.advertise<MotionCommand>("motion", 1);
    stop_ = node_.advertise<std_msgs::Bool>("emergency_stop", 1);
    ASSERT_TRUE(loadNodelet("/chassis", "pi_vehicle/twist_base"));
    ASSERT_TRUE(until(TIMEOUT_S,
                      [this]
                      {
                        return states_.last() && states_.last()->mode == VehicleState::READY &&
                               commands_.getNumSubscribers() > 0 && stop_.getNumSubscribers() > 0;
                      }));
  }
  void TearDown() override { EXPECT_TRUE(unloadNodelet("/chassis")); }

  template <typename Condition>
  bool drivesUntil(double speed, Condition&& condition)
  {
    return until(TIMEOUT_S,
                 [&]
                 {
                   MotionCommand message;
                   message.header.stamp = ros::Time::now();
                   message.speed = speed;
                   message.curvature = 0.2;
                   message.source = "test";
                   commands_.publish(message);
                   return condition();
                 });
  }
  bool hasMode(uint8_t mode) const { return states_.last()->mode == mode; }

  ros::NodeHandle node_;
  ros::Publisher commands_;
  ros::Publisher stop_;
  Base base_;
  Collector<VehicleState> states_{"vehicle_state"};
  Collector<nav_msgs::Odometry> odometry_{"wheel_odometry"};
};

TEST_F(TwistBaseNode, DrivesAndTellsWhereItIs)
{
  ASSERT_TRUE(drivesUntil(1.0, [this] { return odometry_.last() && odometry_.last()->pose.pose.position.x > 0.8; }));
  EXPECT_TRUE(hasMode(VehicleState::DRIVING));
  const nav_msgs::Odometry odometry = *odometry_.last();
  EXPECT_EQ("odom", odometry.header.frame_id);
  EXPECT_EQ("base_link", odometry.child_frame_id);
  EXPECT_GT(odometry.pose.pose.position.y, 0.02) << "to the left";
  EXPECT_GT(odometry.pose.covariance[0], 0.0) << "the base gave none";
  EXPECT_NEAR(0.2, states_.last()->curvature, 0.05);
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return hasMode(VehicleState::STOPPED_WATCHDOG); }));
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return base_.speed() == 0.0; }));
}

TEST_F(TwistBaseNode, StopsOnTopicAndServiceUntilReleased)
{
  const auto drives = [this] { return base_.speed() > 0.5; };
  const auto stands = [this] { return base_.speed() == 0.0 && hasMode(VehicleState::EMERGENCY_STOP); };
  ASSERT_TRUE(drivesUntil(1.0, drives));
  std_msgs::Bool message;
  message.data = 1;
  stop_.publish(message);
  ASSERT_TRUE(drivesUntil(1.0, stands));
  std_srvs::Trigger call;
  message.data = 0;
  stop_.publish(message);
  ASSERT_TRUE(drivesUntil(1.0, stands)) << "false releases nothing";
  ASSERT_TRUE(ros::service::call("release_emergency_stop", call) && call.response.success != 0);
  ASSERT_TRUE(drivesUntil(1.0, drives));
  ASSERT_TRUE(ros::service::call("emergency_stop", call) && call.response.success != 0);
  ASSERT_TRUE(drivesUntil(1.0, stands));
}

TEST_F(TwistBaseNode, StandsAndSaysSoWhileTheBaseIsSilent)
{
  ASSERT_TRUE(drivesUntil(1.0, [this] { return base_.speed() > 0.5; }));
  base_.setSilent(true);
  ASSERT_TRUE(drivesUntil(1.0, [this] { return base_.speed() == 0.0 && hasMode(VehicleState::DISCONNECTED); }));
  EXPECT_NE(std::string::npos, states_.last()->detail.find("is the chassis unplugged, or its driver not running?"));
  base_.setSilent(false);
  EXPECT_TRUE(drivesUntil(1.0, [this] { return base_.speed() > 0.5; }));
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "twist_base_test");
}
