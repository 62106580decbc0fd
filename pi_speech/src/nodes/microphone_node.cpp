#include <pi_node/ros/node_main.h>

#include "ros/microphone_ros.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_speech::MicrophoneRos>(argc, argv, "microphone");
}
