#include <pi_node/ros/node_main.h>

#include "ros/ssd_ros.h"

namespace
{

struct SsdNode : pi_detect::SsdRos
{
  SsdNode(const ros::NodeHandle& node, const ros::NodeHandle& private_node) : SsdRos(node, private_node, true) {}
};

}  // namespace

int main(int argc, char** argv)
{
  return pi_node::runNode<SsdNode>(argc, argv, "ssd");
}
