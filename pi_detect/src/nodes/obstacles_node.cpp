#include <pi_node/ros/node_main.h>

#include "ros/obstacles/obstacles_ros.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_detect::ObstaclesRos>(argc, argv, "obstacles");
}
