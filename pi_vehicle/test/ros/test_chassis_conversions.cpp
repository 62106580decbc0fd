// Messages of the chassis driver.

#include "ros/base/chassis_conversions.h"

#include <gtest/gtest.h>

#include <cmath>

namespace pi_vehicle
{
namespace
{

TEST(ChassisConversions, ModesHaveTheNumbersOfTheMessage)
{
  EXPECT_EQ(static_cast<int>(chassis::HostMode::READY), VehicleState::READY);
  EXPECT_EQ(static_cast<int>(chassis::HostMode::DRIVING), VehicleState::DRIVING);
  EXPECT_EQ(static_cast<int>(chassis::HostMode::STOPPED_WATCHDOG), VehicleState::STOPPED_WATCHDOG);
  EXPECT_EQ(static_cast<int>(chassis::HostMode::EMERGENCY_STOP), VehicleState::EMERGENCY_STOP);
  EXPECT_EQ(static_cast<int>(chassis::HostMode::FAULT), VehicleState::FAULT);
  EXPECT_EQ(static_cast<int>(chassis::HostMode::DISCONNECTED), VehicleState::DISCONNECTED);
}

TEST(ChassisConversions, MotionKeepsItsNumbersAndANegativeDecelerationIsRefused)
{
  MotionCommand message;
  message.speed = 1.5;
  message.curvature = -0.2;
  message.max_deceleration = 0.7;
  EXPECT_EQ(1.5, fromMsg(message).speed);
  EXPECT_EQ(-0.2, fromMsg(message).curvature);
  EXPECT_EQ(0.7, fromMsg(message).deceleration);
  message.max_deceleration = -0.1;
  EXPECT_TRUE(std::isnan(fromMsg(message).deceleration));
}

TEST(ChassisConversions, StateSaysWhatIsKnown)
{
  chassis::HostState state;
  state.mode = chassis::HostMode::FAULT;
  state.detail = "drive stuck";
  state.moving = true;
  state.status.speed = 0.5;
  state.status.curvature = 0.1;
  state.status.battery_voltage = 24.5;
  state.odometry.distance = 12.0;
  const VehicleState message = toVehicleState(state, ros::Time(3, 4), "base_link");
  EXPECT_EQ(ros::Time(3, 4), message.header.stamp);
  EXPECT_EQ("base_link", message.header.frame_id);
  EXPECT_EQ(VehicleState::FAULT, message.mode);
  EXPECT_EQ("drive stuck", message.detail);
  EXPECT_EQ(0.5, message.speed);
  EXPECT_EQ(0.1, message.curvature);
  EXPECT_TRUE(message.moving);
  EXPECT_EQ(12.0, message.odometer);
  EXPECT_EQ(24.5, message.battery_voltage);
  EXPECT_TRUE(std::isnan(message.battery_charge));

  const sensor_msgs::BatteryState battery = toBatteryState(state, ros::Time(3, 4), "base_link");
  EXPECT_FLOAT_EQ(24.5f, battery.voltage);
  EXPECT_TRUE(std::isnan(battery.percentage));
  EXPECT_TRUE(battery.present);
  state.status.battery_current = -3.0;
  EXPECT_EQ(sensor_msgs::BatteryState::POWER_SUPPLY_STATUS_DISCHARGING,
            toBatteryState(state, ros::Time(), "").power_supply_status);
  state.mode = chassis::HostMode::DISCONNECTED;
  EXPECT_FALSE(toBatteryState(state, ros::Time(), "").present);
}

TEST(ChassisConversions, OdometryHasPoseTwistAndGrowingVariance)
{
  const WheelOdometryOptions options;
  chassis::WheelOdometry odometry;
  odometry.pose = Pose2{1.0, 2.0, 0.5 * std::acos(-1.0)};
  odometry.speed = 0.5;
  odometry.yaw_rate = 0.2;
  const nav_msgs::Odometry start = toOdometry(odometry, ros::Time(5, 0), options);
  EXPECT_EQ("odom", start.header.frame_id);
  EXPECT_EQ("base_link", start.child_frame_id);
  EXPECT_EQ(1.0, start.pose.pose.position.x);
  EXPECT_EQ(2.0, start.pose.pose.position.y);
  EXPECT_NEAR(std::sqrt(0.5), start.pose.pose.orientation.z, 1e-12);
  EXPECT_NEAR(std::sqrt(0.5), start.pose.pose.orientation.w, 1e-12);
  EXPECT_EQ(0.5, start.twist.twist.linear.x);
  EXPECT_EQ(0.2, start.twist.twist.angular.z);
  odometry.distance = 10.0;
  const nav_msgs::Odometry later = toOdometry(odometry, ros::Time(6, 0), options);
  EXPECT_NEAR(0.2 * 0.2 + 0.25 * 0.2 * 0.2 * 100.0, later.pose.covariance[0], 1e-6);
  EXPECT_NEAR(0.2 * 0.2, later.pose.covariance[35], 1e-6);
  EXPECT_GT(later.pose.covariance[7], start.pose.covariance[7]);
  for (size_t i = 0; i < 6; ++i)
  {
    EXPECT_GT(start.pose.covariance[7 * i], 0.0);
    EXPECT_GT(start.twist.covariance[7 * i], 0.0);
  }
}

TEST(ChassisConversions, AChassisThatIsNotTheDescribedOneIsNamed)
{
  pi_node::VehicleDescription vehicle;
  chassis::Hello hello;
  hello.wheelbase = 0.74;
  EXPECT_EQ("", contradictionOf(hello, vehicle));
  hello.wheelbase = 1.2;
  EXPECT_EQ(
      "the chassis is ackermann with 1.20 m between its wheels, the vehicle's description says ackermann with 0.75",
      contradictionOf(hello, vehicle));
  vehicle.kind = pi_node::VehicleKind::DIFFERENTIAL;
  vehicle.track = 1.2;
  EXPECT_NE("", contradictionOf(hello, vehicle));
  hello.kind = chassis::Kind::DIFFERENTIAL;
  EXPECT_EQ("", contradictionOf(hello, vehicle));
}

}  // namespace
}  // namespace pi_vehicle
