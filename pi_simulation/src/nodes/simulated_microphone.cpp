#include "ros/simulated_microphone_ros.h"

#include <pi_node/ros/node_main.h>

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_simulation::SimulatedMicrophoneRos>(argc, argv, "simulated_microphone");
}
