#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

namespace pi_slam
{

struct ImuSample
{
  int64_t stamp_ns = 0;
  Eigen::Vector3d w = Eigen::Vector3d::Zero();  ///< angular rate, IMU frame [rad/s]
  Eigen::Vector3d f = Eigen::Vector3d::Zero();  ///< specific force, IMU frame [m/s^2]; at rest it points up
  bool saturated = false;  ///< no full measurement: an axis was at the sensor's limit and holds an earlier value
  float f_shake = 0.0F;    ///< noise of the force by vibration, beside the sensor's [m/s^2/sqrt(Hz)]
};

struct ImuBias
{
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();  ///< [m/s^2]
};

/// Continuous-time noise model of an IMU as in Kalibr's imu.yaml, with its limits and time offset.
struct ImuModel
{
  double rate_hz = 200.0;                            ///< nominal; in [20, 4000]
  double gyro_noise_density = 1.6968e-4;             ///< [rad/s/sqrt(Hz)]; > 0
  double gyro_random_walk = 1.9393e-5;               ///< [rad/s^2/sqrt(Hz)]; > 0
  double accel_noise_density = 2.0e-3;               ///< [m/s^2/sqrt(Hz)]; > 0
  double accel_random_walk = 3.0e-3;                 ///< [m/s^3/sqrt(Hz)]; > 0
  double gyro_limit = 17.0;                          ///< at and above this an axis counts as saturated [rad/s]; > 0
  double accel_limit = 150.0;                        ///< likewise [m/s^2]; > 0
  double gravity = 9.81;                             ///< [m/s^2]; in [9.5, 10]
  double time_offset_s = 0.0;                        ///< stamp of the IMU = stamp of the cameras + this; in [-0.5, 0.5]
  std::vector<double> gyro_scale = {1.0, 1.0, 1.0};  ///< what the sensor says over what is, x y z; in [0.8, 1.25]
  std::vector<double> accel_scale = {1.0, 1.0, 1.0};  ///< likewise

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;

  /// Reads Kalibr's imu.yaml: update_rate, gyroscope_noise_density, gyroscope_random_walk, accelerometer_noise_density,
  /// accelerometer_random_walk, and the diagonals of gyroscopes/M and accelerometers/M (model scale-misalignment), if
  /// they are there; ignores other keys. Also reads EuRoC's imu0/sensor.yaml (rate_hz and the same keys).
  /// @throws CalibrationError naming file, key and defect.
  static ImuModel loadYaml(const std::string& file);

  /// Writes what loadYaml() reads. @throws CalibrationError if the file cannot be written.
  void saveYaml(const std::string& file) const;
};

}  // namespace pi_slam
