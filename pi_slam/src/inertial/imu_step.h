#pragma once

#include <pi_node/durations.h>
#include <pi_slam/imu_sample.h>
#include <pi_slam/so3.h>
#include "inertial/nav_state.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace pi_slam
{

/// Beyond this a rate or a force is no measurement; squares of what is below stay finite.
constexpr double LARGEST_SAMPLE = 1e6;

inline bool isPlausible(const ImuSample& sample)
{
  // Written so that NaN fails.
  return (sample.w.array().abs() <= LARGEST_SAMPLE).all() && (sample.f.array().abs() <= LARGEST_SAMPLE).all();
}

inline ImuSample interpolate(const ImuSample& a, const ImuSample& b, int64_t stamp_ns)
{
  const double s = static_cast<double>(stamp_ns - a.stamp_ns) / static_cast<double>(b.stamp_ns - a.stamp_ns);
  return ImuSample{stamp_ns, (1.0 - s) * a.w + s * b.w, (1.0 - s) * a.f + s * b.f, a.saturated || b.saturated,
                   std::max(a.f_shake, b.f_shake)};
}

/// Noise is larger by this in gaps, and where an axis was at its limit.
constexpr double GAP_NOISE_FACTOR = 10.0;
constexpr double SATURATED_NOISE_FACTOR = 300.0;
constexpr double LARGEST_NOISE_FACTOR = 1e5;
/// What a vehicle does in a gap and the samples at its ends do not tell: an acceleration that grows with the length of
/// the gap [m/s^3], up to hard braking [m/s^2].
constexpr double UNKNOWN_JERK = 3.0;
constexpr double UNKNOWN_ACCELERATION = 1.5;

/// @param gap  between the two samples.
/// @param accel_noise_density  of the sensor [m/s^2/sqrt(Hz)].
inline double noiseFactor(const ImuSample& from, const ImuSample& to, bool gap, double accel_noise_density)
{
  const double sensor = from.saturated || to.saturated ? SATURATED_NOISE_FACTOR : gap ? GAP_NOISE_FACTOR : 1.0;
  if (!gap)
  {
    return sensor;
  }
  // The white noise that makes the speed as uncertain as a steady acceleration for so long.
  const double length_s = pi_node::seconds(to.stamp_ns - from.stamp_ns);
  const double acceleration = std::min(UNKNOWN_JERK * length_s, UNKNOWN_ACCELERATION);
  return std::clamp(acceleration * std::sqrt(length_s) / accel_noise_density, sensor, LARGEST_NOISE_FACTOR);
}

/// A sample whose axes at the sensor's limit hold the value they had before.
/// @param before  earlier sample, or null.
inline ImuSample withoutSaturation(const ImuSample& sample, const ImuSample* before, const ImuModel& model)
{
  ImuSample held = sample;
  for (int axis = 0; axis < 3; ++axis)
  {
    if (std::abs(sample.w[axis]) >= model.gyro_limit)
    {
      held.w[axis] = before != nullptr ? before->w[axis] : 0.0;
      held.saturated = true;
    }
    if (std::abs(sample.f[axis]) >= model.accel_limit)
    {
      held.f[axis] = before != nullptr ? before->f[axis] : 0.0;
      held.saturated = true;
    }
  }
  return held;
}

/// The motion between two samples by the midpoint rule, and its derivatives. `ref` is the frame in which velocities and
/// positions are summed up: the body's at the beginning of a preintegration, or odom.
///
/// Errors are those of NavState: [p, theta, v, bg, ba]. One step maps them by
///   p'     = p + dt v + dt/2 M,  M = V_theta theta + V_bg bg + V_ba ba
///   theta' = E^T theta + T_bg bg
///   v'     = v + M
/// and noise of rate and force enters as their biases do.
struct ImuStep
{
  ImuStep(const ImuSample& from, const ImuSample& to, const ImuBias& bias, const Eigen::Quaterniond& q_ref_from)
    : dt(pi_node::seconds(to.stamp_ns - from.stamp_ns)), f_shake(to.f_shake)
  {
    const Eigen::Vector3d phi = dt * (0.5 * (from.w + to.w) - bias.gyro);
    const Eigen::Vector3d f0 = from.f - bias.accel;
    const Eigen::Vector3d f1 = to.f - bias.accel;
    const Eigen::Quaterniond q_from_to = expSo3(phi);
    q_ref_to = (q_ref_from * q_from_to).normalized();
    const Eigen::Matrix3d R0 = q_ref_from.toRotationMatrix();
    const Eigen::Matrix3d R1 = q_ref_to.toRotationMatrix();
    a_ref = 0.5 * (R0 * f0 + R1 * f1);

    Et = q_from_to.toRotationMatrix().transpose();
    T_bg = -dt * rightJacobian(phi);
    const Eigen::Matrix3d turn1 = -0.5 * dt * R1 * hat(f1);  // d v' / d theta'
    V_theta = -0.5 * dt * R0 * hat(f0) + turn1 * Et;
    V_bg = turn1 * T_bg;
    V_ba = -0.5 * dt * (R0 + R1);
  }

  double dt;       ///< [s]
  double f_shake;  ///< as in ImuSample
  Eigen::Quaterniond q_ref_to;
  Eigen::Vector3d a_ref;  ///< mean specific force, in ref [m/s^2]
  Eigen::Matrix3d Et;     ///< R_to_from
  Eigen::Matrix3d T_bg, V_theta, V_bg, V_ba;

  /// P := F P F^T + Q, by blocks: a third of the work of full products.
  /// @param noise_factor  of standard deviations.
  void propagate(const ImuModel& model, double noise_factor, Matrix15d* covariance) const
  {
    Matrix15d& P = *covariance;
    // Rows of F P, then columns of (F P) F^T; the rows and columns of the biases stay.
    Eigen::Matrix<double, 3, 15> M = V_theta * P.middleRows<3>(3);
    M.noalias() += V_bg * P.middleRows<3>(9);
    M.noalias() += V_ba * P.middleRows<3>(12);
    Eigen::Matrix<double, 3, 15> turned = Et * P.middleRows<3>(3);
    turned.noalias() += T_bg * P.middleRows<3>(9);
    P.middleRows<3>(0) += dt * P.middleRows<3>(6) + 0.5 * dt * M;
    P.middleRows<3>(3) = turned;
    P.middleRows<3>(6) += M;

    Eigen::Matrix<double, 9, 3> N = P.block<9, 3>(0, 3) * V_theta.transpose();
    N.noalias() += P.block<9, 3>(0, 9) * V_bg.transpose();
    N.noalias() += P.block<9, 3>(0, 12) * V_ba.transpose();
    Eigen::Matrix<double, 9, 3> turned_columns = P.block<9, 3>(0, 3) * Et.transpose();
    turned_columns.noalias() += P.block<9, 3>(0, 9) * T_bg.transpose();
    P.block<9, 3>(0, 0) += dt * P.block<9, 3>(0, 6) + 0.5 * dt * N;
    P.block<9, 3>(0, 3) = turned_columns;
    P.block<9, 3>(0, 6) += N;
    P.block<6, 9>(9, 0) = P.block<9, 6>(0, 9).transpose();

    const double square = noise_factor * noise_factor;
    const double gyro = square * model.gyro_noise_density * model.gyro_noise_density / dt;
    const double accel = (square * model.accel_noise_density * model.accel_noise_density + f_shake * f_shake) * dt;
    const Eigen::Matrix3d theta_theta = gyro * T_bg * T_bg.transpose();
    const Eigen::Matrix3d v_theta = gyro * V_bg * T_bg.transpose();
    Eigen::Matrix3d v_v = gyro * V_bg * V_bg.transpose();
    v_v.diagonal().array() += accel;
    P.block<3, 3>(3, 3) += theta_theta;
    P.block<3, 3>(6, 3) += v_theta;
    P.block<3, 3>(3, 6) += v_theta.transpose();
    P.block<3, 3>(0, 3) += 0.5 * dt * v_theta;
    P.block<3, 3>(3, 0) += 0.5 * dt * v_theta.transpose();
    P.block<3, 3>(6, 6) += v_v;
    P.block<3, 3>(0, 6) += 0.5 * dt * v_v;
    P.block<3, 3>(6, 0) += 0.5 * dt * v_v;
    // A white force over an interval gives the position dt^3 / 3, not dt^3 / 4: so the covariance is regular.
    P.block<3, 3>(0, 0) += dt * dt / 3.0 * v_v;
    // A bias walks on as ever where there is no measurement.
    P.diagonal().segment<3>(9).array() += model.gyro_random_walk * model.gyro_random_walk * dt;
    P.diagonal().segment<3>(12).array() += model.accel_random_walk * model.accel_random_walk * dt;
  }
};

}  // namespace pi_slam
