#include <pi_slam/ros/ground_truth_alignment.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "ground_truth_alignment");
  const ros::NodeHandle node;
  try
  {
    pi_slam::GroundTruthAlignmentRos alignment(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("ground_truth_alignment", error.what());
    return 1;
  }
}
