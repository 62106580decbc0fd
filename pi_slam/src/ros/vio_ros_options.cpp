#include <pi_node/ros/parameter_values.h>
#include "ros/vio_ros_options.h"
#include "odometry/vio_options_yaml.h"

#include <map>
#include <set>
#include <stdexcept>
#include <variant>

namespace pi_slam
{
namespace
{

using pi_node::parameters::flatten;
using pi_node::parameters::read;
using pi_node::parameters::require;
using pi_node::parameters::requireType;
using pi_node::parameters::text;
using pi_node::parameters::write;
using XmlRpc::XmlRpcValue;

constexpr double MAX_DURATION_S = 3600.0;
constexpr double MAX_TF_RATE_HZ = 4000.0;

/// Every parameter that is not of the core, by the path of its name, with its field.
template <typename Options, typename Visitor>
void visitFields(Options& options, Visitor&& visit)
{
  auto& calibration = options.calibration;
  visit("calibration/source", calibration.source);
  visit("calibration/camchain", calibration.camchain);
  visit("calibration/imu_yaml", calibration.imu_yaml);
  visit("calibration/euroc_folder", calibration.euroc_folder);
  visit("calibration/rectified", calibration.rectified);
  visit("calibration/imu_in_base", calibration.imu_in_base);
  visit("calibration/left_in_imu", calibration.left_in_imu);
  visit("map_frame", options.map_frame);
  visit("odom_frame", options.odom_frame);
  visit("base_link_frame", options.base_link_frame);
  visit("publish_tf", options.publish_tf);
  visit("publish_map_tf", options.publish_map_tf);
  visit("tf_rate_hz", options.tf_rate_hz);
  visit("mapping", options.mapping);
  visit("map_file", options.map_file);
  visit("zero_copy", options.zero_copy);
  visit("queue_size", options.queue_size);
  visit("imu_queue_size", options.imu_queue_size);
  visit("pair_tolerance_s", options.pair_tolerance_s);
  visit("pair_wait_s", options.pair_wait_s);
  visit("imu_wait_s", options.imu_wait_s);
  visit("time_jump_s", options.time_jump_s);
  visit("input_timeout_s", options.input_timeout_s);
  visit("max_delay_s", options.max_delay_s);
  visit("path_spacing_m", options.path_spacing_m);
  visit("path_length", options.path_length);
  visit("path_period_s", options.path_period_s);
  visit("points_period_s", options.points_period_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void read(XmlRpcValue value, std::vector<double>* field)
{
  requireType(value, XmlRpcValue::TypeArray, "a list of numbers");
  field->assign(static_cast<size_t>(value.size()), 0.0);
  for (int i = 0; i < value.size(); ++i)
  {
    read(value[i], &(*field)[static_cast<size_t>(i)]);
  }
}

void read(XmlRpcValue value, CalibrationSource* field)
{
  std::string name;
  read(value, &name);
  try
  {
    *field = parseCalibrationSource(name);
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(std::string("= ") + error.what());
  }
}

XmlRpcValue write(const std::vector<double>& field)
{
  XmlRpcValue value;
  value.setSize(static_cast<int>(field.size()));
  for (size_t i = 0; i < field.size(); ++i)
  {
    value[static_cast<int>(i)] = field[i];
  }
  return value;
}
XmlRpcValue write(CalibrationSource field)
{
  return XmlRpcValue(toString(field));
}

void requireDuration(const char* name, double value)
{
  require(value > 0.0 && value <= MAX_DURATION_S, name, value, "in (0, 3600]");
}

void requireFrame(const char* name, const std::string& frame)
{
  require(!frame.empty() && frame.front() != '/', name, "\"" + frame + "\"", "a frame name without leading /");
}

}  // namespace

void VioRosOptions::validate() const
{
  vio.validate();
  mapper.validate();
  calibration.validate();
  requireFrame("map_frame", map_frame);
  requireFrame("odom_frame", odom_frame);
  requireFrame("base_link_frame", base_link_frame);
  require(std::set<std::string>{map_frame, odom_frame, base_link_frame}.size() == 3, "odom_frame",
          "\"" + odom_frame + "\"", "another frame than map_frame and base_link_frame, which differ too");
  require(tf_rate_hz >= 0.0 && tf_rate_hz <= MAX_TF_RATE_HZ, "tf_rate_hz", tf_rate_hz, "in [0, 4000]");
  require(mapping || map_file.empty(), "map_file", "\"" + map_file + "\"", "empty with mapping = false");
  require(queue_size >= 1 && queue_size <= 1000, "queue_size", queue_size, "in [1, 1000]");
  require(imu_queue_size >= 1 && imu_queue_size <= 100000, "imu_queue_size", imu_queue_size, "in [1, 100000]");
  require(pair_tolerance_s >= 0.0 && pair_tolerance_s <= 0.1, "pair_tolerance_s", pair_tolerance_s, "in [0, 0.1]");
  require(pair_wait_s > pair_tolerance_s && pair_wait_s <= 2.0, "pair_wait_s", pair_wait_s,
          "above pair_tolerance_s, up to 2");
  require(imu_wait_s >= 0.0 && imu_wait_s <= 10.0, "imu_wait_s", imu_wait_s, "in [0, 10]");
  require(time_jump_s >= 0.01 && time_jump_s <= MAX_DURATION_S, "time_jump_s", time_jump_s, "in [0.01, 3600]");
  requireDuration("input_timeout_s", input_timeout_s);
  requireDuration("max_delay_s", max_delay_s);
  require(path_spacing_m >= 0.0 && path_spacing_m <= 100.0, "path_spacing_m", path_spacing_m, "in [0, 100]");
  require(path_length >= 2 && path_length <= 1000000, "path_length", path_length, "in [2, 1000000]");
  requireDuration("path_period_s", path_period_s);
  requireDuration("points_period_s", points_period_s);
  requireDuration("diagnostic_period", diagnostic_period);
  requireDuration("warning_period_s", warning_period_s);
}

VioRosOptions VioRosOptions::load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown)
{
  XmlRpcValue tree;
  const std::string& path = private_node.getNamespace();
  private_node.getParam(path, tree);
  return fromParameters(tree, path + "/", unknown);
}

VioRosOptions VioRosOptions::fromParameters(const XmlRpcValue& tree, const std::string& path,
                                            std::vector<std::string>* unknown)
{
  VioRosOptions options;
  std::map<std::string, XmlRpcValue> leaves;
  if (tree.getType() == XmlRpcValue::TypeStruct)
  {
    flatten(tree, "", &leaves);
  }
  const auto load = [&leaves, &path](const std::string& name, auto& field)
  {
    const auto leaf = leaves.find(name);
    if (leaf == leaves.end())
    {
      return;
    }
    try
    {
      read(leaf->second, &field);
    }
    catch (const std::invalid_argument& error)
    {
      throw std::invalid_argument("parameter " + path + name + " " + error.what());
    }
    leaves.erase(leaf);
  };
  for (const OptionField& core_field : optionFields(&options.vio, &options.mapper))
  {
    std::visit([&load, &core_field](auto* field) { load(core_field.key, *field); }, core_field.value);
  }
  visitFields(options, load);
  try
  {
    options.validate();
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument("parameter " + path + error.what());
  }
  for (const auto& [name, value] : leaves)
  {
    unknown->push_back(path + name);
  }
  return options;
}

XmlRpcValue VioRosOptions::toParameters() const
{
  XmlRpcValue tree;
  const auto add = [&tree](const std::string& name, const auto& field)
  {
    const size_t slash = name.find('/');
    (slash == std::string::npos ? tree[name] : tree[name.substr(0, slash)][name.substr(slash + 1)]) = write(field);
  };
  VioRosOptions copy = *this;  // optionFields() gives fields that can be written to
  for (const OptionField& core_field : optionFields(&copy.vio, &copy.mapper))
  {
    std::visit([&add, &core_field](const auto* field) { add(core_field.key, *field); }, core_field.value);
  }
  visitFields(*this, add);
  return tree;
}

std::string VioRosOptions::toText() const
{
  return text(toParameters());
}

}  // namespace pi_slam
