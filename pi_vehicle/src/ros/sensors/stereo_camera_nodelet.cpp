#include "ros/sensors/stereo_camera_ros.h"

#include <pi_node/ros/adapter_nodelet.h>

#include <pluginlib/class_list_macros.hpp>

namespace pi_vehicle
{

using StereoCameraNodelet = pi_node::AdapterNodelet<StereoCameraRos>;

}  // namespace pi_vehicle

PLUGINLIB_EXPORT_CLASS(pi_vehicle::StereoCameraNodelet, nodelet::Nodelet)
