#include <pi_bringup/ros/euroc_player_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "euroc_player");
  const ros::NodeHandle node;  // outlives the player: roscpp ends with the last handle, and its log with it
  try
  {
    pi_bringup::EurocPlayerRos player(node, ros::NodeHandle("~"));
    return pi_bringup::runPlayer(&player);
  }
  catch (const std::exception& exception)
  {
    ROS_FATAL_STREAM_NAMED("playback", exception.what());
    return 1;
  }
}
