#include <pi_slam/so3.h>

#include <cmath>

namespace pi_slam
{

namespace
{

/// Below this square of an angle, series to the fourth power are exact to rounding; one step of an IMU is always there.
constexpr double SMALL_SQUARE = 1e-3;

/// I + b [phi]x + c [phi]x^2
Eigen::Matrix3d combine(double b, double c, const Eigen::Vector3d& phi)
{
  Eigen::Matrix3d matrix = c * phi * phi.transpose() + b * hat(phi);
  matrix.diagonal().array() += 1.0 - c * phi.squaredNorm();
  return matrix;
}

}  // namespace

Eigen::Quaterniond expSo3(const Eigen::Vector3d& phi)
{
  const double square = phi.squaredNorm();
  Eigen::Quaterniond q;
  if (square < SMALL_SQUARE)
  {
    q.w() = 1.0 - square * (1.0 / 8.0 - square * (1.0 / 384.0 - square / 46080.0));
    q.vec() = (0.5 - square * (1.0 / 48.0 - square * (1.0 / 3840.0 - square / 645120.0))) * phi;
    return q;
  }
  const double angle = std::sqrt(square);
  q.w() = std::cos(0.5 * angle);
  q.vec() = std::sin(0.5 * angle) / angle * phi;
  return q;
}

Eigen::Vector3d logSo3(const Eigen::Quaterniond& q)
{
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const double sine = q.vec().norm();
  const double cosine = sign * q.w();
  // For small angles atan(s / c) / s is 1 / c.
  const double scale = sine < 1e-9 * cosine ? 2.0 / cosine : sine > 0.0 ? 2.0 * std::atan2(sine, cosine) / sine : 0.0;
  return sign * scale * q.vec();
}

Eigen::Matrix3d rightJacobian(const Eigen::Vector3d& phi)
{
  const double square = phi.squaredNorm();
  if (square < SMALL_SQUARE)
  {
    return combine(-0.5 + square * (1.0 / 24.0 - square * (1.0 / 720.0 - square / 40320.0)),
                   1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0)), phi);
  }
  const double angle = std::sqrt(square);
  return combine(-(1.0 - std::cos(angle)) / square, (angle - std::sin(angle)) / (square * angle), phi);
}

Eigen::Matrix3d rightJacobianInverse(const Eigen::Vector3d& phi)
{
  const double square = phi.squaredNorm();
  if (square < SMALL_SQUARE)
  {
    return combine(0.5, 1.0 / 12.0 + square * (1.0 / 720.0 + square * (1.0 / 30240.0 + square / 1209600.0)), phi);
  }
  // Eq. 9 with half angles, which stays finite at pi.
  const double angle = std::sqrt(square);
  return combine(0.5, (1.0 - 0.5 * angle / std::tan(0.5 * angle)) / square, phi);
}

}  // namespace pi_slam
