#include <pi_runtime/ros/runtime_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "runtime");
  const ros::NodeHandle node;  // outlives the runtime: roscpp ends with the last handle, and its log with it
  try
  {
    pi_runtime::RuntimeRos runtime(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("runtime", error.what());
    return 1;
  }
}
