#include <pi_node/ros/adapter_nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "ros/obstacles/obstacles_ros.h"
#include "ros/ssd_ros.h"
#include "ros/tracker_ros.h"

namespace pi_detect
{

using ObstaclesNodelet = pi_node::AdapterNodelet<ObstaclesRos>;
using SsdNodelet = pi_node::AdapterNodelet<SsdRos>;
using TrackerNodelet = pi_node::AdapterNodelet<TrackerRos>;

}  // namespace pi_detect

PLUGINLIB_EXPORT_CLASS(pi_detect::ObstaclesNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_detect::SsdNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_detect::TrackerNodelet, nodelet::Nodelet)
