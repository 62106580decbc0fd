#pragma once

#include "inertial/nav_state.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>

namespace pi_slam
{

/// What the wheels say, in their frame: x forward, y left, z up, origin where the chassis measures its speed.
struct WheelSample
{
  int64_t stamp_ns = 0;
  Eigen::Vector2d v = Eigen::Vector2d::Zero();  ///< forward and to the left [m/s]
  double yaw_rate = 0.0;                        ///< [rad/s]

  bool isFinite() const { return v.allFinite() && std::isfinite(yaw_rate); }
};

struct WheelOptions
{
  double scale_deviation = 0.02;    ///< how well the speed's scale is known at first; in [0.001, 0.3]
  double speed_noise = 0.001;       ///< of a mean over a tenth of a second [m/s]; > 0
  double speed_noise_ratio = 0.01;  ///< likewise, part of the speed; in [0, 0.5]
  double side_noise =
      0.05;               ///< a vehicle on wheels does not go sideways (non-holonomic): deviation from that [m/s]; > 0
  double up_noise = 0.1;  ///< nor off the plane of the ground: likewise, bumps [m/s]; > 0
  /// The wheels' frame in the body's; of the calibration, no parameter.
  Eigen::Isometry3d T_body_wheels = Eigen::Isometry3d::Identity();

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// The scale of the wheels' speed: what they say times `value` is true.
struct WheelScale
{
  double value = 1.0;
  double deviation = 0.02;
};

/// That wheels and cameras measure different ways, and what that may come from; empty: the scale is near 1, or not yet
/// known well enough.
std::string scaleComplaint(const WheelScale& scale);

/// The way of the wheels between two times, integrated with the rotation of the IMU.
struct WheelWay
{
  Eigen::Vector3d moved = Eigen::Vector3d::Zero();  ///< as the wheels say, without the body's turn about their origin,
                                                    ///< in the body frame at the beginning [m]
  double length = 0.0;                              ///< [m]
  double duration = 0.0;                            ///< [s]
  bool valid = true;                                ///< the wheels told all the time, and were believed

  /// Continues by another that begins where this one ends. @param R  of the body, from the end to the beginning of
  /// this.
  void append(const WheelWay& next, const Eigen::Matrix3d& R);
  /// Standard deviations in the wheels' frame, forward, left, up [m].
  Eigen::Vector3d deviation(const WheelOptions& options, const WheelScale& scale) const;
};

/// Recent samples. Not thread safe.
class WheelBuffer
{
public:
  /// A stamp that is a second and more before the last begins a new time.
  /// @return false for one that is not finite or not after the last.
  bool add(const WheelSample& sample);
  bool empty() const { return samples_.empty(); }
  const WheelSample& newest() const { return samples_.back(); }
  /// Mean over a span, linear between samples; the newest holds for 0.1 s. nullopt: not known over all of it.
  std::optional<WheelSample> mean(int64_t from_ns, int64_t to_ns) const;
  /// Whether all samples over a span tell rest, or all together motion; nullopt: neither for sure, or not known.
  std::optional<bool> atRest(int64_t from_ns, int64_t to_ns) const;
  void forgetBefore(int64_t stamp_ns);

private:
  std::deque<WheelSample> samples_;
};

enum class WheelVerdict
{
  USED,
  REFUSED,  ///< slip or skid: at odds with the state
};

/// Corrects a state by the speed of the wheels and by what a vehicle on wheels does not do: go sideways, or off the
/// ground. Robust: what is beyond four standard deviations is refused, beyond two it counts less.
/// @param speed    of the body's origin in odom, at the time of the wheels' or as a mean over the same span [m/s].
/// @param w_body   likewise, angular rate without bias [rad/s].
/// @param q        likewise, R_odom_body.
/// @param residual forward, as the wheels say minus as the state says [m/s]; may be null
WheelVerdict correctByWheels(const WheelSample& wheels, const WheelOptions& options, const WheelScale& scale,
                             const Eigen::Vector3d& speed, const Eigen::Vector3d& w_body, const Eigen::Quaterniond& q,
                             NavState* state, Matrix15d* covariance, double* residual);

/// Compares the wheels with pictures and IMU while these are sure: refines the scale, and finds wheels that cannot be
/// used since their sign, scale or frame is wrong.
class WheelMonitor
{
public:
  explicit WheelMonitor(const WheelOptions& options) : options_(options) { scale_.deviation = options.scale_deviation; }

  /// The state was corrected by pictures. @param way  of the wheels since the last call or skip().
  void add(const NavState& state, const WheelWay& way, double wheel_turn, double gyro_turn);
  /// The state was not: begins a new comparison.
  void skip() { begin_.reset(); }

  const WheelScale& scale() const { return scale_; }
  /// Why the wheels are not used: object, value, way out; empty: they are.
  const std::string& fault() const { return fault_.empty() ? turn_fault_ : fault_; }

private:
  void begin(const NavState& state);
  void judge(double forward, double side, double said);

  const WheelOptions options_;
  WheelScale scale_;
  std::string fault_;
  std::string turn_fault_;
  std::optional<NavState> begin_;
  Eigen::Quaterniond last_q_ = Eigen::Quaterniond::Identity();
  WheelWay way_;
  double wheel_turn_ = 0.0;
  double gyro_turn_ = 0.0;
  int wrong_ = 0;
  int wrong_turns_ = 0;
};

}  // namespace pi_slam
