#include "ros/recorder/recorder_ros.h"

#include <pi_node/ros/adapter_nodelet.h>

#include <pluginlib/class_list_macros.hpp>

namespace pi_vehicle
{

using RecorderNodelet = pi_node::AdapterNodelet<RecorderRos>;

}  // namespace pi_vehicle

PLUGINLIB_EXPORT_CLASS(pi_vehicle::RecorderNodelet, nodelet::Nodelet)
