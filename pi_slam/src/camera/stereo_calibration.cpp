#include <pi_node/formatting.h>
#include <pi_slam/stereo_calibration.h>

#include <cmath>
#include <fstream>
#include <iomanip>
#include <vector>

#include "camera/calibration_yaml.h"

namespace pi_slam
{

namespace
{

CameraModel readModel(const YamlMap& yaml, const std::string& file)
{
  if (yaml.text("camera_model") != "pinhole")
  {
    throw CalibrationError(file + ": camera_model is \"" + yaml.text("camera_model") + "\", only pinhole is known");
  }
  CameraModel model;
  const std::vector<double> resolution = yaml.numbers("resolution", 2);
  model.width = static_cast<int>(resolution[0]);
  model.height = static_cast<int>(resolution[1]);
  const std::vector<double> intrinsics = yaml.numbers("intrinsics", 4);
  model.fx = intrinsics[0];
  model.fy = intrinsics[1];
  model.cx = intrinsics[2];
  model.cy = intrinsics[3];
  const std::string distortion = yaml.text("distortion_model");
  if (distortion == "radial-tangential" || distortion == "radtan" || distortion == "plumb_bob")
  {
    model.distortion = Distortion::RADTAN;
  }
  else if (distortion == "equidistant")
  {
    model.distortion = Distortion::EQUIDISTANT;
  }
  else if (distortion != "none")
  {
    throw CalibrationError(file + ": distortion_model is \"" + distortion +
                           "\", known are radial-tangential, radtan, equidistant and none");
  }
  if (model.distortion != Distortion::NONE)
  {
    const char* key = yaml.has("distortion_coeffs") ? "distortion_coeffs" : "distortion_coefficients";
    const std::vector<double> coefficients = yaml.numbers(key);
    const size_t count = coefficients.size();
    const bool radial = model.distortion == Distortion::RADTAN;
    if (count != 4 && !(radial && (count == 5 || count == 8)))
    {
      throw CalibrationError(file + ": " + key + " has " + std::to_string(count) + " values, expected 4" +
                             (radial ? ", or 5 with k3, or 8 with k3 to k6" : ""));
    }
    std::copy(coefficients.begin(), coefficients.end(), model.coefficients.begin());
  }
  try
  {
    model.validate();
  }
  catch (const std::invalid_argument& exception)
  {
    throw CalibrationError(file + ": " + exception.what());
  }
  return model;
}

}  // namespace

StereoCalibration StereoCalibration::makeForwardPair(int width, int height, double baseline_m)
{
  if (width < 16 || height < 16)
  {
    throw std::invalid_argument("camera: size " + pi_node::sizeText(width, height) + ", must be at least 16x16 px");
  }
  if (!(baseline_m > 0.0))
  {
    throw std::invalid_argument("camera: baseline = " + std::to_string(baseline_m) + ", must be above 0 m");
  }
  StereoCalibration calibration;
  CameraModel& model = calibration.left.model;
  model.width = width;
  model.height = height;
  model.fx = model.fy = 0.5 * width;
  model.cx = 0.5 * (width - 1);
  model.cy = 0.5 * (height - 1);
  model.validate();
  calibration.right.model = model;
  Eigen::Matrix3d R_body_camera;
  R_body_camera << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  for (MountedCamera* camera : {&calibration.left, &calibration.right})
  {
    camera->T_body_camera.linear() = R_body_camera;
    camera->T_body_camera.translation().y() = (camera == &calibration.left ? 0.5 : -0.5) * baseline_m;
  }
  return calibration;
}

StereoCalibration StereoCalibration::loadEuroc(const std::string& left_yaml, const std::string& right_yaml)
{
  StereoCalibration calibration;
  const auto read = [](const std::string& file, MountedCamera* camera)
  {
    const YamlMap yaml = YamlMap::load(file);
    camera->model = readModel(yaml, file);
    camera->T_body_camera = yaml.transform("T_BS");
  };
  read(left_yaml, &calibration.left);
  read(right_yaml, &calibration.right);
  return calibration;
}

StereoCalibration StereoCalibration::loadKalibr(const std::string& camchain_yaml)
{
  const YamlMap chain = YamlMap::load(camchain_yaml);
  const YamlMap cam0 = chain.child("cam0");
  const YamlMap cam1 = chain.child("cam1");
  StereoCalibration calibration;
  calibration.left.model = readModel(cam0, camchain_yaml + ": cam0");
  calibration.right.model = readModel(cam1, camchain_yaml + ": cam1");
  const Eigen::Isometry3d T_cam0_imu = cam0.transform("T_cam_imu");
  const Eigen::Isometry3d T_cam1_imu =
      cam1.has("T_cam_imu") ? cam1.transform("T_cam_imu") : cam1.transform("T_cn_cnm1") * T_cam0_imu;
  calibration.left.T_body_camera = T_cam0_imu.inverse();
  calibration.right.T_body_camera = T_cam1_imu.inverse();
  return calibration;
}

void StereoCalibration::saveKalibr(const std::string& camchain_yaml, const Eigen::Isometry3d& T_body_imu,
                                   double time_offset_s) const
{
  std::ofstream file(camchain_yaml);
  file << std::setprecision(12);
  for (const MountedCamera* const camera : {&left, &right})
  {
    const CameraModel& model = camera->model;
    const Eigen::Matrix4d T_cam_imu = (camera->T_body_camera.inverse() * T_body_imu).matrix();
    const auto& k = model.coefficients;
    file << (camera == &left ? "cam0" : "cam1") << ":\n  camera_model: pinhole\n  intrinsics: [" << model.fx << ", "
         << model.fy << ", " << model.cx << ", " << model.cy
         << "]\n  distortion_model: " << (model.distortion == Distortion::EQUIDISTANT ? "equidistant" : "radtan")
         << "\n  distortion_coeffs: [" << k[0];
    for (size_t i = 1; i < model.usedCoefficients(); ++i)
    {
      file << ", " << k[i];
    }
    file << "]\n  resolution: [" << model.width << ", " << model.height << "]\n  timeshift_cam_imu: " << time_offset_s
         << "\n  T_cam_imu:\n";
    for (int row = 0; row < 4; ++row)
    {
      file << "  - [" << T_cam_imu(row, 0) << ", " << T_cam_imu(row, 1) << ", " << T_cam_imu(row, 2) << ", "
           << T_cam_imu(row, 3) << "]\n";
    }
  }
  file.close();
  if (!file)
  {
    throw CalibrationError(camchain_yaml + ": cannot be written; its folder is missing, or has no room");
  }
}

}  // namespace pi_slam
