#include "ros/base/chassis_ros.h"

#include <pi_node/ros/node_main.h>

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_vehicle::ChassisRos>(argc, argv, "chassis");
}
