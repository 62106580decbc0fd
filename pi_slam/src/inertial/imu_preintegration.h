#pragma once

#include <pi_slam/imu_sample.h>
#include "inertial/imu_correction.h"
#include "inertial/nav_state.h"

#include <Eigen/Geometry>
#include <vector>

namespace pi_slam
{

/// The motion between two times as an IMU measured it, independent of where it began: Forster, Carlone, Dellaert and
/// Scaramuzza, "On-Manifold Preintegration for Real-Time Visual-Inertial Odometry", TRO 2017. Midpoint rule: between
/// two samples the mean of their rates and forces acts.
///
/// Copyable. Not thread safe. Keeps its samples, so that it can be integrated again for other biases.
class ImuPreintegration
{
public:
  /// @param bias  about which the Jacobians hold.
  ImuPreintegration(const ImuModel& model, const ImuBias& bias);

  /// Appends the interval from `from` to `to`; the first call begins the integral. Inner intervals must follow each
  /// other. O(1).
  /// @param to            its stamp is after that of `from`.
  /// @param noise_factor  of the sensor's standard deviations in this interval; in [1, 1e5].
  /// @throws std::invalid_argument for stamps that do not increase, an interval that does not begin where the integral
  ///         ends, samples that are not finite or above 1e6, or a factor out of range; nothing has changed then.
  void append(const ImuSample& from, const ImuSample& to, double noise_factor = 1.0);

  /// Appends the intervals of another integral that begins where this one ends, for the biases of this one.
  /// @throws std::invalid_argument if it begins elsewhere; nothing has changed then.
  void append(const ImuPreintegration& next);

  /// Does it all again for other biases.
  /// @throws std::invalid_argument if they are not finite; nothing has changed then.
  void reintegrate(const ImuBias& bias);

  bool empty() const { return intervals_.empty(); }
  /// Both for integrals that are not empty() only.
  int64_t startNs() const { return intervals_.front().from.stamp_ns; }
  int64_t endNs() const { return intervals_.back().to.stamp_ns; }
  double duration() const { return duration_s_; }  ///< [s]
  const ImuBias& bias() const { return bias_; }

  const Eigen::Quaterniond& deltaR() const { return delta_R_; }  ///< R_begin_end
  const Eigen::Vector3d& deltaV() const { return delta_v_; }     ///< in the begin's body frame, without gravity [m/s]
  const Eigen::Vector3d& deltaP() const { return delta_p_; }     ///< likewise [m]

  /// Covariance of the errors [p, theta, v, bg, ba] (truth minus this) of the three deltas and of the biases' walk,
  /// 15x15 in the order of NavState. Symmetric, positive definite once an interval was appended.
  const Matrix15d& covariance() const { return covariance_; }

  /// d [p, theta, v] / d [bg, ba] (rows 0..8, columns 0..5) at bias().
  const Eigen::Matrix<double, 9, 6>& biasJacobian() const { return bias_jacobian_; }

  /// Deltas corrected to first order for other biases (eq. 44).
  Eigen::Quaterniond correctedR(const ImuBias& bias) const;
  Eigen::Vector3d correctedV(const ImuBias& bias) const;
  Eigen::Vector3d correctedP(const ImuBias& bias) const;

  /// The state at the end, predicted from the state at the beginning (its biases, first-order corrected). The stamp is
  /// that of `begin` plus the duration.
  NavState predict(const NavState& begin) const;

  /// Transition of the errors of a state from beginning to end about the prediction: d_end = F d_begin + noise with
  /// covariance() rotated into the odom frame, which `Q` gets. Either may be null.
  void transition(const NavState& begin, Matrix15d* F, Matrix15d* Q) const;

private:
  struct Interval
  {
    ImuSample from;
    ImuSample to;
    double noise_factor;
  };
  friend class ImuBuffer;  // reserves intervals_
  void integrate(const Interval& interval);

  ImuModel model_;
  ImuBias bias_;
  std::vector<Interval> intervals_;
  double duration_s_ = 0.0;
  Eigen::Quaterniond delta_R_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d delta_v_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d delta_p_ = Eigen::Vector3d::Zero();
  Matrix15d covariance_ = Matrix15d::Zero();
  Eigen::Matrix<double, 9, 6> bias_jacobian_ = Eigen::Matrix<double, 9, 6>::Zero();
};

/// Samples of an IMU in order of time, and the integral between any two times within them.
/// Not thread safe.
class ImuBuffer
{
public:
  /// @throws std::invalid_argument for a model out of range.
  explicit ImuBuffer(const ImuModel& model);

  /// Longest distance of two samples that is not a gap [s]: 5 periods, at least 25 ms.
  double longestInterval() const { return longest_interval_s_; }

  enum class Added
  {
    OK,
    OUT_OF_ORDER,  ///< not after the last one: ignored
    GAP,           ///< stored, but there is a gap before it (whether saturated or not)
    SATURATED,     ///< stored; an axis at the sensor's limit holds its last value
    NOT_FINITE,    ///< ignored; so are values above 1e6
  };
  Added add(const ImuSample& sample);

  bool empty() const { return samples_.empty(); }
  /// Both for buffers that are not empty() only.
  int64_t firstNs() const { return samples_.front().stamp_ns; }
  int64_t lastNs() const { return samples_.back().stamp_ns; }

  struct Quality
  {
    bool complete = false;   ///< samples reach over both ends
    double gap_s = 0.0;      ///< longest distance of neighbouring samples within, if above the limit; else 0
    bool saturated = false;  ///< by any sample within
  };

  /// Integral over [from_ns, to_ns]; samples at the ends are interpolated, gaps are bridged by interpolation with noise
  /// raised (standard deviation times 10; times 300 beside samples with saturated axes). Empty if not complete.
  /// @param quality  may be null.
  /// @throws std::invalid_argument if to_ns is not after from_ns.
  ImuPreintegration integrate(int64_t from_ns, int64_t to_ns, const ImuBias& bias, Quality* quality) const;

  /// Mean rate and force, and their standard deviations per axis, over [from_ns, to_ns].
  /// @return false for fewer than 3 samples; nothing is written then.
  bool statistics(int64_t from_ns, int64_t to_ns, Eigen::Vector3d* w_mean, Eigen::Vector3d* f_mean,
                  Eigen::Vector3d* w_deviation, Eigen::Vector3d* f_deviation) const;

  /// Corrects all samples; those to come are corrected already.
  void correct(const ImuCorrection& correction);

  /// Reaches to stamp_ns at least: the last sample holds until then.
  void holdUntil(int64_t stamp_ns);

  /// Forgets samples that are older than the last one at or before stamp_ns.
  void forgetBefore(int64_t stamp_ns);

private:
  ImuModel model_;
  double longest_interval_s_;
  std::vector<ImuSample> samples_;  ///< few hundred: erased from the front in bulk
};

}  // namespace pi_slam
