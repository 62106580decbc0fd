#pragma once

#include "chassis/chassis_controller.h"

#include <pi_vehicle/decision/pose2.h>

#include <cstdint>

namespace pi_simulation
{

struct StockBaseOptions
{
  chassis::Kind kind = chassis::Kind::CAR_LIKE;
  chassis::Limits limits;
  double yaw_rate = 1.4;              ///< the fastest of a differential base [rad/s]
  double angular_acceleration = 2.4;  ///< likewise [rad/s^2]
  double timeout_s = 0.5;             ///< without a twist, after which it brakes [s]: diff_drive_controller's default
  double distance_error = 0.005;      ///< of what its odometry says: wheels that are so much smaller than it believes
  double turn_error = 0.01;           ///< likewise: a track that is so much wider
};

/// The controller of a base that takes velocities and tells odometry, and knows nothing else of the vehicle, as
/// ros_controllers' diff_drive_controller: limits, ramps, and a timeout. A differential base turns by the twist's yaw
/// rate, on the spot as well; a car-like one steers along the arc of speed and yaw rate. Monotonic time; one thread per
/// instance.
class StockBase
{
public:
  StockBase(const StockBaseOptions& options, int64_t now_ns);

  /// @return false if a number is not finite; the twist is then ignored, and does not feed the timeout.
  bool onTwist(double linear, double angular, int64_t now_ns);
  /// Ramps towards the last twist, and counts the way of the wheels. Call at 50 Hz or faster.
  Setpoint update(const Measurement& measured, int64_t now_ns);

  chassis::Mode mode() const { return mode_; }
  uint64_t twists() const { return twists_; }  ///< received
  /// From where the base was started, by wheels and track as it believes them.
  const pi_vehicle::Pose2& odometry() const { return odometry_; }
  double speed(const Measurement& measured) const { return (1.0 + options_.distance_error) * measured.speed; }
  double yawRate(const Measurement& measured) const { return (1.0 + options_.turn_error) * measured.yaw_rate; }

private:
  const StockBaseOptions options_;
  double linear_ = 0.0;
  double angular_ = 0.0;
  int64_t twist_ns_ = 0;
  uint64_t twists_ = 0;
  bool holds_ = false;    ///< a twist that is not too old
  bool ran_out_ = false;  ///< it was too old, and none has come since
  Setpoint setpoint_;
  chassis::Mode mode_ = chassis::Mode::READY;
  pi_vehicle::Pose2 odometry_;
  bool counted_ = false;  ///< travel_ and turn_ are those of a measurement
  double travel_ = 0.0;
  double turn_ = 0.0;
  int64_t update_ns_;
};

}  // namespace pi_simulation
