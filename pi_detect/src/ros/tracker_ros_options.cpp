#include "ros/tracker_ros_options.h"
#include <pi_node/ros/parameter_tree.h>

namespace pi_detect
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(TrackerRosOptions& options, Visitor&& visit)
{
  visitTrackerFields(options.tracker, visit);
  visit("rectified", options.rectified);
  visit("always_on", options.always_on);
  visit("warning_period_s", options.warning_period_s);
}

void TrackerRosOptions::validate() const
{
  parameter_tree::validateGroup("tracker", tracker);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_detect

template struct pi_node::NodeParameters<pi_detect::TrackerRosOptions>;
