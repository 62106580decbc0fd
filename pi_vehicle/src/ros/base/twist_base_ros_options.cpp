#include "ros/base/twist_base_ros_options.h"

#include <pi_node/ros/parameter_tree.h>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(TwistBaseRosOptions& options, Visitor&& visit)
{
  auto& base = options.base;
  visit("command_period_s", base.command_period_s);
  visit("odometry_timeout_s", base.odometry_timeout_s);
  visit("motion_timeout_s", base.motion_timeout_s);
  visit("stop_deceleration", base.stop_deceleration);
  visit("steering_angle", base.steering_angle);
  visitFields(options.wheels, visit);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void TwistBaseRosOptions::validate() const
{
  base.validate();
  wheels.validate();
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::TwistBaseRosOptions>;
