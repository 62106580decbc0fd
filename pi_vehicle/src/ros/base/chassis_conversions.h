#pragma once

#include "ros/base/base_options.h"

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <pi_vehicle/chassis/chassis_host.h>
#include <ros/time.h>
#include <sensor_msgs/BatteryState.h>

#include <string>

namespace pi_vehicle
{

/// A negative deceleration becomes NaN, which the driver refuses.
chassis::Motion fromMsg(const MotionCommand& message);

VehicleState toVehicleState(const chassis::HostState& state, const ros::Time& stamp, const std::string& frame);

/// Pose in odom_frame, twist in base_link_frame. Variances of the pose grow with the square of the distance driven. z,
/// roll, pitch and sideways speed have variance 1e-6, as the vehicle cannot move so.
nav_msgs::Odometry toOdometry(const chassis::WheelOdometry& odometry, const ros::Time& stamp,
                              const WheelOdometryOptions& options);
geometry_msgs::TransformStamped toTransform(const nav_msgs::Odometry& odometry);

/// What the chassis says of its kind and wheels against the vehicle's description; empty: they agree.
std::string contradictionOf(const chassis::Hello& hello, const pi_node::VehicleDescription& vehicle);

/// Unknown values are NaN.
sensor_msgs::BatteryState toBatteryState(const chassis::HostState& state, const ros::Time& stamp,
                                         const std::string& frame);

}  // namespace pi_vehicle
