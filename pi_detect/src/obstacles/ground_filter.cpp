#include "obstacles/ground_filter.h"

#include <Eigen/LU>
#include <algorithm>

namespace pi_detect::obstacles
{

namespace
{

constexpr double ACCELERATION_TIME_S = 0.1;  // for which an acceleration lasts
constexpr double FADING = 0.85;              // of a velocity that nothing confirms
// Strong tracking (Zhou and Frank 1996): what is farther off than expected moves otherwise now, so the past counts
// less, but never less than at the start: its velocity is as unknown then.
constexpr double SURPRISE = 3.0;  // squared Mahalanobis distance

}  // namespace

GroundFilter::GroundFilter(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance, double speed_sigma)
{
  restart(position, covariance, speed_sigma);
}

void GroundFilter::restart(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance, double speed_sigma)
{
  x_ << position, Eigen::Vector2d::Zero();
  P_.setZero();
  P_.topLeftCorner<2, 2>() = covariance;
  start_variance_ = speed_sigma * speed_sigma;
  P_.bottomRightCorner<2, 2>() = start_variance_ * Eigen::Matrix2d::Identity();
}

void GroundFilter::predict(double dt_s, double acceleration_sigma, double max_speed)
{
  Eigen::Matrix4d F = Eigen::Matrix4d::Identity();
  F.topRightCorner<2, 2>() = dt_s * Eigen::Matrix2d::Identity();
  const double q = acceleration_sigma * acceleration_sigma * ACCELERATION_TIME_S * dt_s;
  Eigen::Matrix4d Q = Eigen::Matrix4d::Zero();
  Q.topLeftCorner<2, 2>() = q * dt_s * dt_s / 3.0 * Eigen::Matrix2d::Identity();
  Q.topRightCorner<2, 2>() = q * dt_s / 2.0 * Eigen::Matrix2d::Identity();
  Q.bottomLeftCorner<2, 2>() = Q.topRightCorner<2, 2>();
  Q.bottomRightCorner<2, 2>() = q * Eigen::Matrix2d::Identity();
  x_ = F * x_;
  P_ = F * P_ * F.transpose() + Q;
  const double speed = velocity().norm();
  if (speed > max_speed)
  {
    x_.tail<2>() *= max_speed / speed;
  }
}

void GroundFilter::correct(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance)
{
  const double most = std::max(1.0, start_variance_ / std::max(velocityCovariance().diagonal().maxCoeff(), 1e-9));
  P_ *= std::clamp(distance2(position, covariance) / SURPRISE, 1.0, most);
  const Eigen::Matrix2d S = positionCovariance() + covariance;
  const Eigen::Matrix<double, 4, 2> K = P_.leftCols<2>() * S.inverse();
  x_ += K * (position - x_.head<2>());
  const Eigen::Matrix4d P = P_ - K * P_.topRows<2>();
  P_ = 0.5 * (P + P.transpose());
}

double GroundFilter::distance2(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance) const
{
  const Eigen::Vector2d r = position - x_.head<2>();
  return r.dot((positionCovariance() + covariance).inverse() * r);
}

void GroundFilter::shift(const Eigen::Vector2d& by)
{
  x_.head<2>() += by;
}

void GroundFilter::moveTo(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance)
{
  x_.head<2>() = position;
  x_.tail<2>() *= FADING;
  P_.topLeftCorner<2, 2>() = covariance;
  P_.topRightCorner<2, 2>().setZero();
  P_.bottomLeftCorner<2, 2>().setZero();
}

}  // namespace pi_detect::obstacles
