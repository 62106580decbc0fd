#include "ros/power_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

#include <stdexcept>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;
namespace parameters = pi_node::parameters;
using power::ServiceDescription;
using XmlRpc::XmlRpcValue;

namespace
{

ServiceDescription serviceOf(XmlRpcValue value)
{
  parameters::requireType(value, XmlRpcValue::TypeStruct, "a map with name, nodes, threads and optional");
  ServiceDescription service;
  for (auto& [name, member] : value)
  {
    try
    {
      if (name == "name")
      {
        parameters::read(member, &service.name);
      }
      else if (name == "optional")
      {
        parameters::read(member, &service.optional);
      }
      else if (name == "nodes" || name == "threads")
      {
        parameter_tree::read(member, name == "nodes" ? &service.nodes : &service.threads);
      }
      else
      {
        throw std::invalid_argument("means nothing here; there are name, nodes, threads and optional");
      }
    }
    catch (const std::invalid_argument& error)
    {
      throw std::invalid_argument(name + " " + error.what());
    }
  }
  service.validate();
  return service;
}

}  // namespace

namespace power  // where they are found by the type of the field
{

static void read(XmlRpcValue value, std::vector<ServiceDescription>* field)
{
  parameters::requireType(value, XmlRpcValue::TypeArray, "a list of maps with name, nodes, threads and optional");
  field->clear();
  for (int i = 0; i < value.size(); ++i)
  {
    try
    {
      field->push_back(serviceOf(value[i]));
    }
    catch (const std::invalid_argument& error)
    {
      throw std::invalid_argument("entry " + std::to_string(i + 1) + ": " + error.what());
    }
  }
}

static XmlRpcValue write(const std::vector<ServiceDescription>& field)
{
  XmlRpcValue value;
  value.setSize(static_cast<int>(field.size()));
  for (size_t i = 0; i < field.size(); ++i)
  {
    XmlRpcValue& entry = value[static_cast<int>(i)];
    entry["name"] = field[i].name;
    entry["nodes"] = parameter_tree::write(field[i].nodes);
    entry["threads"] = parameter_tree::write(field[i].threads);
    entry["optional"] = parameters::write(field[i].optional);
  }
  return value;
}

}  // namespace power

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(PowerRosOptions& options, Visitor&& visit)
{
  visit("services", options.services);
  visit("period_s", options.period_s);
  visit("memory_period_s", options.memory_period_s);
  visit("lookup_period_s", options.lookup_period_s);
  visit("lookup_timeout_s", options.lookup_timeout_s);
  visit("sensors", options.sensors);
  visit("model/idle_w", options.model.idle_w);
  visit("model/board_w", options.model.board_w);
  visit("model/beta_w_per_ghz3", options.model.beta_w_per_ghz3);
  visit("model/frequency_ghz", options.model.frequency_ghz);
  visit("publish_battery", options.publish_battery);
  auto& battery = options.battery;
  visit("battery/capacity_ah", battery.capacity_ah);
  visit("battery/nominal_voltage", battery.nominal_voltage);
  visit("battery/smoothing_s", battery.smoothing_s);
  visit("battery/low_charge", battery.low_charge);
  visit("battery/empty_charge", battery.empty_charge);
  visit("battery/low_remaining_s", battery.low_remaining_s);
  visit("vehicle_state_timeout_s", options.vehicle_state_timeout_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void PowerRosOptions::validate() const
{
  try
  {
    power::validateServices(services);
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(std::string("services: ") + error.what());
  }
  const pi_node::OptionCheck check("");
  check.range("period_s", period_s, 0.1, 60.0);
  check.range("lookup_timeout_s", lookup_timeout_s, 0.05, 60.0);
  parameter_tree::requireDuration("memory_period_s", memory_period_s);
  parameter_tree::requireDuration("lookup_period_s", lookup_period_s);
  model.validate();
  battery.validate();
  parameter_tree::requireDuration("vehicle_state_timeout_s", vehicle_state_timeout_s);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::PowerRosOptions>;
