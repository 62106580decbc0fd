#include "ros/simulated_microphone_ros_options.h"

#include <pi_node/ros/parameter_tree.h>

namespace pi_simulation
{

namespace parameter_tree = pi_node::parameter_tree;
using XmlRpc::XmlRpcValue;

/// Every parameter by the path of its name, with its field.
template <typename Options, typename Visitor>
static void visitFields(Options& options, Visitor&& visit)
{
  visit("frame_id", options.frame_id);
  visit("noise_level_dbfs", options.mixer.noise_level_dbfs);
  visit("seed", options.mixer.seed);
  visit("background", options.mixer.background);
  visit("background_level_dbfs", options.mixer.background_level_dbfs);
  visit("play_gain_db", options.mixer.play_gain_db);
}

void SimulatedMicrophoneRosOptions::validate() const
{
  mixer.validate();
  pi_node::parameters::require(mixer.background.empty() || mixer.background.front() == '/', "background",
                               "\"" + mixer.background + "\"",
                               "an absolute path: a node's working folder is not its user's");
}

SimulatedMicrophoneRosOptions SimulatedMicrophoneRosOptions::load(const ros::NodeHandle& private_node,
                                                                  std::vector<std::string>* unknown)
{
  XmlRpcValue tree;
  const std::string& path = private_node.getNamespace();
  private_node.getParam(path, tree);
  return fromParameters(tree, path + "/", unknown);
}

SimulatedMicrophoneRosOptions SimulatedMicrophoneRosOptions::fromParameters(const XmlRpcValue& tree,
                                                                            const std::string& path,
                                                                            std::vector<std::string>* unknown)
{
  return parameter_tree::load<SimulatedMicrophoneRosOptions>(tree, path, unknown);
}

XmlRpcValue SimulatedMicrophoneRosOptions::toParameters() const
{
  return parameter_tree::save(*this);
}

std::string SimulatedMicrophoneRosOptions::toText() const
{
  return pi_node::parameters::text(toParameters());
}

}  // namespace pi_simulation
