#include <pi_bringup/ros/power_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "power");
  const ros::NodeHandle node;  // outlives the adapter: roscpp ends with the last handle, and its log with it
  try
  {
    pi_bringup::PowerRos power(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("power", error.what());
    return 1;
  }
}
