#pragma once

#include <Eigen/Core>

namespace pi_detect::obstacles
{

/// Kalman filter of a point on the ground that moves with constant velocity, in odom: state [x, y, vx, vy].
class GroundFilter
{
public:
  /// Starts at rest. @param speed_sigma  standard deviation of the speed [m/s].
  GroundFilter(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance, double speed_sigma);

  /// @param acceleration_sigma  standard deviation of a random acceleration that changes every 0.1 s.
  void predict(double dt_s, double acceleration_sigma, double max_speed);
  void correct(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance);
  /// Squared Mahalanobis distance of a measurement.
  double distance2(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance) const;
  /// Sets the position and forgets the velocity.
  void restart(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance, double speed_sigma);
  /// Sets the position without information about the velocity, which fades.
  void moveTo(const Eigen::Vector2d& position, const Eigen::Matrix2d& covariance);

  /// Another point of the same thing: no motion.
  void shift(const Eigen::Vector2d& by);

  Eigen::Vector2d position() const { return x_.head<2>(); }
  Eigen::Vector2d velocity() const { return x_.tail<2>(); }
  Eigen::Matrix2d positionCovariance() const { return P_.topLeftCorner<2, 2>(); }
  Eigen::Matrix2d velocityCovariance() const { return P_.bottomRightCorner<2, 2>(); }

private:
  Eigen::Vector4d x_;
  Eigen::Matrix4d P_;
  double start_variance_ = 0.0;  ///< of the velocity
};

}  // namespace pi_detect::obstacles
