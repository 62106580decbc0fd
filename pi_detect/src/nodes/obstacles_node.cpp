#include <pi_detect/ros/obstacles_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "obstacles");
  const ros::NodeHandle node;  // outlives the work: roscpp ends with the last handle, and its log with it
  try
  {
    pi_detect::ObstaclesRos obstacles(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("obstacles", error.what());
    return 1;
  }
}
