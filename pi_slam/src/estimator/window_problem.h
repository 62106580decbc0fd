#pragma once

#include "estimator/factors.h"

#include "estimator/window_estimator.h"
#include "front_end/frame_features.h"
#include "inertial/imu_correction.h"
#include "inertial/nav_state.h"

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <vector>

namespace pi_slam::estimator
{

/// One camera's view of a landmark from a keyframe.
struct View
{
  uint64_t keyframe = 0;  ///< serial number
  int camera = 0;
  Eigen::Vector3d bearing;
  Eigen::Matrix<double, 2, 3> tangent;  ///< scaled to standard deviations
};

struct Landmark
{
  LandmarkEstimate estimate;
  bool known = false;       ///< estimate.p_odom holds
  bool used = false;        ///< by the last optimisation
  std::vector<View> views;  ///< by increasing keyframe, left before right
};

struct Keyframe
{
  NavState state;
};

/// Pose of the body at a keyframe.
struct BodyPose
{
  explicit BodyPose(const NavState& state) : R_odom_body(state.q.toRotationMatrix()), p_odom_body(state.p) {}

  Eigen::Matrix3d R_odom_body;
  Eigen::Vector3d p_odom_body;
};

/// What changes with a correction of the IMU. The body is where the cameras say. So what is up for it turns by what
/// their mounting was off, unless the accelerometer's bias had taken that: it has in part where the vehicle has turned.
/// The split is the one that leaves the smallest bias. The heading stays, for nothing tells it.
struct Turn
{
  /// @param state  that the correction finds; all turns about its position
  Turn(const ImuCorrection& due, const NavState& state, double gravity);
  void apply(NavState* state) const;

  Eigen::Vector3d centre;      ///< in odom [m]
  Eigen::Matrix3d R_turn;      ///< of odom
  Eigen::Matrix3d R_body_imu;  ///< of the correction
  Eigen::Vector3d accel_bias;  ///< that is added [m/s^2]
};

/// What the states and landmarks that have left the window tell about those inside: 0.5 d^T H d + b^T d with d = states
/// - linearised.
///
/// It knows nothing about velocity and biases but those of the first state: what left was tied to no others.
struct Prior
{
  Eigen::MatrixXd H;  ///< 15 per state
  Eigen::VectorXd b;
  std::vector<NavState> linearized;  ///< of the first states of the window
  bool marginal = false;             ///< holds what was linearised at these states, so that others must not be used

  /// What it knows turns along with the states.
  void turn(const Turn& turn);
  /// Takes out what it claims to know of the errors in each column, which have this standard deviation; where it has
  /// its minimum, it keeps it. Relations between the states that no column touches stay as they are.
  void loosen(const Eigen::MatrixXd& errors);
};

/// States, landmarks and all that ties them together.
struct WindowProblem
{
  std::array<CameraGeometry, 2> cameras;
  double huber = 2.0;  ///< [standard deviations]

  uint64_t first_keyframe = 0;  ///< serial number of keyframes[0]
  std::vector<Keyframe> keyframes;
  std::vector<StateLink> links;  ///< links[i] from keyframes[i] to keyframes[i + 1]
  std::map<int64_t, Landmark> landmarks;
  Prior prior;

  size_t slot(const View& view) const { return static_cast<size_t>(view.keyframe - first_keyframe); }
  BodyPose bodyPose(const View& view) const { return BodyPose(keyframes[slot(view)].state); }
};

/// Robust cost of an error of squared norm `squared` and the weight of its square in the normal equations (Huber).
inline double huberCost(double squared, double huber, double* weight)
{
  if (squared <= huber * huber)
  {
    *weight = 1.0;
    return 0.5 * squared;
  }
  const double norm = std::sqrt(squared);
  *weight = huber / norm;
  return huber * (norm - 0.5 * huber);
}

}  // namespace pi_slam::estimator
