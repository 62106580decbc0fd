#include "ros/base/twist_base_ros.h"

#include <pi_node/ros/node_main.h>

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_vehicle::TwistBaseRos>(argc, argv, "twist_base");
}
