#include "ros/base/chassis_ros_options.h"

#include <pi_node/ros/parameter_tree.h>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(ChassisRosOptions& options, Visitor&& visit)
{
  auto& driver = options.driver;
  visit("port", driver.port);
  visit("baud_rate", driver.baud_rate);
  visit("start_patience_s", driver.start_patience_s);
  visit("first_pause_s", driver.first_pause_s);
  visit("longest_pause_s", driver.longest_pause_s);
  visit("command_period_s", driver.host.command_period_s);
  visit("status_timeout_s", driver.host.status_timeout_s);
  visit("motion_timeout_s", driver.host.motion_timeout_s);
  visit("stop_deceleration", driver.host.stop_deceleration);
  visitFields(options.wheels, visit);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void ChassisRosOptions::validate() const
{
  driver.validate();
  wheels.validate();
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::ChassisRosOptions>;
