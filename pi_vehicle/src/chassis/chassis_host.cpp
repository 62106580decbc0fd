#include <pi_vehicle/chassis/chassis_host.h>

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_vehicle::chassis
{

using pi_node::format;
using pi_node::secondsBetween;

namespace
{

constexpr int64_t HELLO_PERIOD_NS = 200'000'000;
constexpr int64_t RELEASE_NS = 1'000'000'000;  ///< so long the chassis is asked to release
constexpr uint16_t MAX_GAP = 1000;             ///< of lost frames; a wider one is a chassis that counts anew
constexpr double TRAVEL_STEP = 1e-4;           ///< [m]
constexpr double WHEELS_STAND = 0.02;          ///< [m/s]

}  // namespace

void HostOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("command_period_s", command_period_s, 0.002, 0.05);
  check.range("status_timeout_s", status_timeout_s, 0.02, 10.0);
  check.range("motion_timeout_s", motion_timeout_s, 0.02, 10.0);
  limits.validate("limits");
  check.range("stop_deceleration", stop_deceleration, 0.01, limits.deceleration,
              "vehicle/limits/emergency_deceleration");
}

bool isUsable(const Motion& motion, const Limits& limits, HostCounters* counters, bool* cut)
{
  if (!std::isfinite(motion.speed) || !std::isfinite(motion.curvature) || !std::isfinite(motion.deceleration))
  {
    ++counters->refused_motions;
    return false;
  }
  Command wanted;
  wanted.speed = motion.speed;
  wanted.curvature = motion.curvature;
  wanted.deceleration = motion.deceleration;
  withinLimits(wanted, limits, cut);
  counters->limited_motions += *cut ? 1 : 0;
  return true;
}

ChassisHost::ChassisHost(const HostOptions& options) : options_(options), limits_(options.limits)
{
  options_.validate();
}

void ChassisHost::onLineOpen(int64_t now_ns)
{
  decoder_.reset();
  line_open_ = true;
  problem_.clear();
  hello_valid_ = false;
  hello_asked_ = false;
  hello_problem_.clear();
  status_seen_ = false;
  timeout_counted_ = false;
  frame_sequence_.reset();
  status_ns_ = now_ns;
  commanded_speed_ = 0.0;
  timing_ = false;
}

void ChassisHost::onLineClosed(const std::string& problem)
{
  line_open_ = false;
  hello_valid_ = false;
  status_seen_ = false;
  problem_ = problem;
  commanded_speed_ = 0.0;
}

void ChassisHost::onBytes(const uint8_t* bytes, size_t count, int64_t now_ns)
{
  std::vector<Frame> frames;
  decoder_.add(bytes, count, &frames);
  for (const Frame& frame : frames)
  {
    if (frame_sequence_)
    {
      const auto gap = static_cast<uint16_t>(frame.sequence - *frame_sequence_ - 1);
      counters_.lost_frames += gap < MAX_GAP ? gap : 0;
    }
    frame_sequence_ = frame.sequence;
    if (const auto status = decodeStatus(frame))
    {
      onStatus(*status, now_ns);
    }
    else if (const auto hello = decodeHello(frame))
    {
      onHello(*hello);
    }
    else
    {
      ++counters_.refused_frames;
    }
  }
}

void ChassisHost::onHello(const Hello& hello)
{
  hello_ = hello;
  hello_valid_ = hello.protocol_version == PROTOCOL_VERSION;
  hello_problem_ = hello_valid_ ? ""
                                : "the chassis speaks version " + std::to_string(hello.protocol_version) +
                                      " of the protocol, this driver " + std::to_string(PROTOCOL_VERSION) +
                                      "; update the older of both";
  limits_ = intersection(options_.limits, hello.limits);
}

void ChassisHost::onStatus(const Status& status, int64_t now_ns)
{
  ++counters_.statuses;
  // A clock that goes back by less than half its range is a chassis that started again.
  const bool restarted = status_seen_ && static_cast<int32_t>(status.uptime_ms - status_.uptime_ms) < 0;
  if (restarted)
  {
    ++counters_.restarts;
    hello_valid_ = false;
    hello_asked_ = false;
    commanded_speed_ = 0.0;
  }
  if (status_seen_ && !restarted)
  {
    const double distance = TRAVEL_STEP * static_cast<int32_t>(status.travel - status_.travel);
    odometry_.pose = odometry_.pose.moved(distance, 0.5 * (status.curvature + status_.curvature));
    odometry_.distance += std::abs(distance);
  }
  odometry_.speed = status.speed;
  odometry_.yaw_rate = status.speed * status.curvature;
  odometry_.stamp_ns = now_ns;
  ++odometry_.count;
  if (timing_ && status.command_seen && static_cast<int16_t>(status.echoed_sequence - timed_sequence_) >= 0)
  {
    round_trip_s_ = secondsBetween(timed_ns_, now_ns);
    timing_ = false;
  }
  // Only a status that answers to it confirms a release: an earlier one may not know of the emergency stop yet.
  if (release_ns_ && release_sequence_ && status.command_seen &&
      static_cast<int16_t>(status.echoed_sequence - *release_sequence_) >= 0 && status.mode != Mode::EMERGENCY_STOP &&
      status.mode != Mode::FAULT)
  {
    release_ns_.reset();
  }
  status_ = status;
  status_seen_ = true;
  status_ns_ = now_ns;
  timeout_counted_ = false;
}

bool ChassisHost::setMotion(const Motion& motion, int64_t now_ns)
{
  if (!isUsable(motion, limits_, &counters_, &motion_cut_))
  {
    return false;
  }
  motion_ = motion;
  motion_ns_ = now_ns;
  return true;
}

void ChassisHost::emergencyStop(const std::string& reason)
{
  emergency_ = true;
  emergency_reason_ = reason;
  release_ns_.reset();
}

void ChassisHost::release(int64_t now_ns)
{
  emergency_ = false;
  release_ns_ = now_ns;
  release_sequence_.reset();
  motion_.reset();
  commanded_speed_ = 0.0;
}

void ChassisHost::stop()
{
  motion_.reset();
  commanded_speed_ = 0.0;
}

bool ChassisHost::heard(int64_t now_ns) const
{
  return line_open_ && status_seen_ && secondsBetween(status_ns_, now_ns) <= options_.status_timeout_s;
}

bool ChassisHost::motionHolds(int64_t now_ns) const
{
  return motion_ && secondsBetween(motion_ns_, now_ns) <= options_.motion_timeout_s;
}

Command ChassisHost::nextCommand(int64_t now_ns)
{
  Command command;
  command.enable = hello_valid_ && heard(now_ns);
  command.emergency_stop = emergency_;
  if (release_ns_ && now_ns - *release_ns_ > RELEASE_NS)
  {
    release_ns_.reset();  // the chassis stays in its fault: nothing more to ask
  }
  command.release = release_ns_.has_value() && !emergency_;
  if (command.release && !release_sequence_)
  {
    release_sequence_ = sequence_;
  }
  const bool moves = command.enable && !command.emergency_stop && !command.release && motionHolds(now_ns) &&
                     status_.mode != Mode::EMERGENCY_STOP && status_.mode != Mode::FAULT;
  if (motion_)
  {
    command.curvature = motion_->curvature;
    command.deceleration = motion_->deceleration;
  }
  if (moves)
  {
    command.speed = motion_->speed;
  }
  else
  {
    command.deceleration = emergency_ ? limits_.deceleration : options_.stop_deceleration;
  }
  command = withinLimits(command, limits_, nullptr);
  const double dt = std::clamp(secondsBetween(command_ns_, now_ns), 0.0, 2.0 * options_.command_period_s);
  // Faster by the ramp; slower at once: the chassis slows down by the deceleration that the command holds.
  const double ramped = rampSpeed(commanded_speed_, command.speed, limits_.acceleration, command.deceleration, dt);
  const bool slower = std::abs(command.speed) <= std::abs(commanded_speed_) && command.speed * commanded_speed_ >= 0.0;
  commanded_speed_ = command.release || emergency_ ? 0.0 : ramped;
  command.speed = command.release || emergency_ ? 0.0 : slower ? command.speed : ramped;
  command_ns_ = now_ns;
  return command;
}

std::vector<uint8_t> ChassisHost::poll(int64_t now_ns)
{
  std::vector<uint8_t> bytes;
  if (!line_open_)
  {
    return bytes;
  }
  if (status_seen_ && !heard(now_ns) && !timeout_counted_)
  {
    timeout_counted_ = true;
    ++counters_.status_timeouts;
    hello_valid_ = false;  // another chassis may be there when it comes back
    hello_asked_ = false;
  }
  if (!hello_valid_ && (!hello_asked_ || now_ns - hello_asked_ns_ >= HELLO_PERIOD_NS))
  {
    hello_asked_ = true;
    hello_asked_ns_ = now_ns;
    bytes = encodeHelloRequest(sequence_++);
  }
  if (!timing_ || secondsBetween(timed_ns_, now_ns) > options_.status_timeout_s)
  {
    timing_ = true;
    timed_sequence_ = sequence_;
    timed_ns_ = now_ns;
  }
  const std::vector<uint8_t> command = encodeCommand(nextCommand(now_ns), sequence_++);
  ++counters_.commands;
  bytes.insert(bytes.end(), command.begin(), command.end());
  return bytes;
}

HostMode ChassisHost::mode(int64_t now_ns, std::string* detail) const
{
  if (!line_open_)
  {
    *detail = problem_;
    return HostMode::DISCONNECTED;
  }
  if (!status_seen_ && secondsBetween(status_ns_, now_ns) <= options_.status_timeout_s)
  {
    *detail = "waits for the first status";
    return HostMode::DISCONNECTED;
  }
  if (!heard(now_ns))
  {
    const DecoderCounters& counters = decoder_.counters();
    *detail =
        "no status for " + format("%.2f s", secondsBetween(status_ns_, now_ns)) +
        (counters.wrong_version > 0 && !status_seen_
             ? "; it speaks version " + std::to_string(counters.other_version) + " of the protocol, this driver " +
                   std::to_string(PROTOCOL_VERSION) + "; update the older of both"
             : "; is it switched on, and is the baud rate that of the chassis?");
    return HostMode::DISCONNECTED;
  }
  if (emergency_)
  {
    *detail = emergency_reason_ + "; stays until it is released";
    return HostMode::EMERGENCY_STOP;
  }
  if (status_.mode == Mode::EMERGENCY_STOP)
  {
    *detail = (status_.faults & EMERGENCY_BUTTON) != 0
                  ? "emergency button is pressed on the vehicle; pull it out, then release"
                  : "emergency stop of the chassis; stays until it is released";
    return HostMode::EMERGENCY_STOP;
  }
  if (status_.mode == Mode::FAULT)
  {
    *detail = faultText(static_cast<uint16_t>(status_.faults & ~WARNING_FAULTS)) + "; mend it, then release";
    return HostMode::FAULT;
  }
  if (!hello_valid_)
  {
    *detail = hello_problem_.empty() ? "asks the chassis for its limits" : hello_problem_;
    return hello_problem_.empty() ? HostMode::READY : HostMode::FAULT;
  }
  if (motion_ && !motionHolds(now_ns))
  {
    *detail = "no motion command for " + format("%.2f s", secondsBetween(motion_ns_, now_ns)) +
              "; drives again when they come";
    return HostMode::STOPPED_WATCHDOG;
  }
  if (status_.mode == Mode::STOPPED_WATCHDOG)
  {
    *detail = "the chassis got no command in time; drives again when they come";
    return HostMode::STOPPED_WATCHDOG;
  }
  const bool wants = motion_ && motion_->speed != 0.0;
  *detail = faultText(status_.faults & BATTERY_LOW);
  if (motion_cut_)
  {
    *detail += std::string(detail->empty() ? "" : ", ") + "motion cut to the limits";
  }
  return wants || status_.mode == Mode::DRIVING ? HostMode::DRIVING : HostMode::READY;
}

HostState ChassisHost::state(int64_t now_ns) const
{
  HostState state;
  state.mode = mode(now_ns, &state.detail);
  state.moving = std::abs(status_.speed) >= WHEELS_STAND;
  state.status = status_;
  state.odometry = odometry_;
  state.hello = hello_;
  state.round_trip_s = round_trip_s_;
  state.decoder = decoder_.counters();
  state.counters = counters_;
  return state;
}

}  // namespace pi_vehicle::chassis
