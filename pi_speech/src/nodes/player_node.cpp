#include <pi_speech/ros/player_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "player");
  const ros::NodeHandle node;  // outlives the player: roscpp ends with the last handle, and its log with it
  try
  {
    pi_speech::PlayerRos player(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("player", error.what());
    return 1;
  }
}
