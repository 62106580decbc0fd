#include <pi_node/ros/adapter_nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "ros/vio_ros.h"

namespace pi_slam
{

using VioNodelet = pi_node::AdapterNodelet<VioRos>;

}  // namespace pi_slam

PLUGINLIB_EXPORT_CLASS(pi_slam::VioNodelet, nodelet::Nodelet)
