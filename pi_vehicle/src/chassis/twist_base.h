#pragma once

#include <pi_vehicle/chassis/chassis_host.h>

#include <cstdint>
#include <optional>
#include <string>

namespace pi_vehicle::chassis
{

struct TwistBaseOptions
{
  double command_period_s = 0.05;   ///< between twists [s], in [0.005, 0.5]
  double odometry_timeout_s = 0.5;  ///< without odometry, after which the base counts as gone [s], in [0.02, 10]
  double motion_timeout_s = 0.3;    ///< a motion holds so long [s], in [0.02, 10]
  double stop_deceleration = 1.5;   ///< where motions cease [m/s^2], in [0.01, limits.deceleration]
  Limits limits;
  /// Of the front wheels [rad] in the twist's angular.z, as some drivers of Ackermann steering want it. Without, it is
  /// the yaw rate [rad/s], as differential drives and all others do.
  bool steering_angle = false;
  double wheelbase = 0.75;  ///< of the vehicle, for the steering angle [m]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

struct Twist
{
  double linear = 0.0;   ///< along x [m/s]
  double angular = 0.0;  ///< about z [rad/s], or the steering angle [rad]
};

/// A base that knows nothing but velocities and odometry: the watchdogs, latch, limits and ramps that a chassis has of
/// its own are here. Its wheels need a watchdog of their own, which stops them when twists cease. Without ROS, thread
/// or clock: the caller passes monotonic time. Not thread safe.
class TwistBase
{
public:
  /// @throws std::invalid_argument for wrong options.
  explicit TwistBase(const TwistBaseOptions& options);

  /// @param pose  in the base's frame of odometry; a jump counts as a restart of the base, and no way.
  /// @return false if a number is not finite.
  bool onOdometry(const Pose2& pose, double speed, double yaw_rate, int64_t now_ns);
  /// @return false if a number is not finite; the last motion then holds until it times out.
  bool setMotion(const Motion& motion, int64_t now_ns);
  /// Latched until release(). @param reason  for people.
  void emergencyStop(const std::string& reason);
  /// The vehicle stands until a motion that is newer than this call.
  void release();

  /// @return the twist to send; call once per command_period_s.
  Twist poll(int64_t now_ns);
  HostState state(int64_t now_ns) const;

private:
  bool heard(int64_t now_ns) const;
  bool motionHolds(int64_t now_ns) const;
  HostMode mode(int64_t now_ns, std::string* detail) const;

  const TwistBaseOptions options_;
  HostCounters counters_;
  std::optional<Pose2> last_pose_;  ///< of the base
  WheelOdometry odometry_;
  std::optional<Motion> motion_;
  int64_t motion_ns_ = 0;
  bool motion_cut_ = false;
  bool emergency_ = false;
  std::string emergency_reason_;
  double commanded_speed_ = 0.0;  ///< ramped
  double curvature_ = 0.0;        ///< of the last twist
  int64_t command_ns_ = 0;
};

}  // namespace pi_vehicle::chassis
