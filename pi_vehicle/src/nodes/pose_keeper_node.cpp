#include <pi_node/ros/node_main.h>

#include "ros/pose_keeper_ros.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_vehicle::PoseKeeperRos>(argc, argv, "pose_keeper");
}
