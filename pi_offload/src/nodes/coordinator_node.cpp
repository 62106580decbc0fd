#include <pi_offload/ros/coordinator_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "coordinator");
  const ros::NodeHandle node;  // outlives the coordinator: roscpp ends with the last handle, and its log with it
  try
  {
    pi_offload::CoordinatorRos coordinator(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("coordinator", error.what());
    return 1;
  }
}
