#include "ros/pose_keeper_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(PoseKeeperRosOptions& options, Visitor&& visit)
{
  auto& keeper = options.keeper;
  visit("map_frame", options.map_frame);
  visit("base_link_frame", options.base_link_frame);
  visit("file", options.file);
  visit("resume", options.resume);
  visit("max_file_age_s", options.max_file_age_s);
  visit("silence_s", keeper.silence_s);
  visit("jump_distance", keeper.jump_distance);
  visit("jump_heading", keeper.jump_heading);
  visit("jump_per_m", keeper.jump_per_m);
  visit("agreement", keeper.agreement);
  visit("agreement_heading", keeper.agreement_heading);
  visit("retry_s", keeper.retry_s);
  visit("max_position_deviation", keeper.max_position_deviation);
  visit("position_deviation", keeper.position_deviation);
  visit("heading_deviation", keeper.heading_deviation);
  visit("distance_error", keeper.distance_error);
  visit("heading_error", keeper.heading_error);
  visit("wheel_timeout_s", keeper.wheel_timeout_s);
  visit("wheel_disagreement", keeper.wheel_disagreement);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void PoseKeeperRosOptions::validate() const
{
  keeper.validate();
  pi_node::parameters::require(!map_frame.empty(), "map_frame", "\"\"", "a name");
  pi_node::parameters::require(!base_link_frame.empty() && base_link_frame != map_frame, "base_link_frame",
                               "\"" + base_link_frame + "\"", "a name other than map_frame");
  pi_node::parameters::require(file.empty() || file.front() == '/', "file", "\"" + file + "\"",
                               "an absolute path, or empty");
  pi_node::parameters::require(!resume || !file.empty(), "resume", "true", "false without a file");
  pi_node::OptionCheck("").range("max_file_age_s", max_file_age_s, 1.0, 1e9);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::PoseKeeperRosOptions>;
