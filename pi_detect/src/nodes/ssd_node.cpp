#include <pi_detect/ros/ssd_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "ssd");
  const ros::NodeHandle node;  // outlives the detection: roscpp ends with the last handle, and its log with it
  try
  {
    pi_detect::SsdRos ssd(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("ssd", error.what());
    return 1;
  }
}
