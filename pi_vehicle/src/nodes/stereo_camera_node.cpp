#include "ros/sensors/stereo_camera_ros.h"

#include <pi_node/ros/node_main.h>

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_vehicle::StereoCameraRos>(argc, argv, "camera");
}
