#include "chassis/twist_base.h"

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

constexpr double STANDS_BELOW = 0.02;  ///< [m/s]
constexpr double JUMP = 0.5;           ///< beyond what the speed explains [m]

}  // namespace

void TwistBaseOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("command_period_s", command_period_s, 0.005, 0.5);
  check.range("odometry_timeout_s", odometry_timeout_s, 0.02, 10.0);
  check.range("motion_timeout_s", motion_timeout_s, 0.02, 10.0);
  limits.validate("limits");
  check.range("stop_deceleration", stop_deceleration, 0.01, limits.deceleration,
              "vehicle/limits/emergency_deceleration");
  if (steering_angle && !(wheelbase > 0.0))
  {
    throw std::invalid_argument("steering_angle = true, must be false for a vehicle without a wheelbase");
  }
}

TwistBase::TwistBase(const TwistBaseOptions& options) : options_(options)
{
  options_.validate();
}

bool TwistBase::onOdometry(const Pose2& pose, double speed, double yaw_rate, int64_t now_ns)
{
  if (!pose.finite() || !std::isfinite(speed) || !std::isfinite(yaw_rate))
  {
    ++counters_.refused_frames;
    return false;
  }
  ++counters_.statuses;
  if (last_pose_)
  {
    const Pose2 step = last_pose_->inverse() * pose;
    const double way = step.position().norm();
    const double explained =
        std::max(std::abs(speed), std::abs(odometry_.speed)) * secondsBetween(odometry_.stamp_ns, now_ns);
    if (way > explained + JUMP)
    {
      ++counters_.restarts;
    }
    else
    {
      odometry_.pose = odometry_.pose * step;
      odometry_.distance += way;
    }
  }
  last_pose_ = pose;
  odometry_.speed = speed;
  odometry_.yaw_rate = yaw_rate;
  odometry_.stamp_ns = now_ns;
  ++odometry_.count;
  return true;
}

bool TwistBase::setMotion(const Motion& motion, int64_t now_ns)
{
  if (!isUsable(motion, options_.limits, &counters_, &motion_cut_))
  {
    return false;
  }
  motion_ = motion;
  motion_ns_ = now_ns;
  return true;
}

void TwistBase::emergencyStop(const std::string& reason)
{
  emergency_ = true;
  emergency_reason_ = reason;
}

void TwistBase::release()
{
  emergency_ = false;
  motion_.reset();
}

bool TwistBase::heard(int64_t now_ns) const
{
  return odometry_.count > 0 && secondsBetween(odometry_.stamp_ns, now_ns) <= options_.odometry_timeout_s;
}

bool TwistBase::motionHolds(int64_t now_ns) const
{
  return motion_ && secondsBetween(motion_ns_, now_ns) <= options_.motion_timeout_s;
}

Twist TwistBase::poll(int64_t now_ns)
{
  ++counters_.commands;
  const double dt = std::clamp(secondsBetween(command_ns_, now_ns), 0.0, 2.0 * options_.command_period_s);
  command_ns_ = now_ns;
  Twist twist;
  if (!heard(now_ns))
  {
    commanded_speed_ = 0.0;  // nobody knows what it does
    return twist;
  }
  const bool moves = !emergency_ && motionHolds(now_ns);
  Command command;
  command.curvature = motion_ ? motion_->curvature : curvature_;
  command.speed = moves ? motion_->speed : 0.0;
  command.deceleration = moves        ? motion_->deceleration
                         : emergency_ ? options_.limits.deceleration
                                      : options_.stop_deceleration;
  command = withinLimits(command, options_.limits, nullptr);
  curvature_ = command.curvature;
  commanded_speed_ = rampSpeed(commanded_speed_, command.speed, options_.limits.acceleration, command.deceleration, dt);
  twist.linear = commanded_speed_;
  twist.angular = options_.steering_angle ? std::atan(options_.wheelbase * curvature_) : commanded_speed_ * curvature_;
  return twist;
}

HostMode TwistBase::mode(int64_t now_ns, std::string* detail) const
{
  if (!heard(now_ns))
  {
    *detail = odometry_.count == 0
                  ? std::string("no odometry yet; is the chassis unplugged, or its driver not running?")
                  : "no odometry for " + format("%.2f s", secondsBetween(odometry_.stamp_ns, now_ns)) +
                        "; is the chassis unplugged, or its driver not running?";
    return HostMode::DISCONNECTED;
  }
  if (emergency_)
  {
    *detail = emergency_reason_ + "; stays until it is released";
    return HostMode::EMERGENCY_STOP;
  }
  if (motion_ && !motionHolds(now_ns))
  {
    *detail = "no motion command for " + format("%.2f s", secondsBetween(motion_ns_, now_ns)) +
              "; drives again when they come";
    return HostMode::STOPPED_WATCHDOG;
  }
  *detail = motion_cut_ ? "motion cut to the limits" : "";
  return motion_ && motion_->speed != 0.0 ? HostMode::DRIVING : HostMode::READY;
}

HostState TwistBase::state(int64_t now_ns) const
{
  HostState state;
  state.mode = mode(now_ns, &state.detail);
  state.moving = std::abs(odometry_.speed) >= STANDS_BELOW;
  state.status.speed = odometry_.speed;
  state.status.curvature = state.moving ? odometry_.yaw_rate / odometry_.speed : curvature_;
  state.odometry = odometry_;
  state.counters = counters_;
  return state;
}

}  // namespace pi_vehicle::chassis
