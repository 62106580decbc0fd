#pragma once

#include <pi_slam/stereo_calibration.h>
#include "estimator/factors.h"
#include "front_end/frame_features.h"
#include "inertial/imu_preintegration.h"
#include "inertial/nav_state.h"
#include "inertial/wheels.h"

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace pi_slam
{

/// One camera's view of a landmark known in space.
struct LandmarkView
{
  int64_t id = 0;
  int camera = 0;
  Eigen::Vector3d bearing;     ///< observed, camera frame, unit length
  Eigen::Vector3d p_odom;      ///< of the landmark
  Eigen::Matrix3d covariance;  ///< of p_odom [m^2]
};

struct FilterReport
{
  int iterations = 0;
  int used = 0;                   ///< views within the gate
  int refused = 0;                ///< views outside of it
  std::vector<int64_t> outliers;  ///< landmarks with a view that disagrees, by increasing id
  bool updated = false;           ///< false: too few views agreed, the state is the predicted one
};

/// The newest state and its covariance, from pair to pair: prediction by preintegrated IMU, correction by an iterated
/// extended Kalman filter (Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", 1993) with
/// the views of known landmarks, whose uncertainty counts as noise. Huber weights; views beyond the gate of the
/// prediction are left out. Not thread safe.
class FrameFilter
{
public:
  /// @param pixel_noise  standard deviation of a view [px].
  FrameFilter(const StereoCalibration& calibration, double pixel_noise);

  void reset(const NavState& state, const Matrix15d& covariance);

  /// @param since_last  from the state's stamp on.
  void predict(const ImuPreintegration& since_last);

  /// Corrects by the mean of the wheels over the last step.
  /// @param before  the state at its beginning. @param[out] residual  as correctByWheels().
  WheelVerdict update(const WheelSample& mean, const WheelOptions& options, const WheelScale& scale,
                      const NavState& before, double* residual);

  /// @param min_used  fewer views within the gate leave the state as predicted.
  FilterReport update(const std::vector<LandmarkView>& views, int min_used);

  /// Corrects by standing still: pose as in `anchor`, whose pose's covariance stays; no velocity; biases by what the
  /// IMU said meanwhile. Covariances are those with respect to the landmarks (newestRelativeCovariance() of the
  /// window): beside the uncertainty of an absolute pose, what standing still tells about the biases would not count.
  void holdStill(const NavState& anchor, const Matrix15d& anchor_covariance);

  const NavState& state() const { return state_; }
  const Matrix15d& covariance() const { return covariance_; }

private:
  std::array<estimator::CameraGeometry, 2> cameras_;
  double pixel_noise_;
  NavState state_;
  Matrix15d covariance_ = Matrix15d::Identity();
};

}  // namespace pi_slam
