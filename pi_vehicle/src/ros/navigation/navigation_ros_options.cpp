#include "ros/navigation/navigation_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

#include <cmath>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;
using XmlRpc::XmlRpcValue;

constexpr double MAX_COORDINATE = 1e5;  // [m]

/// A place is [x, y] or [x, y, heading]; found by the type of the field.
static void take(const std::string& name, std::map<std::string, XmlRpcValue>* leaves, Places* places)
{
  if (const auto leaf = leaves->find(name); leaf != leaves->end())
  {
    throw std::invalid_argument(name + " = " + pi_node::parameters::text(leaf->second) +
                                ", must be a map of names to [x, y] or [x, y, heading]");
  }
  const std::string prefix = name + "/";
  for (auto leaf = leaves->lower_bound(prefix); leaf != leaves->end() && leaf->first.rfind(prefix, 0) == 0;
       leaf = leaves->erase(leaf))
  {
    XmlRpcValue& value = leaf->second;
    std::vector<double> numbers;
    try
    {
      pi_node::parameters::requireType(value, XmlRpcValue::TypeArray, "a list");
      for (int i = 0; i < value.size(); ++i)
      {
        numbers.emplace_back();
        pi_node::parameters::read(value[i], &numbers.back());
      }
    }
    catch (const std::invalid_argument&)
    {
      numbers.clear();
    }
    bool good = numbers.size() == 2 || numbers.size() == 3;
    for (const double number : numbers)
    {
      good = good && std::abs(number) <= MAX_COORDINATE;
    }
    if (!good)
    {
      throw std::invalid_argument(leaf->first + " = " + pi_node::parameters::text(value) +
                                  ", must be [x, y] or [x, y, heading], in m and rad");
    }
    Waypoint place;
    place.position = {numbers[0], numbers[1]};
    if (numbers.size() == 3)
    {
      place.heading = numbers[2];
    }
    (*places)[leaf->first.substr(prefix.size())] = place;
  }
}

static XmlRpcValue write(const Places& places)
{
  XmlRpcValue value;
  value.begin();  // a struct, also without members
  for (const auto& [name, place] : places)
  {
    XmlRpcValue& one = value[name];
    one[0] = place.position.x();
    one[1] = place.position.y();
    if (place.heading)
    {
      one[2] = *place.heading;
    }
  }
  return value;
}

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(NavigationRosOptions& options, Visitor&& visit)
{
  const auto group = [&visit](const std::string& name, auto& part)
  { visitFields(part, [&](const char* field, auto& value) { visit((name + "/" + field).c_str(), value); }); };
  auto& navigator = options.navigator;
  visit("rate_hz", options.rate_hz);
  visit("map_frame", options.map_frame);
  visit("base_link_frame", options.base_link_frame);
  visit("tf_timeout_s", options.tf_timeout_s);
  visit("max_position_deviation", navigator.max_position_deviation);
  visit("need_obstacles", navigator.need_obstacles);
  visit("vehicle_timeout_s", navigator.vehicle_timeout_s);
  visit("blocked_after_s", navigator.blocked_after_s);
  visit("max_route_length", navigator.max_route_length);
  visit("places", options.places);
  visit("resume_goal_within_s", options.resume_goal_within_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
  group("route", navigator.route);
  group("follower", navigator.follower);
  group("governor", navigator.governor);
  group("passing", navigator.passing);
}

void NavigationRosOptions::validate() const
{
  navigator.validate();
  pi_node::OptionCheck("").range("rate_hz", rate_hz, 10.0, 100.0);
  pi_node::parameters::require(!map_frame.empty(), "map_frame", "\"\"", "a name");
  pi_node::parameters::require(!base_link_frame.empty() && base_link_frame != map_frame, "base_link_frame",
                               "\"" + base_link_frame + "\"", "a name other than map_frame");
  parameter_tree::requireDuration("tf_timeout_s", tf_timeout_s);
  pi_node::OptionCheck("").range("resume_goal_within_s", resume_goal_within_s, 0.0, 3600.0);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::NavigationRosOptions>;
