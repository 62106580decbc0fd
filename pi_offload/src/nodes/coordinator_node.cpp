#include <pi_node/ros/node_main.h>

#include "ros/coordinator_ros.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_offload::CoordinatorRos>(argc, argv, "coordinator");
}
