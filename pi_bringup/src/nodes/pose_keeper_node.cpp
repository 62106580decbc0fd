#include <pi_bringup/ros/pose_keeper_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "pose_keeper");
  const ros::NodeHandle node;  // outlives the keeper: roscpp ends with the last handle, and its log with it
  try
  {
    pi_bringup::PoseKeeperRos keeper(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("pose_keeper", error.what());
    return 1;
  }
}
