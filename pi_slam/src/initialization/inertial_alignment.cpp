#include "initialization/inertial_alignment.h"

#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace pi_slam
{

namespace
{

constexpr int BIAS_ITERATIONS = 6;
constexpr double ROTATION_HUBER = 0.005;  ///< [rad]
constexpr int GRAVITY_ITERATIONS = 5;
constexpr double LEAST_POSITION_SIGMA = 0.002;  ///< what stereo is believed at best [m]
/// Standard deviation of an accelerometer's bias [m/s^2], for positions with an error of POSITION_SIGMA [m].
constexpr double ACCEL_BIAS_SIGMA = 0.2;
constexpr double POSITION_SIGMA = 0.005;

using Unknowns = Eigen::Matrix<double, 11, 1>;  // c, v_0, two angles of g, accelerometer's bias

}  // namespace

Eigen::Vector3d alignRotations(const std::vector<StereoOdometry::Pose>& poses,
                               std::vector<ImuPreintegration>* integrals, double* rms)
{
  ImuBias bias = integrals->front().bias();
  double squares = 0.0;
  for (int iteration = 0; iteration <= BIAS_ITERATIONS; ++iteration)
  {
    Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    squares = 0.0;
    for (size_t k = 0; k < integrals->size(); ++k)
    {
      ImuPreintegration& integral = (*integrals)[k];
      integral.reintegrate(bias);
      const Eigen::Vector3d error = logSo3(integral.deltaR().conjugate() * rotationBetween(poses[k], poses[k + 1]));
      const Eigen::Matrix3d J = integral.biasJacobian().block<3, 3>(3, 0);
      const double weight = error.norm() <= ROTATION_HUBER ? 1.0 : ROTATION_HUBER / error.norm();
      H += weight * J.transpose() * J;
      b += weight * J.transpose() * error;
      squares += error.squaredNorm();
    }
    const Eigen::Vector3d delta = H.ldlt().solve(b);
    // The last pass only evaluates.
    if (iteration == BIAS_ITERATIONS || !delta.allFinite() || delta.norm() < 1e-7)
    {
      break;
    }
    bias.gyro += delta;
  }
  *rms = std::sqrt(squares / static_cast<double>(integrals->size()));
  return bias.gyro;
}

InertialAlignment alignPositions(const std::vector<StereoOdometry::Pose>& poses,
                                 const std::vector<ImuPreintegration>& integrals, double gravity)
{
  InertialAlignment alignment;
  const size_t count = poses.size();
  std::vector<double> times(1, 0.0);
  std::vector<Eigen::Vector3d> ways(1, Eigen::Vector3d::Zero());    // D
  std::vector<Eigen::Vector3d> speeds(1, Eigen::Vector3d::Zero());  // its derivative
  std::vector<Eigen::Matrix3d> ways_by_bias(1, Eigen::Matrix3d::Zero());
  std::vector<Eigen::Matrix3d> speeds_by_bias(1, Eigen::Matrix3d::Zero());
  for (size_t k = 0; k + 1 < count; ++k)
  {
    const double dt = integrals[k].duration();
    times.push_back(times[k] + dt);
    ways.push_back(ways[k] + dt * speeds[k] + poses[k].q * integrals[k].deltaP());
    speeds.push_back(speeds[k] + poses[k].q * integrals[k].deltaV());
    const Eigen::Matrix3d R = poses[k].q.toRotationMatrix();
    ways_by_bias.push_back(ways_by_bias[k] + dt * speeds_by_bias[k] +
                           R * integrals[k].biasJacobian().block<3, 3>(0, 3));
    speeds_by_bias.push_back(speeds_by_bias[k] + R * integrals[k].biasJacobian().block<3, 3>(6, 3));
  }

  // Axes do not mix: one 3x3 problem [c, v_0, g] with three right-hand sides.
  Eigen::Matrix3d N = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d right = Eigen::Matrix3d::Zero();
  for (size_t k = 0; k < count; ++k)
  {
    const Eigen::Vector3d row(1.0, times[k], 0.5 * times[k] * times[k]);
    N += row * row.transpose();
    right += row * (poses[k].p - ways[k]).transpose();
  }
  const Eigen::Matrix3d free = N.ldlt().solve(right);
  Eigen::Vector3d g = free.row(2);
  alignment.gravity_found = g.norm();
  if (count < 4 || !free.allFinite() || alignment.gravity_found < 0.1 * gravity)
  {
    return alignment;
  }

  Eigen::Matrix<double, 11, 11> H;
  Unknowns solution = Unknowns::Zero();
  const double prior = POSITION_SIGMA * POSITION_SIGMA / (ACCEL_BIAS_SIGMA * ACCEL_BIAS_SIGMA);
  g *= gravity / g.norm();
  for (int iteration = 0; iteration < GRAVITY_ITERATIONS; ++iteration)
  {
    Eigen::Matrix<double, 3, 2> tangent;
    tangent.col(0) = g.unitOrthogonal() * gravity;
    tangent.col(1) = g.cross(tangent.col(0)) / gravity;
    H.setZero();
    H.diagonal().tail<3>().setConstant(prior);
    Unknowns b = Unknowns::Zero();
    for (size_t k = 0; k < count; ++k)
    {
      const double t = times[k];
      Eigen::Matrix<double, 3, 11> A;
      A << Eigen::Matrix3d::Identity(), t * Eigen::Matrix3d::Identity(), 0.5 * t * t * tangent, ways_by_bias[k];
      H += A.transpose() * A;
      b += A.transpose() * (poses[k].p - ways[k] - 0.5 * t * t * g);
    }
    solution = H.ldlt().solve(b);
    if (!solution.allFinite())
    {
      return alignment;
    }
    g += tangent * solution.segment<2>(6);
    g *= gravity / g.norm();
  }

  double squares = 0.0;
  const Eigen::Vector3d v0 = solution.segment<3>(3);
  alignment.accel_bias = solution.tail<3>();
  for (size_t k = 0; k < count; ++k)
  {
    const double t = times[k];
    alignment.velocities.push_back(v0 + t * g + speeds[k] + speeds_by_bias[k] * alignment.accel_bias);
    squares +=
        (poses[k].p - ways[k] - ways_by_bias[k] * alignment.accel_bias - 0.5 * t * t * g - solution.head<3>() - t * v0)
            .squaredNorm();
  }
  alignment.gravity = g;
  alignment.position_rms = std::sqrt(squares / static_cast<double>(3 * count));
  const double sigma = std::max(LEAST_POSITION_SIGMA, std::sqrt(squares / static_cast<double>(3 * count - 8)));
  const Eigen::Matrix<double, 11, 11> covariance =
      sigma * sigma * H.ldlt().solve(Eigen::Matrix<double, 11, 11>::Identity());
  alignment.velocity_sigma = std::sqrt(covariance.block<3, 3>(3, 3).diagonal().maxCoeff());
  alignment.gravity_sigma = std::sqrt(covariance.block<2, 2>(6, 6).diagonal().maxCoeff());
  alignment.solvable = true;
  return alignment;
}

Eigen::Quaterniond levelRotation(const Eigen::Vector3d& up, const Eigen::Vector3d& forward)
{
  const Eigen::Vector3d z = up.normalized();
  const Eigen::Vector3d x = (forward - z * z.dot(forward)).normalized();
  Eigen::Matrix3d R;
  R.row(0) = x;
  R.row(1) = z.cross(x);
  R.row(2) = z;
  return Eigen::Quaterniond(R).normalized();
}

}  // namespace pi_slam
