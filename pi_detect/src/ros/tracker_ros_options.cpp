#include "ros/tracker_ros_options.h"
#include <pi_node/ros/parameter_tree.h>

#include "ros/tracker_fields.h"

namespace pi_detect
{

namespace parameter_tree = pi_node::parameter_tree;
using XmlRpc::XmlRpcValue;

/// Every parameter by the path of its name, with its field.
template <typename Options, typename Visitor>
static void visitFields(Options& options, Visitor&& visit)
{
  visitTrackerFields(options.tracker, visit);
  visit("always_on", options.always_on);
  visit("warning_period_s", options.warning_period_s);
}

void TrackerRosOptions::validate() const
{
  parameter_tree::validateGroup("tracker", tracker);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

TrackerRosOptions TrackerRosOptions::load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown)
{
  XmlRpcValue tree;
  const std::string& path = private_node.getNamespace();
  private_node.getParam(path, tree);
  return fromParameters(tree, path + "/", unknown);
}

TrackerRosOptions TrackerRosOptions::fromParameters(const XmlRpcValue& tree, const std::string& path,
                                                    std::vector<std::string>* unknown)
{
  return parameter_tree::load<TrackerRosOptions>(tree, path, unknown);
}

XmlRpcValue TrackerRosOptions::toParameters() const
{
  return parameter_tree::save(*this);
}

std::string TrackerRosOptions::toText() const
{
  return pi_node::parameters::text(toParameters());
}

}  // namespace pi_detect
