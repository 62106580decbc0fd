#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_bringup
{

/// A folder that is not a usable EuRoC recording. what() names the file, the line where there is one, and the defect.
class EurocError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// Calibration of one camera from its sensor.yaml. Body frame B is the recording's own (for the EuRoC MAVs the IMU's).
struct CameraCalibration
{
  int width = 0;                       ///< [px]
  int height = 0;                      ///< [px]
  double rate_hz = 0.0;                ///< nominal
  std::array<double, 4> intrinsics{};  ///< fx, fy, cx, cy [px]
  std::array<double, 4> distortion{};  ///< k1, k2, p1, p2 of the radial-tangential model
  Eigen::Isometry3d T_body_camera = Eigen::Isometry3d::Identity();
};

struct ImageEntry
{
  int64_t stamp_ns = 0;
  std::string path;  ///< of the picture; it existed when the folder was read
};

struct Camera
{
  CameraCalibration calibration;
  std::vector<ImageEntry> images;  ///< in order of time
};

struct ImuSample
{
  int64_t stamp_ns = 0;
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();     ///< [rad/s], IMU frame
  Eigen::Vector3d linear_acceleration = Eigen::Vector3d::Zero();  ///< specific force [m/s^2], IMU frame
};

/// Noise as in sensor.yaml; 0 where the file does not say.
struct ImuCalibration
{
  double rate_hz = 0.0;
  double gyroscope_noise_density = 0.0;      ///< [rad/s/sqrt(Hz)]
  double accelerometer_noise_density = 0.0;  ///< [m/s^2/sqrt(Hz)]
  Eigen::Isometry3d T_body_imu = Eigen::Isometry3d::Identity();
};

struct Imu
{
  ImuCalibration calibration;
  std::vector<ImuSample> samples;  ///< in order of time
};

struct GroundTruthPose
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();  ///< world: z up
  std::optional<Eigen::Vector3d> v_world;  ///< velocity of the body in the world frame [m/s], where it is recorded
};

/// A recording in the folder layout of the EuRoC MAV data set (Burri et al., IJRR 2016): `mav0/cam0` (left),
/// `mav0/cam1` (right), `mav0/imu0`, each with sensor.yaml and data.csv. Ground truth comes from
/// `mav0/state_groundtruth_estimate0/data.csv` or from `groundtruth_tum.txt` (t x y z qx qy qz qw) beside mav0.
struct EurocDataset
{
  std::string folder;
  Camera left;
  std::optional<Camera> right;                ///< nullopt if there is no folder mav0/cam1
  std::optional<Imu> imu;                     ///< nullopt if there is no folder mav0/imu0
  std::vector<GroundTruthPose> ground_truth;  ///< empty if there is none

  /// Reads everything but the pictures themselves, whose files must exist.
  /// @param folder the one that contains mav0.
  /// @throws EurocError for a missing folder or file, a line that cannot be read, stamps that do not increase.
  static EurocDataset load(const std::string& folder);
};

}  // namespace pi_bringup
