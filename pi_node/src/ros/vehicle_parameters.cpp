#include "pi_node/ros/vehicle_parameters.h"

#include "pi_node/ros/parameter_tree.h"

#include <ros/console.h>

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_node
{

using XmlRpc::XmlRpcValue;

static void read(const XmlRpcValue& value, VehicleKind* kind)
{
  parameters::readChoice(value, {VehicleKind::ACKERMANN, VehicleKind::DIFFERENTIAL}, kind);
}

static void read(const XmlRpcValue& value, Mount* mount)
{
  std::vector<double> numbers;
  try
  {
    parameters::read(value, &numbers);
  }
  catch (const std::invalid_argument&)
  {
    numbers.clear();
  }
  if (numbers.size() != 6)
  {
    throw std::invalid_argument("= " + parameters::text(value) + ", must be [x, y, z, roll, pitch, yaw]");
  }
  *mount = {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5]};
}

static XmlRpcValue write(const Mount& mount)
{
  return parameters::write(std::vector<double>{mount.x, mount.y, mount.z, mount.roll, mount.pitch, mount.yaw});
}

/// Every parameter but the mounts by the path of its name, with its field.
template <typename Visitor>
static void visitFields(VehicleDescription& vehicle, Visitor&& visit)
{
  visit("name", vehicle.name);
  visit("kind", vehicle.kind);
  visit("wheelbase", vehicle.wheelbase);
  visit("track", vehicle.track);
  visit("wheels/radius", vehicle.wheel_radius);
  visit("wheels/width", vehicle.wheel_width);
  visit("footprint/front", vehicle.footprint.front);
  visit("footprint/rear", vehicle.footprint.rear);
  visit("footprint/half_width", vehicle.footprint.half_width);
  visit("footprint/height", vehicle.footprint.height);
  visit("limits/speed", vehicle.limits.speed);
  visit("limits/reverse_speed", vehicle.limits.reverse_speed);
  visit("limits/acceleration", vehicle.limits.acceleration);
  visit("limits/deceleration", vehicle.limits.deceleration);
  visit("limits/emergency_deceleration", vehicle.limits.emergency_deceleration);
  visit("limits/curvature", vehicle.limits.curvature);
  visit("limits/curvature_rate", vehicle.limits.curvature_rate);
  visit("limits/lateral_acceleration", vehicle.limits.lateral_acceleration);
  visit("pictures/width", vehicle.picture_width);
  visit("pictures/height", vehicle.picture_height);
}

/// @throws std::invalid_argument whose text follows the path.
static VehicleDescription fromLeaves(std::map<std::string, XmlRpcValue> leaves)
{
  VehicleDescription vehicle;
  const auto take = [&leaves](const std::string& name, auto& field)
  {
    if (leaves.count(name) == 0)
    {
      throw std::invalid_argument(name + " is missing");
    }
    parameter_tree::take(name, &leaves, &field);
  };
  visitFields(vehicle, take);
  vehicle.mounts.clear();
  const std::string mounts = "mounts/";
  while (!leaves.empty())
  {
    const std::string name = leaves.begin()->first;
    const std::string frame = name.substr(std::min(name.size(), mounts.size()));
    if (name.rfind(mounts, 0) != 0 || frame.find('/') != std::string::npos)
    {
      throw std::invalid_argument(name + " means nothing here");
    }
    take(name, vehicle.mounts[frame]);
  }
  vehicle.validate();
  return vehicle;
}

VehicleDescription vehicleFromParameters(const XmlRpcValue& tree, const std::string& path)
{
  std::map<std::string, XmlRpcValue> leaves;
  if (tree.getType() != XmlRpcValue::TypeStruct)
  {
    throw std::invalid_argument("parameter " + path + " = " + parameters::text(tree) +
                                ", must be a map as in config/vehicle.yaml of pi_node");
  }
  parameters::flatten(tree, "", &leaves);
  try
  {
    return fromLeaves(std::move(leaves));
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument("parameter " + path + "/" + error.what());
  }
}

VehicleDescription loadVehicle(const ros::NodeHandle& private_node)
{
  std::string path;
  XmlRpcValue tree;
  if (!private_node.searchParam("vehicle", path) || !private_node.getParam(path, tree))
  {
    throw std::invalid_argument("parameter vehicle is neither in " + private_node.getNamespace() +
                                " nor above: rosparam load VEHICLE.yaml vehicle, as config/vehicle.yaml of pi_node");
  }
  const VehicleDescription vehicle = vehicleFromParameters(tree, path);
  ROS_INFO_STREAM_NAMED("vehicle", "vehicle " << vehicle.name << " of parameter " << path);
  return vehicle;
}

XmlRpcValue toParameters(const VehicleDescription& vehicle)
{
  XmlRpcValue tree = parameter_tree::save(vehicle);
  for (const auto& [frame, mount] : vehicle.mounts)
  {
    tree["mounts"][frame] = write(mount);
  }
  return tree;
}

}  // namespace pi_node
