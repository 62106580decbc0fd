#include "ros/base/chassis_ros.h"

#include "ros/base/chassis_conversions.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/vehicle_clock.h>

#include <utility>
#include <vector>

namespace pi_vehicle
{
namespace
{

using chassis::HostMode;
using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr uint32_t CHASSIS_QUEUE = 50;
constexpr int64_t BATTERY_PERIOD_NS = 1'000'000'000;

}  // namespace

ChassisRos::ChassisRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : service_thread_("chassis_ros")
  , service_node_(service_thread_.handle(node))
  , options_(pi_node::loadNodeOptions<ChassisRosOptions>(private_node, "chassis"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<ChassisRosOptions>("chassis"))
  , updater_(service_node_, private_node, private_node.getNamespace())
{
  state_publisher_ = service_node_.advertise<VehicleState>("vehicle_state", CHASSIS_QUEUE);
  odometry_publisher_ = service_node_.advertise<nav_msgs::Odometry>("wheel_odometry", CHASSIS_QUEUE);
  battery_publisher_ = service_node_.advertise<sensor_msgs::BatteryState>("battery", 1, true);
  if (options_.wheels.publish_tf)
  {
    broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
  }
  updater_.setHardwareID(options_.driver.port);
  updater_.add("chassis", [this](Status& status) { reportChassis(status); });
  updater_.add("line", [this](Status& status) { reportLine(status); });
  updater_.add("battery", [this](Status& status) { reportBattery(status); });

  chassis::DriverEvents events;
  events.state = [this](const chassis::DriverState& state) { onState(state); };
  events.opened = [](const std::string& path) { ROS_INFO_STREAM_NAMED("chassis", "opened " << path); };
  events.closed = [](const std::string& problem)
  { ROS_ERROR_STREAM_NAMED("chassis", problem << "; tried again until it is there"); };
  driver_ = std::make_unique<chassis::ChassisDriver>(options_.driver, std::move(events));

  BaseCommands::Events commands;
  commands.motion = [this](const chassis::Motion& motion) { return driver_->setMotion(motion); };
  commands.emergency_stop = [this](const std::string& reason) { driver_->emergencyStop(reason); };
  commands.release = [this] { driver_->release(); };
  commands_ =
      std::make_unique<BaseCommands>(service_node_, options_.driver.host.motion_timeout_s, &warnings_, commands);
  timer_ = pi_node::VehicleTimer(service_node_, options_.diagnostic_period, [this] { publishDiagnostics(); });
  service_thread_.start();
}

ChassisRos::~ChassisRos()
{
  service_thread_.stop();
  driver_.reset();
}

// ------------------------------------------------------------------------------------------------------------ chassis

void ChassisRos::onState(const chassis::DriverState& state)
{
  const chassis::HostState& host = state.host;
  mode_log_.log(host);
  state_publisher_.publish(toVehicleState(host, ros::Time::now(), options_.wheels.base_link_frame));
  if (host.odometry.count != odometry_count_)
  {
    odometry_count_ = host.odometry.count;
    const nav_msgs::Odometry odometry =
        toOdometry(host.odometry, pi_node::rosTime(host.odometry.stamp_ns), options_.wheels);
    odometry_publisher_.publish(odometry);
    if (broadcaster_)
    {
      broadcaster_->sendTransform(toTransform(odometry));
    }
  }
  if (const int64_t now_ns = pi_node::vehicleNs(); now_ns - battery_ns_ >= BATTERY_PERIOD_NS)
  {
    battery_ns_ = now_ns;
    battery_publisher_.publish(toBatteryState(host, ros::Time::now(), options_.wheels.base_link_frame));
  }
}

// -------------------------------------------------------------------------------------------------------- chassis_ros

void ChassisRos::publishDiagnostics()
{
  report_ = driver_->state();
  garbage_lately_ = report_.host.decoder.garbage_bytes - garbage_before_;
  garbage_before_ = report_.host.decoder.garbage_bytes;
  const auto& hello = report_.host.hello;
  if (const std::string problem = hello ? contradictionOf(*hello, options_.vehicle) : ""; !problem.empty())
  {
    warnings_.warn(problem);
  }
  updater_.setHardwareID(hello && !hello->name.empty() ? hello->name : options_.driver.port);
  updater_.force_update();
}

void ChassisRos::reportChassis(Status& status) const
{
  const chassis::HostState& host = report_.host;
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  const bool error = host.mode == HostMode::FAULT || host.mode == HostMode::DISCONNECTED;
  const bool well = (host.mode == HostMode::READY || host.mode == HostMode::DRIVING) && host.detail.empty();
  status.summary(error ? DiagnosticStatus::ERROR : well ? DiagnosticStatus::OK : DiagnosticStatus::WARN, toText(host));
  if (well && !warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  if (host.hello)
  {
    status.add("kind", host.hello->kind == chassis::Kind::CAR_LIKE ? "car-like" : "differential");
    status.add("wheelbase [m]", format("%.3f", host.hello->wheelbase));
    status.add("greatest speed of the chassis [m/s]", format("%.2f", host.hello->limits.speed));
    status.add("watchdog of the chassis [s]", format("%.3f", host.hello->watchdog_s));
  }
  status.add("speed [m/s]", format("%.2f", host.status.speed));
  status.add("odometer [m]", format("%.1f", host.odometry.distance));
  status.add("faults", chassis::faultText(host.status.faults));
  status.add("motions cut to the limits", host.counters.limited_motions);
  status.add("motions refused", host.counters.refused_motions);
  status.add("restarts of the chassis", host.counters.restarts);
  pi_node::addWarnings(warnings, &status);
}

void ChassisRos::reportLine(Status& status) const
{
  const chassis::HostState& host = report_.host;
  if (report_.path.empty())
  {
    status.summary(DiagnosticStatus::ERROR, host.detail);
  }
  else if (garbage_lately_ > 0)
  {
    status.summary(
        DiagnosticStatus::WARN,
        std::to_string(garbage_lately_) + " bytes of garbage since the last report; check cable, ground and baud_rate");
  }
  else
  {
    status.summary(DiagnosticStatus::OK, report_.path);
  }
  status.add("port", report_.path);
  status.add("times opened", report_.opened);
  status.add("times lost", report_.lost);
  status.add("tries to open that failed", report_.open_errors);
  status.add("round trip [ms]", format("%.1f", 1e3 * host.round_trip_s));
  status.add("commands", host.counters.commands);
  status.add("commands dropped by a slow line", report_.dropped_commands);
  status.add("statuses", host.counters.statuses);
  status.add("lost frames", host.counters.lost_frames);
  status.add("times that statuses ceased", host.counters.status_timeouts);
  status.add("garbage [bytes]", host.decoder.garbage_bytes);
  status.add("frames with a wrong CRC", host.decoder.wrong_crc);
  status.add("frames of another version", host.decoder.wrong_version);
}

void ChassisRos::reportBattery(Status& status) const
{
  const chassis::Status& chassis = report_.host.status;
  if (report_.host.mode == HostMode::DISCONNECTED || !chassis.battery_charge)
  {
    status.summary(DiagnosticStatus::STALE, "unknown");
    return;
  }
  const std::string text = format("%.0f %%", 100.0 * *chassis.battery_charge);
  const bool empty = (chassis.faults & chassis::BATTERY_EMPTY) != 0;
  const bool low = (chassis.faults & chassis::BATTERY_LOW) != 0;
  status.summary(empty ? DiagnosticStatus::ERROR
                 : low ? DiagnosticStatus::WARN
                       : DiagnosticStatus::OK,
                 empty || low ? text + "; charge it" : text);
  status.add("voltage [V]", chassis.battery_voltage ? format("%.2f", *chassis.battery_voltage) : "unknown");
  status.add("current [A]", chassis.battery_current ? format("%.2f", *chassis.battery_current) : "unknown");
}

}  // namespace pi_vehicle
