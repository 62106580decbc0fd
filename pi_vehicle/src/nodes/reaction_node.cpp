#include <pi_node/ros/node_main.h>

#include "ros/reaction_ros.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_vehicle::ReactionRos>(argc, argv, "reaction");
}
