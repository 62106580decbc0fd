#pragma once

#include "ros/chassis_ros_options.h"

#include <nav_msgs/Odometry.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <pi_vehicle/chassis/chassis_host.h>
#include <ros/time.h>
#include <sensor_msgs/BatteryState.h>

namespace pi_vehicle
{

/// Numbers as they are; a negative deceleration becomes NaN, which the driver refuses.
chassis::Motion fromMsg(const MotionCommand& message);

VehicleState toVehicleState(const chassis::HostState& state, const ros::Time& stamp, const std::string& frame);

/// Pose in odom_frame, twist in base_link_frame. Variances of the pose grow with the square of the distance driven;
/// what wheels do not know (z, roll, pitch, sideways speed) has 1e-6: the vehicle cannot do it.
nav_msgs::Odometry toOdometry(const chassis::WheelOdometry& odometry, const ros::Time& stamp,
                              const ChassisRosOptions& options);

/// What is unknown is NaN.
sensor_msgs::BatteryState toBatteryState(const chassis::HostState& state, const ros::Time& stamp,
                                         const std::string& frame);

}  // namespace pi_vehicle
