#include "ros/recorder/recorder_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>
#include <ros/names.h>

#include <algorithm>
#include <stdexcept>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(RecorderRosOptions& options, Visitor&& visit)
{
  visit("folder", options.folder);
  visit("memory_mb", options.memory_mb);
  visit("before_s", options.before_s);
  visit("after_s", options.after_s);
  visit("longest_s", options.longest_s);
  visit("incidents_budget_mb", options.incidents_budget_mb);
  visit("min_free_mb", options.min_free_mb);
  visit("topics", options.topics);
  visit("pictures", options.pictures);
  visit("picture_rate_hz", options.picture_rate_hz);
  visit("jpeg_quality", options.jpeg_quality);
  visit("slim/topics", options.slim.topics);
  visit("slim/thinned_topics", options.slim.thinned_topics);
  visit("slim/thinned_hz", options.slim.thinned_hz);
  visit("slim/file_s", options.slim.file_s);
  visit("slim/budget_mb", options.slim.budget_mb);
  visit("braking_deceleration", options.braking_deceleration);
  visit("take_over_sources", options.take_over_sources);
  visit("collision_topic", options.collision_topic);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

static void requireTopics(const char* field, const std::vector<std::string>& topics)
{
  for (const std::string& topic : topics)
  {
    std::string problem;
    if (topic.empty() || !ros::names::validate(topic, problem))
    {
      throw std::invalid_argument(std::string(field) + " = \"" + topic +
                                  "\", must be names of topics: " + (topic.empty() ? "one is empty" : problem));
    }
  }
}

void RecorderRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  if (folder.empty())
  {
    throw std::invalid_argument("folder = \"\", must be a path");
  }
  check.range("memory_mb", memory_mb, 1, 4000);
  parameter_tree::requireDuration("before_s", before_s);
  parameter_tree::requireDuration("after_s", after_s);
  check.range("longest_s", longest_s, before_s + after_s, parameter_tree::MAX_DURATION_S);
  check.range("incidents_budget_mb", incidents_budget_mb, 1, 1000000);
  check.range("min_free_mb", min_free_mb, 0, 1000000);
  requireTopics("topics", topics);
  requireTopics("pictures", pictures);
  check.range("picture_rate_hz", picture_rate_hz, 0.01, 60.0);
  check.range("jpeg_quality", jpeg_quality, 1, 100);
  requireTopics("slim/topics", slim.topics);
  requireTopics("slim/thinned_topics", slim.thinned_topics);
  for (const std::string& topic : slim.thinned_topics)
  {
    if (std::count(slim.topics.begin(), slim.topics.end(), topic) == 0)
    {
      throw std::invalid_argument("slim/thinned_topics = \"" + topic + "\", must be in slim/topics");
    }
  }
  check.range("slim/thinned_hz", slim.thinned_hz, 0.01, 1000.0);
  parameter_tree::requireDuration("slim/file_s", slim.file_s);
  check.range("slim/budget_mb", slim.budget_mb, 1, 1000000);
  check.positive("braking_deceleration", braking_deceleration);
  requireTopics("collision_topic", {collision_topic});
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::RecorderRosOptions>;
