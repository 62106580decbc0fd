#pragma once

#include <pi_slam/camera_model.h>

#include <Eigen/Geometry>
#include <stdexcept>
#include <string>

namespace pi_slam
{

/// A calibration file that cannot be used. what() names the file, the key and the defect.
class CalibrationError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

struct MountedCamera
{
  CameraModel model;
  Eigen::Isometry3d T_body_camera = Eigen::Isometry3d::Identity();  ///< body: the frame of the IMU
};

struct StereoCalibration
{
  MountedCamera left;
  MountedCamera right;

  /// Two cameras without distortion, 90 degrees wide (horizontally), that look along the body's x axis; the body is the
  /// midpoint between them, x forward, y left, z up.
  /// @throws std::invalid_argument for a size below 16 px or a baseline that is not above 0 [m].
  static StereoCalibration makeForwardPair(int width = 640, int height = 480, double baseline_m = 0.12);

  /// Reads two sensor.yaml of an EuRoC recording (T_BS, resolution, intrinsics, distortion_model radial-tangential,
  /// equidistant or none, distortion_coefficients: 4, or 5 with k3, or 8 with k3 to k6 of radial-tangential).
  /// @throws CalibrationError
  static StereoCalibration loadEuroc(const std::string& left_yaml, const std::string& right_yaml);

  /// Reads cam0 and cam1 of Kalibr's camchain-imucam.yaml: camera_model pinhole, distortion_model radtan, equidistant
  /// or none, T_cam_imu; cam1 may have T_cn_cnm1 in place of T_cam_imu.
  /// @throws CalibrationError
  static StereoCalibration loadKalibr(const std::string& camchain_yaml);
  /// Writes such a file, with its timeshift_cam_imu.
  /// @param T_body_imu     where the IMU is in the body frame of this calibration.
  /// @param time_offset_s  stamp of the IMU = stamp of the cameras + this [s].
  /// @throws CalibrationError if it cannot be written.
  void saveKalibr(const std::string& camchain_yaml, const Eigen::Isometry3d& T_body_imu, double time_offset_s) const;
};

}  // namespace pi_slam
