#pragma once

#include <pi_slam/so3.h>
#include <pi_slam/trajectory_file.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

namespace pi_slam
{

/// Test support of the estimators and of pi_simulation: smooth motion through given poses. A uniform cubic B-spline of
/// positions and a cumulative cubic B-spline of rotations (Kim, Kim and Shin 1995; Lovegrove, Patron-Perez and Sibley
/// 2013), twice continuously differentiable, with exact derivatives by the recursion of Sommer, Usenko, Schubert,
/// Demmel and Cremers (CVPR 2020). Immutable once built: any thread may evaluate.
class SplineTrajectory
{
public:
  struct State
  {
    Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();
    Eigen::Vector3d v_world = Eigen::Vector3d::Zero();     ///< velocity of the body in the world [m/s]
    Eigen::Vector3d a_world = Eigen::Vector3d::Zero();     ///< acceleration without gravity [m/s^2]
    Eigen::Vector3d w_body = Eigen::Vector3d::Zero();      ///< angular rate in the body frame [rad/s]
    Eigen::Vector3d alpha_body = Eigen::Vector3d::Zero();  ///< derivative of w_body [rad/s^2]
  };

  /// Least-squares fit by progressive iteration (LSPIA: Deng and Lin, Computer-Aided Design 2014), with residuals on
  /// SO(3) for rotations. With about as many knots as poses it passes through them; with fewer it smooths their noise.
  /// @param poses            two or more, with increasing stamps.
  /// @param knot_interval_s  0: 4 samples of the input, but at most 0.1 s, at least one sample, and at least 0.05 s for
  ///                         positions and 0.02 s for rotations. Measured ground truth jumps by millimetres; shorter
  ///                         intervals turn these jumps into accelerations of tens of m/s^2.
  /// @throws std::invalid_argument for fewer poses, stamps that do not increase, or an interval outside [0.001, 10].
  static SplineTrajectory fit(const std::vector<StampedPose>& poses, double knot_interval_s = 0.0);

  int64_t startNs() const { return start_ns_; }
  int64_t endNs() const { return end_ns_; }
  double knotInterval() const { return knot_interval_s_; }  ///< of positions [s]

  /// @throws std::out_of_range outside [startNs, endNs].
  State at(int64_t stamp_ns) const;
  /// @param time_s since startNs.
  /// @throws std::out_of_range outside [0, (endNs - startNs) / 1e9].
  State atSeconds(double time_s) const;

private:
  SplineTrajectory() = default;
  State evaluate(double time_s) const;
  double refine(const std::vector<StampedPose>& poses);
  void updateTurns();

  int64_t start_ns_ = 0;
  int64_t end_ns_ = 0;
  double knot_interval_s_ = 0.0;            ///< of positions
  double turn_interval_s_ = 0.0;            ///< of rotations
  std::vector<Eigen::Vector3d> positions_;  ///< control points; segment i uses i to i + 3
  std::vector<Eigen::Quaterniond> rotations_;
  std::vector<Eigen::Vector3d> turns_;  ///< d_i = log(R_i^T R_i+1) of the rotations_ [rad]
};

}  // namespace pi_slam
