#include "ros/power_ros.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/vehicle_clock.h>
#include <ros/network.h>
#include <sensor_msgs/BatteryState.h>

#include <cmath>
#include <limits>
#include <set>
#include <utility>
#include <vector>

namespace pi_vehicle
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;
using pi_node::monotonicNs;
using sensor_msgs::BatteryState;

constexpr double NOT_MEASURED = std::numeric_limits<double>::quiet_NaN();

/// Names of nodes become full ones.
PowerRosOptions loadOptions(const ros::NodeHandle& node, const ros::NodeHandle& private_node)
{
  auto options = pi_node::loadNodeOptions<PowerRosOptions>(private_node, "power");
  for (power::ServiceDescription& service : options.services)
  {
    for (std::string& name : service.nodes)
    {
      name = ros::names::resolve(node.getNamespace(), name);
    }
  }
  return options;
}

std::vector<std::string> nodesOf(const std::vector<power::ServiceDescription>& services)
{
  std::set<std::string> nodes;
  for (const power::ServiceDescription& service : services)
  {
    nodes.insert(service.nodes.begin(), service.nodes.end());
  }
  return {nodes.begin(), nodes.end()};
}

ServicePower toMsg(const power::ServiceUse& use, double watts)
{
  ServicePower message;
  message.name = use.name;
  message.running = use.running;
  message.nodes = use.nodes;
  message.cpu = use.cores;
  message.memory = use.memory;
  message.watts = watts;
  return message;
}

std::string hours(double seconds)
{
  return std::isfinite(seconds) ? format("%.1f h", seconds / 3600.0) : "unknown";
}

std::string join(const std::vector<std::string>& words)
{
  std::string text;
  for (const std::string& word : words)
  {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

}  // namespace

PowerRos::PowerRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("power")
  , node_(thread_.handle(node))
  , options_(loadOptions(node, private_node))
  , warnings_(options_.warning_period_s, pi_node::warningLog<PowerRosOptions>("power"))
  , updater_(node_, private_node, private_node.getNamespace())
  , meter_(options_.services, power::ProcessFiles(), options_.memory_period_s)
  , estimator_(options_.battery)
{
  power_publisher_ = node_.advertise<PowerState>("power", 10);
  if (options_.publish_battery)
  {
    battery_publisher_ = node_.advertise<BatteryState>("battery", 1, true);
  }
  updater_.setHardwareID(ros::network::getHost());
  updater_.add("services", [this](Status& status) { reportServices(status); });
  updater_.add("power", [this](Status& status) { reportPower(status); });
  updater_.add("battery", [this](Status& status) { reportBattery(status); });
  for (const pi_node::PowerMonitor::Unreadable& sensor : monitor_.unreadable())
  {
    ROS_WARN_STREAM_NAMED("power", sensor.path << ": " << sensor.reason
                                               << "; let the user of this node read it, else watts are modelled");
  }
  finder_ = std::make_unique<NodeFinder>(nodesOf(options_.services),
                                         NodeFinder::Options{options_.lookup_period_s, options_.lookup_timeout_s});
  vehicle_state_ = node_.subscribe("vehicle_state", 1, &PowerRos::onVehicleState, this);
  measure();
  measure_timer_ =
      node_.createWallTimer(ros::WallDuration(options_.period_s), [this](const ros::WallTimerEvent&) { measure(); });
  diagnostic_timer_ = node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                            [this](const ros::WallTimerEvent&) { updater_.force_update(); });
  thread_.start();
}

PowerRos::~PowerRos()
{
  thread_.stop();
}

void PowerRos::onVehicleState(const VehicleState& message)
{
  vehicle_ = message;
  vehicle_ns_ = pi_node::vehicleNs();
}

void PowerRos::measure()
{
  const int64_t now_ns = monotonicNs();
  found_ = finder_->found();
  use_ = meter_.update(now_ns, found_.pids);
  const pi_node::PowerReading reading = monitor_.read(now_ns);
  account_ = power::accountPower(use_, reading, options_.model, options_.sensors);
  if (use_.period_s <= 0.0)
  {
    return;  // the first call only begins
  }
  if (!options_.sensors.empty() && !account_.measured)
  {
    warnings_.warn("sensors = [" + join(options_.sensors) +
                   "], must be names of power sensors that can be read here; the watts are modelled");
  }
  battery_ = batteryNow(reading);
  estimate_ = estimator_.update(now_ns, battery_, account_.total);
  const ros::Time stamp = ros::Time::now();
  publishPower(stamp);
  if (options_.publish_battery)
  {
    publishBattery(stamp);
  }
}

power::BatteryReading PowerRos::batteryNow(const pi_node::PowerReading& reading)
{
  power::BatteryReading battery;
  const bool vehicle = vehicle_ && vehicle_->mode != VehicleState::DISCONNECTED &&
                       pi_node::seconds(pi_node::vehicleNs() - vehicle_ns_) <= options_.vehicle_state_timeout_s;
  if (vehicle && std::isfinite(vehicle_->battery_charge))
  {
    battery_source_ = vehicle_state_.getTopic();
    battery.voltage = vehicle_->battery_voltage;
    battery.current = vehicle_->battery_current;
    battery.charge = vehicle_->battery_charge;
    return battery;
  }
  battery_source_.clear();
  for (const pi_node::PowerReading::Battery& own : reading.batteries)
  {
    if (std::isfinite(own.charge))
    {
      battery_source_ = own.name;
      battery.charge = own.charge;
      battery.voltage = options_.battery.nominal_voltage;
      battery.current = -own.watts / options_.battery.nominal_voltage;
      break;
    }
  }
  return battery;
}

void PowerRos::publishPower(const ros::Time& stamp)
{
  PowerState message;
  message.header.stamp = stamp;
  for (size_t i = 0; i < use_.services.size(); ++i)
  {
    message.services.push_back(toMsg(use_.services[i], account_.services[i]));
  }
  message.shared = toMsg(use_.shared, account_.shared);
  message.other = toMsg(use_.other, account_.other);
  message.cpu = use_.busy_cores;
  message.cores = use_.cores;
  message.total_watts = account_.total;
  message.idle_watts = account_.idle;
  message.measured = account_.measured;
  message.source = account_.source;
  message.battery_charge = battery_.charge;
  message.battery_watts = estimate_.draw_w;
  message.remaining_time = estimate_.remaining_s;
  power_publisher_.publish(message);
}

void PowerRos::publishBattery(const ros::Time& stamp)
{
  BatteryState message;
  message.header.stamp = stamp;
  message.present = !battery_source_.empty();
  message.voltage = static_cast<float>(battery_.voltage);
  message.current = static_cast<float>(battery_.current);
  message.percentage = static_cast<float>(battery_.charge);
  message.charge = static_cast<float>(battery_.charge * options_.battery.capacity_ah);
  message.capacity = static_cast<float>(options_.battery.capacity_ah);
  message.design_capacity = message.capacity;
  message.temperature = static_cast<float>(NOT_MEASURED);
  message.location = battery_source_;
  message.power_supply_status = !message.present || !std::isfinite(battery_.current)
                                    ? BatteryState::POWER_SUPPLY_STATUS_UNKNOWN
                                : battery_.current > 0.0 ? BatteryState::POWER_SUPPLY_STATUS_CHARGING
                                : battery_.current < 0.0 ? BatteryState::POWER_SUPPLY_STATUS_DISCHARGING
                                                         : BatteryState::POWER_SUPPLY_STATUS_NOT_CHARGING;
  battery_publisher_.publish(message);
}

void PowerRos::reportServices(Status& status) const
{
  std::vector<std::string> missing;
  for (size_t i = 0; i < use_.services.size(); ++i)
  {
    const power::ServiceUse& service = use_.services[i];
    if (!service.running && !options_.services[i].optional)
    {
      missing.push_back(service.name);
    }
    const double memory_mb = 1e-6 * service.memory;
    status.add(service.name,
               !service.running ? "none of its nodes is here"
                                : format("%.0f %% of a core, ", 100.0 * service.cores) +
                                      (std::isfinite(memory_mb) ? format("%.0f MB, ", memory_mb) : "memory unknown, ") +
                                      format("%.2f W", account_.services[i]));
  }
  status.add("shared processes", format("%.0f %% of a core", 100.0 * use_.shared.cores));
  status.add("other processes", format("%.0f %% of a core", 100.0 * use_.other.cores));
  for (const auto& [node, problem] : found_.problems)
  {
    status.add(node, problem);
  }
  if (!found_.master)
  {
    status.summary(DiagnosticStatus::WARN, "the ROS master does not answer; nodes that start are not found");
  }
  else if (!missing.empty() && found_.searches > 0)
  {
    status.summary(DiagnosticStatus::WARN, "no node is here of " + join(missing) +
                                               "; start them, or correct nodes in services of the parameters");
  }
  else
  {
    status.summary(DiagnosticStatus::OK,
                   format("%.2f", use_.busy_cores) + " of " + std::to_string(use_.cores) + " cores are busy");
  }
}

void PowerRos::reportPower(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  const std::string text =
      format("%.1f W", account_.total) + (account_.measured ? ", measured: " : ", by the ") + account_.source;
  status.summary(DiagnosticStatus::OK, text);
  if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else if (!account_.measured && !monitor_.unreadable().empty())
  {
    const pi_node::PowerMonitor::Unreadable& sensor = monitor_.unreadable().front();
    status.summary(DiagnosticStatus::WARN,
                   text + "; " + sensor.path + ": " + sensor.reason + "; let the user of this node read it");
  }
  status.add("idle [W]", format("%.2f", account_.idle));
  status.add("by services and other processes [W]", format("%.2f", account_.dynamic));
  for (const pi_node::PowerMonitor::Unreadable& sensor : monitor_.unreadable())
  {
    status.add(sensor.path, sensor.reason);
  }
}

void PowerRos::reportBattery(Status& status) const
{
  if (battery_source_.empty())
  {
    status.summary(DiagnosticStatus::OK, "no battery is known");
    return;
  }
  const power::BatteryOptions& limits = options_.battery;
  const std::string text = format("%.0f %%", 100.0 * battery_.charge) + ", " + hours(estimate_.remaining_s) + " left";
  const bool empty = battery_.charge <= limits.empty_charge;
  const bool low = battery_.charge <= limits.low_charge || estimate_.remaining_s <= limits.low_remaining_s;
  status.summary(empty ? DiagnosticStatus::ERROR
                 : low ? DiagnosticStatus::WARN
                       : DiagnosticStatus::OK,
                 empty || low ? text + "; charge it" : text);
  status.add("source", battery_source_);
  status.add("voltage [V]", format("%.2f", battery_.voltage));
  status.add("current [A]", format("%.2f", battery_.current));
  status.add("draw, smoothed [W]", format("%.2f", estimate_.draw_w));
}

}  // namespace pi_vehicle
