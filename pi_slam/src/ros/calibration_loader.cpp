#include "ros/calibration_loader.h"

#include <Eigen/LU>
#include <cmath>
#include <filesystem>
#include <sstream>
#include <stdexcept>

#include "camera/calibration_yaml.h"
#include "ros/conversions.h"

namespace pi_slam
{
namespace
{

constexpr double MIN_BASELINE_M = 0.01;
constexpr double MAX_BASELINE_M = 3.0;

[[noreturn]] void fail(const std::string& text)
{
  throw std::invalid_argument(text);
}

/// R of a camera_info: raw coordinates into the rectified frame.
Eigen::Matrix3d rectification(const sensor_msgs::CameraInfo& info, const std::string& name)
{
  Eigen::Matrix3d R_rectified_camera = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(info.R.data());
  // Files have few digits.
  if (!((R_rectified_camera * R_rectified_camera.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3) ||
      R_rectified_camera.determinant() < 0.0)
  {
    fail(name + ": R is no rotation: the pair is not calibrated; calibrate it, or set calibration/source to kalibr");
  }
  return Eigen::Quaterniond(R_rectified_camera).normalized().toRotationMatrix();
}

CameraModel cameraModel(const sensor_msgs::CameraInfo& info, bool rectified, const std::string& name)
{
  try
  {
    return fromMsg(info, rectified);
  }
  catch (const std::invalid_argument& error)
  {
    fail(name + ": " + error.what());
  }
}

/// Kalibr: stamp of the IMU = stamp of the camera + timeshift_cam_imu.
std::optional<double> kalibrTimeShift(const std::string& file)
{
  const YAML::Node shift = loadCalibrationYaml(file)["cam0"]["timeshift_cam_imu"];
  if (!shift.IsDefined())
  {
    return std::nullopt;
  }
  double value = 0.0;
  if (!YAML::convert<double>::decode(shift, value) || !std::isfinite(value))
  {
    throw CalibrationError(file + ": cam0: timeshift_cam_imu is not a number");
  }
  return value;
}

}  // namespace

const char* toString(CalibrationSource source)
{
  switch (source)
  {
    case CalibrationSource::CAMERA_INFO:
      return "camera_info";
    case CalibrationSource::KALIBR:
      return "kalibr";
    case CalibrationSource::EUROC:
      return "euroc";
  }
  return "unknown";
}

Eigen::Isometry3d parseTransform(const std::vector<double>& numbers, const std::string& field)
{
  if (numbers.size() != 7)
  {
    fail(field + " has " + std::to_string(numbers.size()) + " numbers, must have 7: x y z qx qy qz qw");
  }
  const Eigen::Quaterniond rotation(numbers[6], numbers[3], numbers[4], numbers[5]);
  const Eigen::Vector3d translation(numbers[0], numbers[1], numbers[2]);
  if (!(std::abs(rotation.norm() - 1.0) < 1e-3) || !translation.allFinite())
  {
    fail(field + ": quaternion has norm " + std::to_string(rotation.norm()) + ", must have 1, and finite numbers");
  }
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  transform.linear() = rotation.normalized().toRotationMatrix();
  transform.translation() = translation;
  return transform;
}

void CalibrationOptions::validate() const
{
  const auto require_set = [this](const std::string& value, const char* field, const char* what)
  {
    if (value.empty())
    {
      fail(std::string("calibration/") + field + " is not set, must be " + what +
           " with calibration/source = " + toString(source));
    }
  };
  if (source == CalibrationSource::KALIBR)
  {
    require_set(camchain, "camchain", "Kalibr's camchain-imucam.yaml");
  }
  if (source == CalibrationSource::EUROC)
  {
    require_set(euroc_folder, "euroc_folder", "the folder of a recording");
  }
  if (source != CalibrationSource::CAMERA_INFO)
  {
    if (rectified)
    {
      fail(std::string("calibration/rectified = true, must be false with calibration/source = ") + toString(source) +
           ": only camera_info describes rectified pictures");
    }
    if (!left_in_imu.empty())
    {
      fail(std::string("calibration/left_in_imu is set, must be [] with calibration/source = ") + toString(source) +
           ", whose files say it");
    }
  }
  if (!imu_in_base.empty())
  {
    parseTransform(imu_in_base, "calibration/imu_in_base");
  }
  if (!left_in_imu.empty())
  {
    parseTransform(left_in_imu, "calibration/left_in_imu");
  }
}

ImuModel withSensor(const ImuModel& imu, const ImuModel& sensor)
{
  ImuModel model = sensor;
  model.gyro_limit = imu.gyro_limit;
  model.accel_limit = imu.accel_limit;
  model.gravity = imu.gravity;
  model.time_offset_s = imu.time_offset_s;
  model.gyro_scale = sensor.gyro_scale == ImuModel().gyro_scale ? imu.gyro_scale : sensor.gyro_scale;
  model.accel_scale = sensor.accel_scale == ImuModel().accel_scale ? imu.accel_scale : sensor.accel_scale;
  return model;
}

FileCalibration loadCalibrationFiles(const CalibrationOptions& options, const ImuModel& imu)
{
  FileCalibration calibration;
  calibration.imu = imu;
  if (options.source == CalibrationSource::KALIBR)
  {
    calibration.cameras = StereoCalibration::loadKalibr(options.camchain);
    if (!options.imu_yaml.empty())
    {
      calibration.imu = withSensor(imu, ImuModel::loadYaml(options.imu_yaml));
    }
    calibration.imu.time_offset_s = kalibrTimeShift(options.camchain).value_or(imu.time_offset_s);
  }
  else
  {
    namespace fs = std::filesystem;
    const fs::path folder(options.euroc_folder);
    const fs::path mav = fs::exists(folder / "mav0") ? folder / "mav0" : folder;
    calibration.cameras =
        StereoCalibration::loadEuroc((mav / "cam0" / "sensor.yaml").string(), (mav / "cam1" / "sensor.yaml").string());
    calibration.imu = withSensor(imu, ImuModel::loadYaml((mav / "imu0" / "sensor.yaml").string()));
  }
  calibration.imu.validate();
  return calibration;
}

void checkStereo(const StereoCalibration& calibration, const std::string& name)
{
  const Eigen::Vector3d p_left_right =
      (calibration.left.T_body_camera.inverse() * calibration.right.T_body_camera).translation();
  const double baseline_m = p_left_right.norm();
  if (!(baseline_m >= MIN_BASELINE_M && baseline_m <= MAX_BASELINE_M))
  {
    std::ostringstream text;
    text << name << ": baseline = " << baseline_m << " m, must be in [" << MIN_BASELINE_M << ", " << MAX_BASELINE_M
         << "]: check the unit of the calibration";
    fail(text.str());
  }
  if (p_left_right.x() < 0.0 && std::abs(p_left_right.x()) > std::abs(p_left_right.y()))
  {
    std::ostringstream text;
    text << name << ": the right camera is " << -p_left_right.x()
         << " m to the left of the left one: the cameras are swapped; swap their topics or their calibration";
    fail(text.str());
  }
}

StereoCalibration fromCameraInfo(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right,
                                 bool rectified, const Eigen::Isometry3d& T_body_left, const std::string& left_name,
                                 const std::string& right_name)
{
  StereoCalibration calibration;
  calibration.left.model = cameraModel(left, rectified, left_name);
  calibration.right.model = cameraModel(right, rectified, right_name);
  const Eigen::Matrix3d R_rectified_left = rectification(left, left_name);
  const Eigen::Matrix3d R_rectified_right = rectification(right, right_name);
  std::ostringstream number;
  number << right.P[3];
  if (right.P[3] > 0.0 || (right.P[3] == 0.0 && left.P[3] < 0.0))
  {
    fail((right.P[3] > 0.0 ? right_name + ": P[3] = " + number.str() + ", must be negative (-focal length * baseline)"
                           : left_name + ": P[3] is negative, as of a right camera") +
         ": the cameras are swapped; swap the topics of left and right");
  }
  if (!(right.P[0] > 0.0) || !(right.P[3] < 0.0) || !std::isfinite(right.P[3]))
  {
    fail(right_name + ": P[3] = " + number.str() +
         ", must be -focal length * baseline: the cameras are not calibrated as a pair; calibrate them as one, or set "
         "calibration/source to kalibr");
  }
  // Both rectified frames have the same axes; the right one is displaced along x.
  Eigen::Isometry3d T_left_right = Eigen::Isometry3d::Identity();
  T_left_right.translation().x() = (left.P[3] / left.P[0] - right.P[3] / right.P[0]);
  calibration.left.T_body_camera = T_body_left;
  calibration.right.T_body_camera = T_body_left;
  const Eigen::Isometry3d T_left_rectified(Eigen::Quaterniond(R_rectified_left.transpose()));
  if (rectified)
  {
    calibration.left.T_body_camera = T_body_left * T_left_rectified;
    calibration.right.T_body_camera = calibration.left.T_body_camera * T_left_right;
  }
  else
  {
    const Eigen::Isometry3d T_rectified_right(Eigen::Quaterniond{R_rectified_right});
    calibration.right.T_body_camera = T_body_left * T_left_rectified * T_left_right * T_rectified_right;
  }
  checkStereo(calibration, right_name);
  return calibration;
}

}  // namespace pi_slam
