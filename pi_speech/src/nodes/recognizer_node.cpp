#include <pi_speech/ros/recognizer_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "recognizer");
  const ros::NodeHandle node;  // outlives the recognizer: roscpp ends with the last handle, and its log with it
  try
  {
    pi_speech::RecognizerRos recognizer(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("recognizer", error.what());
    return 1;
  }
}
