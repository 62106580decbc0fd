#include <pi_bringup/ros/chassis_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "chassis");
  const ros::NodeHandle node;  // outlives the chassis: roscpp ends with the last handle, and its log with it
  try
  {
    pi_bringup::ChassisRos driver(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("chassis", error.what());
    return 1;
  }
}
