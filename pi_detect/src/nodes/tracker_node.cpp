#include <pi_detect/ros/tracker_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "tracker");
  const ros::NodeHandle node;  // outlives the work: roscpp ends with the last handle, and its log with it
  try
  {
    pi_detect::TrackerRos tracker(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("tracker", error.what());
    return 1;
  }
}
