#include <pi_node/ros/node_main.h>

#include "ros/runtime_ros.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_runtime::RuntimeRos>(argc, argv, "runtime");
}
