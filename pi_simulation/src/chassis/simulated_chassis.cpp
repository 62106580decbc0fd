#include "chassis/simulated_chassis.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <sstream>
#include <stdexcept>
#include <vector>

namespace pi_simulation
{
namespace
{

constexpr size_t GARBAGE_PER_STEP = 16;
constexpr size_t MAX_GARBAGE = 100000;
constexpr int READS_AT_ONCE = 16;
const char* const CHASSIS_COMMANDS =
    "unplug, plug, restart, silent on|off, garbage BYTES|on|off, stuck on|off, battery CHARGE, button on|off, "
    "slip SHARE, pose X Y YAW";

chassis::Hello helloOf(const SimulationOptions& options)
{
  chassis::Hello hello;
  hello.kind = options.model.kind;
  hello.wheelbase = options.model.wheelbase;
  hello.limits = options.limits;
  if (options.model.kind == chassis::Kind::CAR_LIKE)
  {
    hello.limits.curvature =
        std::min(hello.limits.curvature, std::tan(options.model.max_steering) / options.model.wheelbase);
  }
  hello.watchdog_s = options.watchdog_s;
  hello.status_period_s = options.status_period_s;
  hello.name = options.name;
  return hello;
}

std::optional<bool> flag(const std::string& word)
{
  return word == "on" ? std::optional<bool>(true) : word == "off" ? std::optional<bool>(false) : std::nullopt;
}

}  // namespace

const char* toString(Base base)
{
  return base == Base::SERIAL ? "serial" : "twist";
}

void SimulationOptions::setVehicle(const pi_node::VehicleDescription& vehicle)
{
  const bool is_car = vehicle.kind == pi_node::VehicleKind::ACKERMANN;
  model.kind = is_car ? chassis::Kind::CAR_LIKE : chassis::Kind::DIFFERENTIAL;
  model.wheelbase = is_car ? vehicle.wheelbase : vehicle.track;
  if (is_car)
  {
    model.max_steering = std::atan(vehicle.limits.curvature * vehicle.wheelbase);
    model.max_steering_rate = vehicle.limits.curvature_rate * vehicle.wheelbase;
  }
  limits = chassis::limitsOf(vehicle.limits);
  stock.kind = model.kind;
  stock.limits = limits;
  stock.yaw_rate = vehicle.limits.curvature * vehicle.limits.speed;
  stock.angular_acceleration = vehicle.limits.curvature_rate * vehicle.limits.speed;
}

void SimulationOptions::validate() const
{
  model.validate();
  limits.validate();
  const pi_node::OptionCheck check("");
  check.range("watchdog_s", watchdog_s, 0.05, 10.0);
  check.range("status_period_s", status_period_s, 0.005, 1.0);
}

SimulatedChassis::SimulatedChassis(const SimulationOptions& options, int64_t now_ns)
  : options_((options.validate(), options))
  , hello_(helloOf(options))
  , model_(options.model)
  , random_(options.seed)
  , now_ns_(now_ns)
{
  model_.setPose(options_.start);
  restart(now_ns);
  if (options_.base == Base::SERIAL)
  {
    terminal_.emplace(options_.link);
  }
}

void SimulatedChassis::restart(int64_t now_ns)
{
  if (options_.base == Base::TWIST)
  {
    stock_.emplace(options_.stock, now_ns);
  }
  else
  {
    controller_ = std::make_unique<ChassisController>(hello_, now_ns);
  }
}

bool SimulatedChassis::onTwist(double linear, double angular, int64_t now_ns)
{
  return !stock_ || !plugged_ || stock_->onTwist(linear, angular, now_ns);
}

uint64_t SimulatedChassis::received() const
{
  if (stock_)
  {
    return stock_->twists();
  }
  const ControllerCounters& counters = controller_->counters();
  return counters.commands + counters.old_commands + counters.refused;
}

void SimulatedChassis::write(const std::vector<uint8_t>& bytes)
{
  if (terminal_ && !bytes.empty())
  {
    terminal_->write(bytes.data(), bytes.size());
  }
}

void SimulatedChassis::step(int64_t now_ns)
{
  std::array<uint8_t, 4096> bytes;
  for (int i = 0; terminal_ && i < READS_AT_ONCE; ++i)
  {
    const size_t count = terminal_->read(bytes.data(), bytes.size());
    if (count == 0)
    {
      break;
    }
    controller_->onBytes(bytes.data(), count, now_ns);
  }
  const Measurement measured = model_.measurement();
  const Setpoint setpoint = stock_ ? stock_->update(measured, now_ns) : controller_->update(measured, now_ns);
  model_.step(setpoint, pi_node::secondsBetween(now_ns_, now_ns));
  now_ns_ = now_ns;
  if (stock_)
  {
    return;
  }

  const std::vector<uint8_t> output = controller_->takeOutput();
  if (!silent_)
  {
    write(output);
  }
  if (garbage_)
  {
    writeGarbage(GARBAGE_PER_STEP);
  }
}

bool SimulatedChassis::setFault(const std::string& name, bool on)
{
  if (name == "silent")
  {
    silent_ = on;
  }
  else if (name == "stuck")
  {
    model_.setStuck(on);
  }
  else if (name == "button")
  {
    model_.setEmergencyButton(on);
  }
  else if (name == "garbage")
  {
    garbage_ = on;
  }
  else
  {
    return false;
  }
  return true;
}

void SimulatedChassis::writeGarbage(size_t count)
{
  std::vector<uint8_t> garbage(count);
  std::generate(garbage.begin(), garbage.end(), [this] { return static_cast<uint8_t>(random_()); });
  write(garbage);
}

bool SimulatedChassis::setNumbers(const std::string& name, std::istringstream numbers)
{
  double number = 0.0;
  pi_vehicle::Pose2 pose;
  if (name == "garbage" && numbers >> number && number >= 1.0 && number <= static_cast<double>(MAX_GARBAGE))
  {
    writeGarbage(static_cast<size_t>(number));
  }
  else if (name == "battery" && numbers >> number && number >= 0.0 && number <= 1.0)
  {
    model_.setBatteryCharge(number);
  }
  else if (name == "slip" && numbers >> number && number >= 0.0 && number <= 1.0)
  {
    model_.setSlip(number);
  }
  else if (name == "pose" && numbers >> pose.x >> pose.y >> pose.heading)
  {
    model_.setPose(pose);
  }
  else
  {
    return false;
  }
  return true;
}

std::string SimulatedChassis::command(const std::string& line, int64_t now_ns)
{
  std::istringstream words(line);
  std::string name;
  std::string value;
  words >> name >> value;
  if (stock_ && name == "garbage")
  {
    return "command \"" + line + "\": a base with cmd_vel and odom has no line; unplug, or silent on";
  }
  if (name == "unplug" && value.empty())
  {
    terminal_.reset();
    plugged_ = false;
    return "";
  }
  if (name == "plug" && value.empty())
  {
    plugged_ = true;
    try
    {
      if (!stock_ && !terminal_)
      {
        terminal_.emplace(options_.link);
      }
    }
    catch (const std::runtime_error& error)
    {
      return error.what();
    }
    return "";
  }
  if (name == "restart" && value.empty())
  {
    restart(now_ns);
    return "";
  }
  const std::optional<bool> on = flag(value);
  const bool done =
      (on && setFault(name, *on)) ||
      setNumbers(name, std::istringstream(line.substr(std::min(line.size(), line.find(name) + name.size()))));
  return done ? "" : "command \"" + line + "\" is not understood, must be one of: " + CHASSIS_COMMANDS;
}

std::string SimulatedChassis::truth() const
{
  const Measurement measured = model_.measurement();
  const pi_vehicle::Pose2& pose = model_.pose();
  std::array<char, 320> text = {};
  std::snprintf(text.data(), text.size(),
                "{\"t\": %.4f, \"x\": %.5f, \"y\": %.5f, \"yaw\": %.6f, \"speed\": %.4f, \"curvature\": %.5f, "
                "\"mode\": \"%s\"}",
                model_.time(), pose.x, pose.y, pose.heading, measured.speed, measured.curvature,
                chassis::modeText(mode()));
  return text.data();
}

}  // namespace pi_simulation
