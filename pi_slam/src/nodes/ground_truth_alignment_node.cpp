#include <pi_node/ros/node_main.h>

#include "ros/ground_truth_alignment.h"

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_slam::GroundTruthAlignmentRos>(argc, argv, "ground_truth_alignment");
}
