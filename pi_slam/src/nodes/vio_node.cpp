#include <pi_slam/ros/vio_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "vio");
  const ros::NodeHandle node;  // outlives the odometry: roscpp ends with the last handle, and its log with it
  try
  {
    pi_slam::VioRos vio(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("vio", error.what());
    return 1;
  }
}
