#include "ros/navigation/kept_goal.h"

#include <pi_node/ros/parameter_values.h>

#include <cmath>
#include <stdexcept>

namespace pi_vehicle
{

using XmlRpc::XmlRpcValue;
namespace parameters = pi_node::parameters;

static Waypoint toPoint(const XmlRpcValue& value)
{
  parameters::requireType(value, XmlRpcValue::TypeArray, "a list");
  double numbers[3] = {0.0, 0.0, 0.0};
  if (value.size() != 2 && value.size() != 3)
  {
    throw std::invalid_argument("a point has " + std::to_string(value.size()) + " numbers, must have 2 or 3");
  }
  for (int i = 0; i < value.size(); ++i)
  {
    parameters::read(value[i], &numbers[i]);
  }
  Waypoint point;
  point.position = {numbers[0], numbers[1]};
  if (value.size() == 3)
  {
    point.heading = numbers[2];
  }
  return point;
}

XmlRpcValue toParameter(const KeptGoal& kept)
{
  XmlRpcValue value;
  value["points"].setSize(0);
  for (size_t i = 0; i < kept.goal.waypoints.size(); ++i)
  {
    const Waypoint& point = kept.goal.waypoints[i];
    XmlRpcValue& one = value["points"][static_cast<int>(i)];
    one[0] = point.position.x();
    one[1] = point.position.y();
    if (point.heading)
    {
      one[2] = *point.heading;
    }
  }
  value["max_speed"] = kept.goal.max_speed;
  value["loop"] = kept.goal.loop;
  value["id"] = kept.id;
  value["stamp"] = kept.stamp.toSec();
  value["alive"] = kept.alive;
  return value;
}

std::optional<KeptGoal> toKeptGoal(const XmlRpcValue& value, const std::string& name)
{
  if (value.getType() == XmlRpcValue::TypeString && static_cast<const std::string&>(value).empty())
  {
    return std::nullopt;
  }
  try
  {
    parameters::requireType(value, XmlRpcValue::TypeStruct, "a map");
    for (const char* member : {"points", "max_speed", "loop", "id", "stamp", "alive"})
    {
      if (!value.hasMember(member))
      {
        throw std::invalid_argument(std::string("it has no ") + member);
      }
    }
    KeptGoal kept;
    const XmlRpcValue& points = value["points"];
    parameters::requireType(points, XmlRpcValue::TypeArray, "a list");
    for (int i = 0; i < points.size(); ++i)
    {
      kept.goal.waypoints.push_back(toPoint(points[i]));
    }
    double stamp = 0.0;
    parameters::read(value["max_speed"], &kept.goal.max_speed);
    parameters::read(value["loop"], &kept.goal.loop);
    parameters::read(value["id"], &kept.id);
    parameters::read(value["stamp"], &stamp);
    parameters::read(value["alive"], &kept.alive);
    if (!(stamp >= 0.0 && stamp < 4e9))  // what ros::Time holds
    {
      throw std::invalid_argument("its stamp is none");
    }
    kept.stamp.fromSec(stamp);
    return kept;
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument("parameter " + name + " = " + parameters::text(value) + ": " + error.what() +
                                "; must be what this node left there: delete it");
  }
}

}  // namespace pi_vehicle
