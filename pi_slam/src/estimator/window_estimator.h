#pragma once

#include <pi_slam/stereo_calibration.h>
#include "estimator/factors.h"
#include "front_end/frame_features.h"
#include "inertial/imu_preintegration.h"
#include "inertial/nav_state.h"
#include "initialization/initializer.h"

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace pi_slam
{

struct WindowOptions
{
  int keyframes = 9;          ///< states in the window; in [3, 30]
  int max_landmarks = 120;    ///< used in one optimisation; in [20, 2000]
  int max_iterations = 5;     ///< in [1, 50]
  double pixel_noise = 0.7;   ///< standard deviation of an observation [px]; in [0.1, 10]
  double huber_px = 2.0;      ///< where the robust loss begins [px]; in [0.1, 100]
  double max_error_px = 6.0;  ///< landmarks whose mean error is larger are dropped; in [0.5, 100]

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// A landmark as the window knows it.
struct LandmarkEstimate
{
  int64_t id = 0;
  Eigen::Vector3d p_odom = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< given the poses that saw it [m^2]
  int keyframes = 0;                                     ///< of the window that saw it
};

struct WindowReport
{
  int iterations = 0;
  int landmarks = 0;              ///< that were used
  int observations = 0;           ///< of them
  double mean_error_px = 0.0;     ///< of the observations, afterwards
  bool failed = false;            ///< numbers that are not finite, or no descent: states are as before
  std::vector<int64_t> rejected;  ///< landmarks dropped since their observations do not agree
};

/// States of the last keyframes and the landmarks that they saw, optimised together: reprojection errors of both
/// cameras on the tangent plane of the observed bearing, preintegrated IMU between neighbours (Forster et al., TRO
/// 2017), walking biases, and a prior that keeps what marginalised states and landmarks knew (Leutenegger, Lynen,
/// Bosse, Siegwart and Furgale, "Keyframe-based visual-inertial odometry", IJRR 2015).
///
/// Landmarks of a keyframe that leaves are marginalised with it unless they are still seen; those lose its observation.
/// Not thread safe. Deterministic.
class WindowEstimator
{
public:
  /// @throws std::invalid_argument for options or a calibration out of range.
  WindowEstimator(const StereoCalibration& calibration, const ImuModel& model, const WindowOptions& options);
  ~WindowEstimator();

  /// Starts again from an initial solution. A prior fixes position and heading of its first state.
  /// @param imu  covers the states.
  /// @throws std::invalid_argument if there are fewer than two states, or the IMU does not cover them.
  void start(const InitialSolution& solution, const ImuBuffer& imu);

  /// Starts again from one state of known covariance.
  void start(const NavState& state, const Matrix15d& covariance, const FrameFeatures& features);

  bool empty() const;

  /// Appends a keyframe; the oldest one is marginalised if there are too many.
  /// @param state       guess of its state
  /// @param since_last  from the newest keyframe to this one
  /// @param still       the body did not move in between: the IMU is not used but for the time that went by
  /// @param wheels      their way in between, if it is known
  /// @throws std::logic_error if empty() or the integral does not join the two.
  void addKeyframe(const NavState& state, const FrameFeatures& features, const ImuPreintegration& since_last,
                   bool still, const std::optional<estimator::WheelTie>& wheels = std::nullopt);

  /// The IMU was corrected: its links are integrated again. States and landmarks turn about the newest keyframe with
  /// what is up then, and what left the window is believed less. Keyframes older than the samples leave. To be followed
  /// by optimize().
  /// @param imu  corrected; covers the newest keyframe.
  void correct(const ImuCorrection& due, const ImuBuffer& imu);

  /// @param max_iterations  at most options.max_iterations.
  WindowReport optimize(int max_iterations);

  const NavState& newest() const;
  const Matrix15d& newestCovariance() const;  ///< as of the last optimize()
  /// As newestCovariance(), but with the pose taken as exact: what a filter may begin with that takes the landmarks as
  /// exact too. What the pose is off by, the landmarks around it are as well, and so their views say nothing about it.
  const Matrix15d& newestRelativeCovariance() const;
  std::vector<NavState> states() const;  ///< oldest first

  /// @return null if it is not known in space. Valid until the next change.
  const LandmarkEstimate* landmark(int64_t id) const;
  std::vector<LandmarkEstimate> landmarks() const;  ///< by increasing id

  void clear();

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_slam
