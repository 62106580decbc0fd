#include <pi_bringup/ros/navigation_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "navigation");
  const ros::NodeHandle node;  // outlives the navigation: roscpp ends with the last handle, and its log with it
  try
  {
    pi_bringup::NavigationRos navigation(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("navigation", error.what());
    return 1;
  }
}
