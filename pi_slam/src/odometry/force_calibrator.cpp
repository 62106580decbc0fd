#include "odometry/force_calibrator.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "odometry/known_part.h"

namespace pi_slam
{

namespace
{

constexpr double FIRST_GRAVITY = 1.0;       ///< deviation: what a vehicle accelerates [m/s^2]
constexpr double FIRST_FORCE_BIAS = 0.3;    ///< [m/s^2]
constexpr double FIRST_FORCE_NOISE = 0.02;  ///< of a mean speed by pictures [m/s]
constexpr double FIRST_SPEED = 10.0;        ///< deviation [m/s]
constexpr double GRAVITY_WALK = 5e-3;       ///< by the gyroscope's noise and bias [m/s^2/sqrt(s)]
/// Part by which ways by pictures are too long: noise of disparities makes far points look nearer and farther alike,
/// and so the way shorter.
constexpr double FIRST_LENGTH = 0.03;
constexpr double LENGTH_WALK = 2e-2;      ///< [1/sqrt(s)]: what is in view changes
constexpr double FORCE_BIAS_WALK = 1e-3;  ///< [m/s^2/sqrt(s)]
constexpr double SPEED_WALK = 5e-3;       ///< by the noise of the force, and what the gyroscope errs [m/s/sqrt(s)]
constexpr double GRAVITY_SIGMA = 0.01;    ///< of the known length [m/s^2]
constexpr double WAY_GATE = 9.0;          ///< squared deviations beyond which a comparison counts less
constexpr int LEAST_FORCES = 100;         ///< before a correction: 20 s of motion
constexpr double SURE_BY_FORCE = 4.0;     ///< deviations
/// What is less than this has no influence on the pose.
constexpr double LEAST_PLACE = 5e-3;  ///< [m]
constexpr double KNOWN_PLACE = 3e-3;  ///< deviation of a coordinate that is taken over [m]

}  // namespace

ForceCalibrator::ForceCalibrator(const ImuModel& model, const Eigen::Vector3d& p_body_imu,
                                 const Eigen::Vector3d& p_deviation)
  : gravity_(model.gravity), variance_(FIRST_FORCE_NOISE * FIRST_FORCE_NOISE)
{
  restart();
  x_.segment<3>(PLACE) = p_body_imu;
  P_.diagonal().segment<3>(PLACE) = p_deviation.cwiseAbs2();
}

void ForceCalibrator::begin(const Eigen::Vector3d& f_mean)
{
  const auto forget = [this](int at, double deviation)
  {
    P_.middleRows<3>(at).setZero();
    P_.middleCols<3>(at).setZero();
    P_.diagonal().segment<3>(at).setConstant(deviation * deviation);
  };
  forget(GRAVITY, FIRST_GRAVITY);
  forget(SPEED, FIRST_SPEED);
  x_.segment<3>(GRAVITY) = -gravity_ * f_mean.normalized();
  x_.segment<3>(SPEED).setZero();
  begun_ = true;
}

void ForceCalibrator::add(const front_end::BodyMotion& moved, const ImuPreintegration& by_imu,
                          const Eigen::Vector3d& f_mean)
{
  if (!begun_)
  {
    begin(f_mean);
  }
  compare(moved, by_imu);
  keepGravity();
  propagate(by_imu);
}

/// In the axes of the body at the beginning: the way of the IMU over the interval.
void ForceCalibrator::compare(const front_end::BodyMotion& moved, const ImuPreintegration& by_imu)
{
  const double dt = by_imu.duration();
  const Eigen::Matrix3d R_from_to = by_imu.deltaR().toRotationMatrix();
  const Eigen::Matrix3d by_bias = by_imu.biasJacobian().block<3, 3>(0, 3) / dt;
  Eigen::Matrix<double, 3, SIZE> H;
  H.middleCols<3>(GRAVITY) = 0.5 * dt * Eigen::Matrix3d::Identity();
  H.middleCols<3>(BIAS) = by_bias;
  H.middleCols<3>(PLACE) = (Eigen::Matrix3d::Identity() - R_from_to) / dt;
  H.middleCols<3>(SPEED) = Eigen::Matrix3d::Identity();
  const Eigen::Vector3d seen = -(R_from_to * moved.p_now_last) / dt;
  H.col(LENGTH) = seen;
  const Eigen::Vector3d error = seen - by_imu.deltaP() / dt - H * x_;
  Eigen::Matrix3d S = H * P_ * H.transpose();
  S.diagonal().array() += variance_;
  const double squared = error.dot(S.llt().solve(error));
  S.diagonal().array() += squared > WAY_GATE ? variance_ * (squared / WAY_GATE - 1.0) : 0.0;
  const Eigen::Matrix<double, SIZE, 3> K = S.llt().solve(H * P_).transpose();
  x_ += K * error;
  P_ -= (K * H * P_).eval();
  ++compared_;
  const double left = (error - H * (K * error)).squaredNorm() / 3.0;
  variance_ += (std::min(left, WAY_GATE * variance_) - variance_) / std::min(50.0, 10.0 + compared_);
}

/// Its length is known.
void ForceCalibrator::keepGravity()
{
  const double length = x_.head<3>().norm();
  Vector h = Vector::Zero();
  h.head<3>() = x_.head<3>() / length;
  const Vector Ph = P_ * h;
  const double S = h.dot(Ph) + GRAVITY_SIGMA * GRAVITY_SIGMA;
  x_ += Ph * ((gravity_ - length) / S);
  P_ -= Ph * Ph.transpose() / S;
}

/// To the end of the interval, and into the axes of the body there.
void ForceCalibrator::propagate(const ImuPreintegration& by_imu)
{
  const double dt = by_imu.duration();
  const Eigen::Matrix3d R_to_from = by_imu.deltaR().toRotationMatrix().transpose();
  const Eigen::Matrix3d by_bias = by_imu.biasJacobian().block<3, 3>(6, 3);
  Matrix F = Matrix::Identity();
  F.block<3, 3>(GRAVITY, GRAVITY) = R_to_from;
  F.block<3, 3>(SPEED, GRAVITY) = dt * R_to_from;
  F.block<3, 3>(SPEED, BIAS) = R_to_from * by_bias;
  F.block<3, 3>(SPEED, SPEED) = R_to_from;
  x_ = (F * x_).eval();
  x_.segment<3>(SPEED) += R_to_from * by_imu.deltaV();
  P_ = (F * P_ * F.transpose()).eval();
  P_.diagonal().segment<3>(GRAVITY).array() += dt * GRAVITY_WALK * GRAVITY_WALK;
  P_.diagonal().segment<3>(BIAS).array() += dt * FORCE_BIAS_WALK * FORCE_BIAS_WALK;
  P_.diagonal().segment<3>(SPEED).array() += dt * SPEED_WALK * SPEED_WALK;
  P_(LENGTH, LENGTH) += dt * LENGTH_WALK * LENGTH_WALK;
  P_ = (0.5 * (P_ + P_.transpose())).eval();
}

void ForceCalibrator::restart()
{
  x_.setZero();
  P_.setZero();
  P_.diagonal().segment<3>(BIAS).setConstant(FIRST_FORCE_BIAS * FIRST_FORCE_BIAS);
  P_.diagonal().segment<3>(PLACE).setConstant(FIRST_PLACE * FIRST_PLACE);
  P_(LENGTH, LENGTH) = FIRST_LENGTH * FIRST_LENGTH;
  begun_ = false;
  compared_ = 0;
}

Eigen::Vector3d ForceCalibrator::take()
{
  if (compared_ < LEAST_FORCES)
  {
    return Eigen::Vector3d::Zero();
  }
  const Eigen::Vector3d known =
      knownPart(place(), P_.block<3, 3>(PLACE, PLACE), KNOWN_PLACE, SURE_BY_FORCE, LEAST_PLACE);
  x_.segment<3>(PLACE) -= known;
  compared_ = known.isZero() ? compared_ : 0;
  return known;
}

}  // namespace pi_slam
