#include <pi_node/ros/adapter_nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "ros/coordinator_ros.h"

namespace pi_offload
{

using CoordinatorNodelet = pi_node::AdapterNodelet<CoordinatorRos>;

}  // namespace pi_offload

PLUGINLIB_EXPORT_CLASS(pi_offload::CoordinatorNodelet, nodelet::Nodelet)
