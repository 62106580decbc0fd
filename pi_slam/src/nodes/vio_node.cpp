#include <pi_node/ros/node_main.h>

#include "ros/vio_ros.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_slam::VioRos>(argc, argv, "vio");
}
