#include <pi_node/ros/adapter_nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "ros/runtime_ros.h"

namespace pi_runtime
{

using RuntimeNodelet = pi_node::AdapterNodelet<RuntimeRos>;

}  // namespace pi_runtime

PLUGINLIB_EXPORT_CLASS(pi_runtime::RuntimeNodelet, nodelet::Nodelet)
