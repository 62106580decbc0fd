#pragma once

#include <pi_slam/imu_sample.h>
#include <pi_slam/spline_trajectory.h>

#include <Eigen/Core>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

namespace pi_slam
{

/// Continuous-time noise model as in Kalibr's imu.yaml; defaults are those of an ADIS16448.
struct ImuSimulatorOptions
{
  double rate_hz = 200.0;                                              ///< in [10, 4000]
  double gyro_noise_density = 1.6968e-4;                               ///< [rad/s/sqrt(Hz)]
  double gyro_random_walk = 1.9393e-5;                                 ///< [rad/s^2/sqrt(Hz)]
  double accel_noise_density = 2.0e-3;                                 ///< [m/s^2/sqrt(Hz)]
  double accel_random_walk = 3.0e-3;                                   ///< [m/s^3/sqrt(Hz)]
  Eigen::Vector3d gyro_bias = Eigen::Vector3d(0.002, -0.0015, 0.001);  ///< at the first sample [rad/s]
  Eigen::Vector3d accel_bias = Eigen::Vector3d(0.02, -0.03, 0.04);     ///< at the first sample [m/s^2]
  double gyro_limit = 17.45;                                           ///< saturation per axis [rad/s] (1000 deg/s)
  double accel_limit = 156.9;                                          ///< saturation per axis [m/s^2] (16 g)
  double gravity = 9.81;                                               ///< along -z of the world [m/s^2]
  uint64_t seed = 1;

  /// A sensor without noise and bias, at the same rate.
  static ImuSimulatorOptions makeIdeal();
  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// The errors of an IMU: noise, biases that walk, saturation. The same seed gives the same errors. Not thread safe.
class ImuNoise
{
public:
  /// @throws std::invalid_argument for options out of range.
  explicit ImuNoise(const ImuSimulatorOptions& options);

  /// Adds the errors of the next sample. The biases walk by one period.
  /// @param sample  true w and f; measured ones afterwards.
  void apply(ImuSample* sample);
  const ImuBias& bias() const { return bias_; }  ///< of the next sample

private:
  Eigen::Vector3d random();

  ImuSimulatorOptions options_;
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
  ImuBias bias_;
};

/// Test support of the estimators and of pi_simulation: the samples of an IMU at the body's origin along a trajectory.
/// The same seed gives the same samples.
class ImuSimulator
{
public:
  /// @throws std::invalid_argument for options out of range.
  explicit ImuSimulator(const ImuSimulatorOptions& options);

  /// Samples at start_ns, start_ns + 1 / rate, ... up to end_ns; the biases walk from the initial ones.
  /// @param biases  if not null, gets the true bias of each sample.
  /// @throws std::out_of_range where the trajectory ends earlier.
  std::vector<ImuSample> simulate(const SplineTrajectory& trajectory, int64_t start_ns, int64_t end_ns,
                                  std::vector<ImuBias>* biases = nullptr) const;

private:
  ImuSimulatorOptions options_;
};

/// A recorded log that is copied unchanged.
struct ImuLog
{
  std::string header;              ///< first line if it is a comment, else empty
  std::vector<std::string> lines;  ///< one sample each, verbatim, without line end
  std::vector<int64_t> stamps_ns;  ///< of each line, increasing
};

/// Reads EuRoC's imu0/data.csv (`t,wx,wy,wz,ax,ay,az`, nanoseconds).
/// @throws RecordingError for a missing file, a line that is no sample, stamps that do not increase, or no sample.
ImuLog readImuLog(const std::string& file);

}  // namespace pi_slam
