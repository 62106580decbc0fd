#pragma once

#include "front_end/motion_check.h"
#include "inertial/imu_preintegration.h"

#include <Eigen/Core>

namespace pi_slam
{

/// Finds where the IMU lies beside the place that the calibration says: the ways by pictures differ from those by IMU
/// and gravity then. A Kalman filter of thirteen numbers (gravity in the body, bias, place, speed, and by how much the
/// ways by pictures are too long) compares them, interval by interval. A place shows in turns that change, or about
/// several axes. A vehicle on flat ground does not tell it, and its variances say so.
///
/// The scale of the force is none of these numbers: pairs of pictures themselves are 1 to 3 % off where most is far.
///
/// Not thread safe.
class ForceCalibrator
{
public:
  static constexpr double FIRST_PLACE = 0.01;  ///< deviation before anything was compared [m]

  ForceCalibrator(const ImuModel& model, const Eigen::Vector3d& p_body_imu, const Eigen::Vector3d& p_deviation);

  /// @param moved  by pictures alone, over the interval of `by_imu`.
  /// @param by_imu  without a bias of the force. @param f_mean  of its samples.
  void add(const front_end::BodyMotion& moved, const ImuPreintegration& by_imu, const Eigen::Vector3d& f_mean);

  /// Intervals are missing: which way is down has to be found again.
  void skip() { begun_ = false; }

  /// What was compared until now had another fault, which was taken out: all is unknown again.
  void restart();

  /// What is known well and matters, else 0; what add() gets from now on must have it.
  Eigen::Vector3d take();

  Eigen::Vector3d place() const { return x_.segment<3>(PLACE); }  ///< [m]
  Eigen::Vector3d placeDeviation() const { return P_.diagonal().segment<3>(PLACE).cwiseSqrt(); }

private:
  static constexpr int GRAVITY = 0, BIAS = 3, PLACE = 6, SPEED = 9, LENGTH = 12;
  static constexpr int SIZE = 13;
  using Vector = Eigen::Matrix<double, SIZE, 1>;
  using Matrix = Eigen::Matrix<double, SIZE, SIZE>;

  void begin(const Eigen::Vector3d& f_mean);
  void compare(const front_end::BodyMotion& moved, const ImuPreintegration& by_imu);
  void keepGravity();
  void propagate(const ImuPreintegration& by_imu);

  double gravity_;
  bool begun_ = false;
  Vector x_ = Vector::Zero();
  Matrix P_ = Matrix::Zero();
  double variance_;  ///< of a mean speed by pictures [m^2/s^2]
  int compared_ = 0;
};

}  // namespace pi_slam
