#include <pi_bringup/ros/simulated_microphone_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "simulated_microphone");
  const ros::NodeHandle node;  // outlives the microphone: roscpp ends with the last handle, and its log with it
  try
  {
    pi_bringup::SimulatedMicrophoneRos microphone(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("simulated_microphone", error.what());
    return 1;
  }
}
