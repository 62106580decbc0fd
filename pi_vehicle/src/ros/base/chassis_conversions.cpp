#include "ros/base/chassis_conversions.h"

#include "ros/pose_conversions.h"

#include <pi_node/formatting.h>

#include <cmath>
#include <limits>

namespace pi_vehicle
{
namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
constexpr double IMPOSSIBLE_VARIANCE = 1e-6;
constexpr double LEAST_VARIANCE = 1e-9;
constexpr double SAME_WHEELS_M = 0.02;
constexpr size_t ROW = 6;

double squared(double value)
{
  return value * value;
}

template <typename Covariance>
void setDiagonal(Covariance* covariance, double x, double yaw, double y)
{
  covariance->fill(0.0);
  for (size_t i = 0; i < ROW; ++i)
  {
    (*covariance)[i * ROW + i] = IMPOSSIBLE_VARIANCE;
  }
  (*covariance)[0] = x;
  (*covariance)[ROW + 1] = y;
  (*covariance)[5 * ROW + 5] = yaw;
}

}  // namespace

chassis::Motion fromMsg(const MotionCommand& message)
{
  chassis::Motion motion;
  motion.speed = message.speed;
  motion.curvature = message.curvature;
  motion.deceleration = message.max_deceleration < 0.0 ? UNKNOWN : message.max_deceleration;
  return motion;
}

VehicleState toVehicleState(const chassis::HostState& state, const ros::Time& stamp, const std::string& frame)
{
  VehicleState message;
  message.header.stamp = stamp;
  message.header.frame_id = frame;
  message.speed = state.status.speed;
  message.curvature = state.status.curvature;
  message.moving = state.moving;
  message.mode = static_cast<uint8_t>(state.mode);
  message.detail = state.detail;
  message.odometer = state.odometry.distance;
  message.battery_voltage = state.status.battery_voltage.value_or(UNKNOWN);
  message.battery_current = state.status.battery_current.value_or(UNKNOWN);
  message.battery_charge = state.status.battery_charge.value_or(UNKNOWN);
  return message;
}

nav_msgs::Odometry toOdometry(const chassis::WheelOdometry& odometry, const ros::Time& stamp,
                              const WheelOdometryOptions& options)
{
  nav_msgs::Odometry message;
  message.header.stamp = stamp;
  message.header.frame_id = options.odom_frame;
  message.child_frame_id = options.base_link_frame;
  message.pose.pose = toPose(odometry.pose);
  message.twist.twist.linear.x = odometry.speed;
  message.twist.twist.angular.z = odometry.yaw_rate;
  const OdometryErrors& errors = options.errors;
  const double heading = squared(errors.heading_error * odometry.distance);
  // A wrong heading moves the position sideways by at most the way driven.
  const double position =
      squared(errors.distance_error * odometry.distance) + 0.25 * heading * squared(odometry.distance);
  setDiagonal(&message.pose.covariance, position + LEAST_VARIANCE, heading + LEAST_VARIANCE, position + LEAST_VARIANCE);
  setDiagonal(&message.twist.covariance, squared(errors.speed_error) + LEAST_VARIANCE,
              squared(errors.yaw_rate_error) + LEAST_VARIANCE, IMPOSSIBLE_VARIANCE);
  return message;
}

geometry_msgs::TransformStamped toTransform(const nav_msgs::Odometry& odometry)
{
  geometry_msgs::TransformStamped transform;
  transform.header = odometry.header;
  transform.child_frame_id = odometry.child_frame_id;
  transform.transform.translation.x = odometry.pose.pose.position.x;
  transform.transform.translation.y = odometry.pose.pose.position.y;
  transform.transform.rotation = odometry.pose.pose.orientation;
  return transform;
}

std::string contradictionOf(const chassis::Hello& hello, const pi_node::VehicleDescription& vehicle)
{
  const auto kind =
      hello.kind == chassis::Kind::CAR_LIKE ? pi_node::VehicleKind::ACKERMANN : pi_node::VehicleKind::DIFFERENTIAL;
  const double wheels = vehicle.kind == pi_node::VehicleKind::ACKERMANN ? vehicle.wheelbase : vehicle.track;
  if (kind == vehicle.kind && std::abs(hello.wheelbase - wheels) <= SAME_WHEELS_M)
  {
    return "";
  }
  return std::string("the chassis is ") + toString(kind) +
         pi_node::format(" with %.2f m between its wheels, the vehicle's description says ", hello.wheelbase) +
         toString(vehicle.kind) + pi_node::format(" with %.2f", wheels);
}

sensor_msgs::BatteryState toBatteryState(const chassis::HostState& state, const ros::Time& stamp,
                                         const std::string& frame)
{
  using sensor_msgs::BatteryState;
  const chassis::Status& status = state.status;
  const bool connected = state.mode != chassis::HostMode::DISCONNECTED;
  BatteryState message;
  message.header.stamp = stamp;
  message.header.frame_id = frame;
  message.voltage = static_cast<float>(status.battery_voltage.value_or(UNKNOWN));
  message.current = static_cast<float>(status.battery_current.value_or(UNKNOWN));
  message.percentage = static_cast<float>(status.battery_charge.value_or(UNKNOWN));
  message.temperature = static_cast<float>(UNKNOWN);
  message.charge = static_cast<float>(UNKNOWN);
  message.capacity = static_cast<float>(UNKNOWN);
  message.design_capacity = static_cast<float>(UNKNOWN);
  message.present = connected && status.battery_voltage.has_value();
  message.power_supply_status = !connected || !status.battery_current ? BatteryState::POWER_SUPPLY_STATUS_UNKNOWN
                                : *status.battery_current > 0.0       ? BatteryState::POWER_SUPPLY_STATUS_CHARGING
                                                                      : BatteryState::POWER_SUPPLY_STATUS_DISCHARGING;
  message.power_supply_health = connected && (status.faults & chassis::BATTERY_EMPTY) != 0
                                    ? BatteryState::POWER_SUPPLY_HEALTH_DEAD
                                    : BatteryState::POWER_SUPPLY_HEALTH_UNKNOWN;
  message.power_supply_technology = BatteryState::POWER_SUPPLY_TECHNOLOGY_UNKNOWN;
  return message;
}

}  // namespace pi_vehicle
