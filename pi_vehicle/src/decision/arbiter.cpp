#include "decision/arbiter.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pi_node/yaml_section.h>

#include <algorithm>
#include <cmath>

namespace pi_vehicle
{

using pi_node::seconds;

namespace
{

constexpr double AT_REST = 0.05;        // [m/s]
constexpr double SHAPING_STEP_S = 0.1;  // of the shaping
constexpr double MAX_PAUSE_S = 1.0;     // a longer one is a jump of the clock, or a stall
constexpr double FUTURE_S = 0.1;

bool finite(const DriveCommand& command)
{
  return std::isfinite(command.speed) && std::isfinite(command.curvature) && std::isfinite(command.max_deceleration) &&
         command.max_deceleration >= 0.0;
}

ArbiterOptions readArbiter(pi_node::YamlSection top, const pi_node::MotionLimits& vehicle)
{
  ArbiterOptions options;
  options.vehicle = vehicle;
  if (top.has("limits"))
  {
    top.section("limits").readFields(&options);
  }
  for (pi_node::YamlSection& entry : top.list("sources"))
  {
    ArbiterSource source;
    source.name = entry.get<std::string>("name", "a text");
    entry.read("drives", "true or false", &source.drives);
    entry.read("priority", "a whole number", &source.priority);
    entry.read("timeout", "a number", &source.timeout);
    if (entry.has("max_speed"))
    {
      source.max_speed = entry.get<double>("max_speed", "a number");
    }
    entry.read("required", "true or false", &source.required);
    entry.finish();
    options.sources.push_back(source);
  }
  return top.checked(options);
}

}  // namespace

ArbiterOptions ArbiterOptions::load(const std::string& path, const pi_node::MotionLimits& vehicle)
{
  return readArbiter(pi_node::YamlSection::load(path), vehicle);
}

ArbiterOptions ArbiterOptions::parse(const std::string& yaml, const std::string& name,
                                     const pi_node::MotionLimits& vehicle)
{
  return readArbiter(pi_node::YamlSection::parse(yaml, name), vehicle);
}

void ArbiterOptions::validate() const
{
  const pi_node::OptionCheck check("limits");
  check.range("max_reverse_speed", max_reverse_speed, 0.0, vehicle.reverse_speed, "vehicle/limits/reverse_speed");
  check.range("jerk", jerk, 0.1, 1000.0);
  check.range("emergency_jerk", emergency_jerk, jerk, 1000.0);
  check.range("max_lateral_acceleration", max_lateral_acceleration, 0.05, vehicle.lateral_acceleration,
              "vehicle/limits/lateral_acceleration");
  if (sources.empty())
  {
    throw std::invalid_argument("sources is empty, must name at least one");
  }
  for (size_t i = 0; i < sources.size(); ++i)
  {
    const ArbiterSource& source = sources[i];
    if (source.name.empty())
    {
      throw std::invalid_argument("sources/" + std::to_string(i) + "/name is empty, must be a text");
    }
    const pi_node::OptionCheck own("sources/" + source.name);
    own.range("timeout", source.timeout, 0.02, 60.0);
    own.range("max_speed", source.max_speed.value_or(0.0), 0.0, vehicle.speed, "vehicle/limits/speed");
    for (size_t other = 0; other < i; ++other)
    {
      if (sources[other].name == source.name)
      {
        throw std::invalid_argument("sources/" + source.name + " is there twice, must be once");
      }
      if (source.drives && sources[other].drives && sources[other].priority == source.priority)
      {
        throw std::invalid_argument("sources/" + source.name + "/priority = " + std::to_string(source.priority) +
                                    ", must differ from that of " + sources[other].name);
      }
    }
  }
}

Arbiter::Arbiter(const ArbiterOptions& options) : options_(options), sources_(options.sources.size())
{
  options_.validate();
}

int Arbiter::find(const std::string& name) const
{
  for (size_t i = 0; i < options_.sources.size(); ++i)
  {
    if (options_.sources[i].name == name)
    {
      return static_cast<int>(i);
    }
  }
  return -1;
}

ArbiterAnswer Arbiter::submit(const DriveCommand& command, int64_t stamp_ns, int64_t now_ns)
{
  const int index = find(command.source);
  if (index < 0)
  {
    return ArbiterAnswer::UNKNOWN_SOURCE;
  }
  if (!finite(command))
  {
    return ArbiterAnswer::NOT_FINITE;
  }
  const double age = seconds(now_ns - stamp_ns);
  if (age > options_.sources[static_cast<size_t>(index)].timeout)
  {
    return ArbiterAnswer::TOO_OLD;
  }
  if (age < -FUTURE_S)
  {
    return ArbiterAnswer::FROM_FUTURE;
  }
  ArbiterSourceState& slot = sources_[static_cast<size_t>(index)];
  if (slot.alive && stamp_ns < slot.stamp_ns && seconds(slot.stamp_ns - stamp_ns) < MAX_PAUSE_S)
  {
    return ArbiterAnswer::OUT_OF_ORDER;
  }
  slot.alive = true;
  slot.heard = true;
  slot.released = false;
  slot.stamp_ns = stamp_ns;
  slot.command = command;
  return ArbiterAnswer::TAKEN;
}

bool Arbiter::release(const std::string& source)
{
  const int index = find(source);
  if (index < 0)
  {
    return false;
  }
  sources_[static_cast<size_t>(index)] = {};
  sources_[static_cast<size_t>(index)].released = true;
  if (driver_ == index)
  {
    driver_ = -1;
  }
  return true;
}

void Arbiter::emergencyStop(const std::string& reason)
{
  if (!emergency_)
  {
    emergency_ = true;
    emergency_reason_ = reason.empty() ? "emergency stop" : "emergency stop: " + reason;
  }
}

bool Arbiter::releaseEmergencyStop()
{
  if (std::abs(speed_) > AT_REST || std::abs(measured_) > AT_REST)
  {
    return false;
  }
  emergency_ = false;
  return true;
}

void Arbiter::shape(const Demand& demand, double dt)
{
  const double deceleration = demand.deceleration;
  const double turn = options_.vehicle.curvature_rate * dt;
  const double curvature = std::clamp(demand.curvature, -options_.vehicle.curvature, options_.vehicle.curvature);
  curvature_ += std::clamp(curvature - curvature_, -turn, turn);
  const double bend = std::sqrt(options_.max_lateral_acceleration / std::max(std::abs(curvature_), 1e-6));
  double target = std::clamp(demand.speed, -bend, bend);
  if (target * speed_ < 0.0)
  {
    target = 0.0;  // through standstill
  }
  const double difference = target - speed_;
  const bool slower = std::abs(target) < std::abs(speed_);
  const double most = slower ? deceleration : options_.vehicle.acceleration;
  const double jerk = slower && deceleration > options_.vehicle.deceleration ? options_.emergency_jerk : options_.jerk;
  // The acceleration that a bounded jerk brings to zero as the target is reached, one step early.
  const double step = jerk * dt;
  const double reach = std::sqrt(2.0 * jerk * std::abs(difference) + 0.25 * step * step) - 0.5 * step;
  const double wanted = std::copysign(std::min(most, std::max(0.0, reach)), difference);
  acceleration_ += std::clamp(wanted - acceleration_, -step, step);
  acceleration_ = std::clamp(acceleration_, -std::max(options_.vehicle.acceleration, deceleration),
                             std::max(options_.vehicle.acceleration, deceleration));
  const double next = speed_ + acceleration_ * dt;
  if ((target - next) * difference <= 0.0 && std::abs(acceleration_) <= 2.0 * step)
  {
    speed_ = target;
    acceleration_ = 0.0;
  }
  else if (next * speed_ < 0.0)
  {
    speed_ = 0.0;
    acceleration_ = 0.0;
  }
  else
  {
    speed_ = next;
  }
}

double Arbiter::advanceClock(int64_t now_ns)
{
  const double dt = have_now_ ? seconds(now_ns - last_ns_) : 0.0;
  if (dt < 0.0 || dt > MAX_PAUSE_S)
  {
    for (ArbiterSourceState& slot : sources_)
    {
      slot.alive = false;
    }
  }
  have_now_ = true;
  last_ns_ = now_ns;
  return std::clamp(dt, 0.0, SHAPING_STEP_S);
}

std::string Arbiter::expireSilentSources(int64_t now_ns)
{
  std::string missing;
  for (size_t i = 0; i < sources_.size(); ++i)
  {
    const ArbiterSource& source = options_.sources[i];
    ArbiterSourceState& slot = sources_[i];
    const double age = seconds(now_ns - slot.stamp_ns);
    slot.alive = slot.alive && age <= source.timeout + 1e-9 && age >= -MAX_PAUSE_S;
    if (!slot.alive && source.required && !slot.released && missing.empty())
    {
      missing = source.name;
    }
  }
  return missing;
}

int Arbiter::highestPriority() const
{
  int best = -1;
  for (size_t i = 0; i < sources_.size(); ++i)
  {
    const ArbiterSource& source = options_.sources[i];
    if (sources_[i].alive && source.drives &&
        (best < 0 || source.priority > options_.sources[static_cast<size_t>(best)].priority))
    {
      best = static_cast<int>(i);
    }
  }
  return best;
}

void Arbiter::chooseDriver()
{
  const int best = highestPriority();
  if (driver_ >= 0 && !sources_[static_cast<size_t>(driver_)].alive)
  {
    stopping_ = true;
    dead_ = options_.sources[static_cast<size_t>(driver_)].name;
    driver_ = -1;
  }
  const bool standing = std::abs(speed_) < 1e-3 && std::abs(measured_) < AT_REST;
  const bool revived = best >= 0 && find(dead_) == best;
  if (standing || revived)
  {
    stopping_ = false;
  }
  if (!stopping_)
  {
    driver_ = best;
  }
}

Arbiter::Demand Arbiter::demandOfDriver(ArbiterOutput* output) const
{
  Demand demand{0.0, curvature_, options_.vehicle.deceleration};
  if (driver_ < 0)
  {
    output->command.reason = stopping_ ? dead_ + " fell silent" : "nobody drives";
    return demand;
  }
  const ArbiterSource& source = options_.sources[static_cast<size_t>(driver_)];
  const DriveCommand& command = sources_[static_cast<size_t>(driver_)].command;
  const double most = source.max_speed.value_or(options_.vehicle.speed);
  demand.speed = std::clamp(command.speed, -std::min(options_.max_reverse_speed, most), most);
  demand.curvature = command.curvature;
  brakeHarder(command.max_deceleration, &demand);
  output->command.source = source.name;
  output->command.reason = command.reason;
  output->driver = source.name;
  return demand;
}

void Arbiter::brakeHarder(double deceleration, Demand* demand) const
{
  demand->deceleration =
      std::max(demand->deceleration, std::min(deceleration, options_.vehicle.emergency_deceleration));
}

void Arbiter::applySpeedLimits(Demand* demand, ArbiterOutput* output) const
{
  for (size_t i = 0; i < sources_.size(); ++i)
  {
    const ArbiterSource& source = options_.sources[i];
    const DriveCommand& command = sources_[i].command;
    if (source.drives || !sources_[i].alive)
    {
      continue;
    }
    const double limit = std::max(0.0, command.speed);
    if (std::abs(speed_) > limit)
    {
      brakeHarder(command.max_deceleration, demand);  // also where the driver slows down by itself, more gently
    }
    if (std::abs(demand->speed) > limit)
    {
      demand->speed = std::clamp(demand->speed, -limit, limit);
      output->command.source = source.name;
      output->command.reason = command.reason;
      output->limited_by = source.name;
    }
  }
}

void Arbiter::hold(const std::string& reason, Demand* demand, ArbiterOutput* output)
{
  demand->speed = 0.0;
  output->command.source = "arbiter";
  output->command.reason = reason;
  output->limited_by = output->command.source;
}

ArbiterOutput Arbiter::update(int64_t now_ns, std::optional<double> measured_speed)
{
  const double dt = advanceClock(now_ns);
  measured_ = measured_speed && std::isfinite(*measured_speed) ? *measured_speed : speed_;
  const std::string missing = expireSilentSources(now_ns);
  chooseDriver();

  ArbiterOutput output;
  output.command.source = "arbiter";
  Demand demand = demandOfDriver(&output);
  applySpeedLimits(&demand, &output);
  if (!missing.empty())
  {
    hold(missing + " is silent and required", &demand, &output);
    output.missing = true;
  }
  if (emergency_)
  {
    hold(emergency_reason_, &demand, &output);
    demand.deceleration = options_.vehicle.emergency_deceleration;
    output.emergency_stop = true;
  }
  shape(demand, dt);
  output.command.speed = speed_;
  output.command.curvature = curvature_;
  output.command.max_deceleration = demand.deceleration > options_.vehicle.deceleration ? demand.deceleration : 0.0;
  output.acceleration = acceleration_;
  return output;
}

const char* toString(ArbiterAnswer answer)
{
  static constexpr const char* NAMES[] = {"taken",
                                          "unknown source: add it to sources",
                                          "a number that is none, or a negative deceleration",
                                          "stamp older than the source's timeout",
                                          "stamp in the future: check the clocks",
                                          "older than the command before"};
  return NAMES[static_cast<size_t>(answer)];
}

}  // namespace pi_vehicle
