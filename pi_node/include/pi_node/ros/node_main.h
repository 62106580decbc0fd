#pragma once

#include <pi_node/ros/vehicle_time.h>
#include <ros/ros.h>

#include <exception>

namespace pi_node
{

/// The main() of a node: builds its adapter from the public and the private NodeHandle and spins.
/// @param name  default name of the node and of its log.
/// @return the exit status: 1 if the adapter cannot be built; the reason is then in the log.
template <typename Adapter>
int runNode(int argc, char** argv, const char* name)
{
  ros::init(argc, argv, name);
  const ros::NodeHandle node;  // outlives the adapter: roscpp and its log end with the last handle
  followRosTime();
  try
  {
    Adapter adapter(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED(std::string(name), error.what());
    return 1;
  }
}

}  // namespace pi_node
