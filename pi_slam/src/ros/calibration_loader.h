#pragma once

#include <pi_slam/imu_sample.h>
#include <pi_slam/stereo_calibration.h>
#include <sensor_msgs/CameraInfo.h>

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

namespace pi_slam
{

enum class CalibrationSource
{
  CAMERA_INFO,  ///< messages; where the sensors sit comes from parameters or tf
  KALIBR,       ///< camchain-imucam.yaml and imu.yaml
  EUROC,        ///< a recording's folder with cam0, cam1, imu0 and a sensor.yaml in each
};
const char* toString(CalibrationSource source);

struct CalibrationOptions
{
  CalibrationSource source = CalibrationSource::CAMERA_INFO;
  std::string camchain;             ///< kalibr: its camchain-imucam.yaml
  std::string imu_yaml;             ///< kalibr: its imu.yaml; empty: the parameters imu/...
  std::string euroc_folder;         ///< euroc: the recording, or its mav0
  bool rectified = false;           ///< camera_info: pictures are rectified, P is used in place of K and D
  std::vector<double> imu_in_base;  ///< IMU frame in base_link: x y z [m] qx qy qz qw; empty: from tf
  std::vector<double> left_in_imu;  ///< camera_info: left optical frame in the IMU's, likewise
  std::string refined_camchain;     ///< written at the end, with what driving told; empty: not
  std::string refined_imu;          ///< likewise, for imu_yaml

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// A transform of seven numbers x y z qx qy qz qw. @throws std::invalid_argument naming the field.
Eigen::Isometry3d parseTransform(const std::vector<double>& numbers, const std::string& field);

/// Rate, noise and scale of a file's IMU, with the other fields of `imu`: they do not belong to the sensor.
ImuModel withSensor(const ImuModel& imu, const ImuModel& sensor);

/// What calibration files say.
struct FileCalibration
{
  StereoCalibration cameras;
  ImuModel imu;
};

/// Reads the files of KALIBR or EUROC. Kalibr's timeshift_cam_imu becomes imu.time_offset_s.
/// @param imu  what the files do not say.
/// @throws CalibrationError naming file, key and defect.
FileCalibration loadCalibrationFiles(const CalibrationOptions& options, const ImuModel& imu);

/// The pair of cameras as two camera_info messages describe it: models from K and D or from P, the right camera from R
/// and from the baseline in P.
/// @param left_name,right_name   of the topics, for errors.
/// @param T_body_left  left optical frame in the body frame.
/// @throws std::invalid_argument naming topic, field, value and way out: not calibrated, no baseline, swapped cameras.
StereoCalibration fromCameraInfo(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right,
                                 bool rectified, const Eigen::Isometry3d& T_body_left, const std::string& left_name,
                                 const std::string& right_name);

/// @param name  where the calibration is from, for errors.
/// @throws std::invalid_argument for swapped cameras or an impossible baseline.
void checkStereo(const StereoCalibration& calibration, const std::string& name);

}  // namespace pi_slam
