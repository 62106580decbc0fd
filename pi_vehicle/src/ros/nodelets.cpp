#include "ros/arbiter_ros.h"
#include "ros/base/chassis_ros.h"
#include "ros/base/twist_base_ros.h"
#include "ros/command_ros.h"
#include "ros/joystick_ros.h"
#include "ros/navigation/navigation_ros.h"
#include "ros/pose_keeper_ros.h"
#include "ros/power_ros.h"
#include "ros/reaction_ros.h"
#include "ros/sensors/serial_imu_ros.h"

#include <pi_node/ros/adapter_nodelet.h>

#include <pluginlib/class_list_macros.hpp>

namespace pi_vehicle
{

using ArbiterNodelet = pi_node::AdapterNodelet<ArbiterRos>;
using ChassisNodelet = pi_node::AdapterNodelet<ChassisRos>;
using CommandNodelet = pi_node::AdapterNodelet<CommandRos>;
using JoystickNodelet = pi_node::AdapterNodelet<JoystickRos>;
using NavigationNodelet = pi_node::AdapterNodelet<NavigationRos>;
using PoseKeeperNodelet = pi_node::AdapterNodelet<PoseKeeperRos>;
using PowerNodelet = pi_node::AdapterNodelet<PowerRos>;
using ReactionNodelet = pi_node::AdapterNodelet<ReactionRos>;
using SerialImuNodelet = pi_node::AdapterNodelet<SerialImuRos>;
using TwistBaseNodelet = pi_node::AdapterNodelet<TwistBaseRos>;

}  // namespace pi_vehicle

PLUGINLIB_EXPORT_CLASS(pi_vehicle::ArbiterNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::ChassisNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::CommandNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::JoystickNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::NavigationNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::PoseKeeperNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::PowerNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::ReactionNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::SerialImuNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_vehicle::TwistBaseNodelet, nodelet::Nodelet)
