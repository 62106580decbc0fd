#include "ros/decision_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>
#include <ros/package.h>

#include <stdexcept>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

// Every parameter by its name, with its field.

template <typename Visitor>
static void visitFields(ArbiterRosOptions& options, Visitor&& visit)
{
  visit("sources_file", options.sources_file);
  visit("rate", options.rate);
  visit("vehicle_state_timeout", options.vehicle_state_timeout);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

template <typename Visitor>
static void visitFields(CommandRosOptions& options, Visitor&& visit)
{
  visit("actions_file", options.actions_file);
  visit("rate", options.rate);
  visit("stop_deceleration", options.stop_deceleration);
  visit("stopped_at_start", options.stopped_at_start);
  visit("question", options.question);
  visit("doubt_question", options.doubt_question);
  visit("map_frame", options.map_frame);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

template <typename Visitor>
static void visitFields(ReactionRosOptions& options, Visitor&& visit)
{
  visit("rules_file", options.rules_file);
  visit("rate", options.rate);
  visit("need_obstacles", options.need_obstacles);
  visit("obstacles_timeout", options.obstacles_timeout);
  visit("max_unseen", options.max_unseen);
  visit("stop_deceleration", options.stop_deceleration);
  visit("slow_deceleration", options.slow_deceleration);
  visit("greeting", options.greeting);
  visit("base_link_frame", options.base_link_frame);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

static void requireFile(const char* name, const std::string& file)
{
  pi_node::parameters::require(!file.empty() && (file[0] == '/' || file.find('/') == std::string::npos), name,
                               "\"" + file + "\"",
                               "an absolute path, or the name of a file in the folder config of pi_vehicle");
}

static void requireFrame(const char* name, const std::string& frame)
{
  pi_node::parameters::require(!frame.empty(), name, "\"\"", "a name");
}

void ArbiterRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  requireFile("sources_file", sources_file);
  check.range("rate", rate, 20.0, 100.0);
  check.range("vehicle_state_timeout", vehicle_state_timeout, 0.02, 10.0);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

void CommandRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  requireFile("actions_file", actions_file);
  check.range("rate", rate, 5.0, 100.0);
  check.range("stop_deceleration", stop_deceleration, 0.0, 20.0);
  requireFrame("map_frame", map_frame);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

void ReactionRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  requireFile("rules_file", rules_file);
  check.range("rate", rate, 5.0, 100.0);
  check.range("obstacles_timeout", obstacles_timeout, 0.05, 60.0);
  check.range("max_unseen", max_unseen, 0.0, 60.0);
  check.range("stop_deceleration", stop_deceleration, 0.0, 20.0);
  check.range("slow_deceleration", slow_deceleration, 0.0, 20.0);
  requireFrame("base_link_frame", base_link_frame);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

std::string configPath(const std::string& parameter, const std::string& file)
{
  requireFile(parameter.c_str(), file);
  if (file[0] == '/')
  {
    return file;
  }
  const std::string package = ros::package::getPath("pi_vehicle");
  if (package.empty())
  {
    throw std::invalid_argument(parameter + " = " + file +
                                ", but package pi_vehicle is not found; source setup.sh, or give an absolute path");
  }
  return package + "/config/" + file;
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::ArbiterRosOptions>;
template struct pi_node::NodeParameters<pi_vehicle::CommandRosOptions>;
template struct pi_node::NodeParameters<pi_vehicle::ReactionRosOptions>;
