#include <pi_node/ros/node_main.h>

#include "ros/ssd_ros.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_detect::SsdRos>(argc, argv, "ssd");
}
