#include "chassis/chassis_controller.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation
{

using namespace pi_vehicle::chassis;

namespace
{

constexpr double STANDING = 0.02;    ///< [m/s] slower counts as standing
constexpr double STUCK_SPEED = 0.1;  ///< [m/s] asked for, from which standing wheels are stuck
constexpr int64_t STUCK_NS = 1'000'000'000;
constexpr double TRAVEL_STEP = 1e-4;  ///< [m]

int64_t toNs(double seconds)
{
  return std::llround(1e9 * seconds);
}

}  // namespace

ChassisController::ChassisController(const Hello& hello, int64_t now_ns)
  : hello_(hello), start_ns_(now_ns), update_ns_(now_ns), follows_ns_(now_ns), status_ns_(now_ns)
{
  hello_.limits.validate();
  output_ = encodeHello(hello_, sequence_++);
}

void ChassisController::onBytes(const uint8_t* bytes, size_t count, int64_t now_ns)
{
  std::vector<Frame> frames;
  decoder_.add(bytes, count, &frames);
  for (const Frame& frame : frames)
  {
    if (const auto command = decodeCommand(frame))
    {
      onCommand(*command, frame.sequence, now_ns);
    }
    else if (frame.type == static_cast<uint8_t>(FrameType::HELLO_REQUEST) && frame.payload.empty())
    {
      watching_ = false;  // a host that begins counts from anywhere, and must command before anything moves
      command_ = Command();
      const std::vector<uint8_t> hello = encodeHello(hello_, sequence_++);
      output_.insert(output_.end(), hello.begin(), hello.end());
    }
    else
    {
      ++counters_.refused;
    }
  }
}

void ChassisController::onCommand(const Command& command, uint16_t sequence, int64_t now_ns)
{
  // A frame that comes again, or late, must not feed the watchdog. An emergency stop counts whenever it comes.
  emergency_ = emergency_ || command.emergency_stop;
  if (watching_ && static_cast<int16_t>(sequence - command_sequence_) <= 0)
  {
    ++counters_.old_commands;
    return;
  }
  ++counters_.commands;
  command_ = withinLimits(command, hello_.limits, &command_cut_);
  command_sequence_ = sequence;
  command_ns_ = now_ns;
  command_seen_ = true;
  watching_ = true;
  ran_out_ = false;
  if (command.release && !command.emergency_stop && command.speed == 0.0)
  {
    emergency_ = false;
    latched_faults_ = 0;
    follows_ns_ = now_ns;
  }
}

uint16_t ChassisController::faults(const Measurement& measured) const
{
  return static_cast<uint16_t>(measured.faults | latched_faults_ | (command_cut_ ? LIMITED : 0));
}

/// Wheels that stand while they should turn.
void ChassisController::watchDrive(const Measurement& measured, int64_t now_ns)
{
  if (std::abs(setpoint_.speed) < STUCK_SPEED || std::abs(measured.speed) >= STANDING)
  {
    follows_ns_ = now_ns;
  }
  else if (now_ns - follows_ns_ >= STUCK_NS)
  {
    latched_faults_ |= DRIVE_STUCK;
  }
}

Setpoint ChassisController::update(const Measurement& measured, int64_t now_ns)
{
  const double dt = 1e-9 * static_cast<double>(std::max<int64_t>(now_ns - update_ns_, 0));
  update_ns_ = now_ns;
  if (watching_ && now_ns - command_ns_ > toNs(hello_.watchdog_s))
  {
    watching_ = false;
    ran_out_ = true;
    ++counters_.watchdog_stops;
  }
  watchDrive(measured, now_ns);
  emergency_ = emergency_ || (measured.faults & EMERGENCY_BUTTON) != 0;

  const bool fault = (faults(measured) & ~(WARNING_FAULTS | EMERGENCY_BUTTON)) != 0;
  const bool at_once = emergency_ || fault || !watching_;
  const bool drives = !at_once && command_.enable;
  setpoint_.speed = rampSpeed(setpoint_.speed, drives ? command_.speed : 0.0, hello_.limits.acceleration,
                              at_once ? hello_.limits.deceleration : command_.deceleration, dt);
  if (!at_once)
  {
    setpoint_.curvature = command_.curvature;  // else the vehicle stops on the path that it is on
  }

  const bool moves = std::abs(setpoint_.speed) > 0.0 || std::abs(measured.speed) >= STANDING;
  mode_ = emergency_ ? Mode::EMERGENCY_STOP
          : fault    ? Mode::FAULT
          : ran_out_ ? Mode::STOPPED_WATCHDOG
          : moves    ? Mode::DRIVING
                     : Mode::READY;
  if (now_ns >= status_ns_)
  {
    sendStatus(measured, now_ns);
  }
  return setpoint_;
}

void ChassisController::sendStatus(const Measurement& measured, int64_t now_ns)
{
  const int64_t period_ns = toNs(hello_.status_period_s);
  status_ns_ += period_ns;
  if (status_ns_ <= now_ns)  // the caller was late: no burst
  {
    status_ns_ = now_ns + period_ns;
  }
  Status status;
  status.echoed_sequence = command_sequence_;
  status.command_seen = command_seen_;
  status.mode = mode_;
  status.faults = faults(measured);
  status.speed = measured.speed;
  status.curvature = measured.curvature;
  status.steering = measured.steering;
  status.travel = static_cast<uint32_t>(std::llround(measured.travel / TRAVEL_STEP));
  status.battery_voltage = measured.battery_voltage;
  status.battery_current = measured.battery_current;
  status.battery_charge = measured.battery_charge;
  status.uptime_ms = static_cast<uint32_t>((now_ns - start_ns_) / 1'000'000);
  const std::vector<uint8_t> bytes = encodeStatus(status, sequence_++);
  output_.insert(output_.end(), bytes.begin(), bytes.end());
}

std::vector<uint8_t> ChassisController::takeOutput()
{
  std::vector<uint8_t> output;
  output.swap(output_);
  return output;
}

}  // namespace pi_simulation
