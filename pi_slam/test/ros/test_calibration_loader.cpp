#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include "ros/calibration_loader.h"

#include <stdexcept>

#include "ros/contains.h"

namespace pi_slam
{
namespace
{

sensor_msgs::CameraInfo makeInfo(double p3)
{
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D.assign(5, 0.0);
  info.K = {400.0, 0.0, 320.0, 0.0, 400.0, 240.0, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {400.0, 0.0, 320.0, p3, 0.0, 400.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

StereoCalibration load(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right,
                       bool rectified = false)
{
  return fromCameraInfo(left, right, rectified, Eigen::Isometry3d::Identity(), "/left/camera_info",
                        "/right/camera_info");
}

std::string refusal(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right)
{
  try
  {
    load(left, right);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(CalibrationLoader, TakesTheBaselineFromP)
{
  Eigen::Isometry3d T_body_left = Eigen::Isometry3d::Identity();
  T_body_left.linear() = Eigen::AngleAxisd(0.5, Eigen::Vector3d(1.0, 2.0, 3.0).normalized()).toRotationMatrix();
  T_body_left.translation() << 0.1, 0.2, 0.3;
  const StereoCalibration calibration =
      fromCameraInfo(makeInfo(0.0), makeInfo(-48.0), false, T_body_left, "left", "right");
  EXPECT_TRUE(calibration.left.T_body_camera.isApprox(T_body_left, 1e-12));
  const Eigen::Isometry3d T_left_right = T_body_left.inverse() * calibration.right.T_body_camera;
  EXPECT_TRUE(T_left_right.translation().isApprox(Eigen::Vector3d(0.12, 0.0, 0.0), 1e-12));
}

TEST(CalibrationLoader, TurnsRawCamerasByTheirRectification)
{
  // Each camera is turned a little against the rectified frame, the right one otherwise than the left one.
  const Eigen::Matrix3d R_rectified_left = Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const Eigen::Matrix3d R_rectified_right = Eigen::AngleAxisd(-0.03, Eigen::Vector3d::UnitX()).toRotationMatrix();
  sensor_msgs::CameraInfo left = makeInfo(0.0);
  sensor_msgs::CameraInfo right = makeInfo(-48.0);
  using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  Eigen::Map<RowMajor>(left.R.data()) = R_rectified_left;
  Eigen::Map<RowMajor>(right.R.data()) = R_rectified_right;
  for (const bool rectified : {false, true})
  {
    const StereoCalibration calibration = load(left, right, rectified);
    // A point in both cameras' frames, brought into the common rectified frame, differs by the baseline alone.
    const Eigen::Vector3d p_body(0.3, -0.4, 2.0);
    Eigen::Vector3d p_left = calibration.left.T_body_camera.inverse() * p_body;
    Eigen::Vector3d p_right = calibration.right.T_body_camera.inverse() * p_body;
    if (!rectified)
    {
      EXPECT_TRUE(p_left.isApprox(p_body, 1e-12));  // tf has the frame of the lens
      p_left = R_rectified_left * p_left;
      p_right = R_rectified_right * p_right;
    }
    EXPECT_TRUE((p_left - p_right).isApprox(Eigen::Vector3d(0.12, 0.0, 0.0), 1e-9));
    EXPECT_TRUE(p_left.isApprox(R_rectified_left * p_body, 1e-9));
  }
}

TEST(CalibrationLoader, NamesSwappedCameras)
{
  EXPECT_TRUE(contains(refusal(makeInfo(-48.0), makeInfo(0.0)), "/left/camera_info: P[3] is negative"));
  const std::string text = refusal(makeInfo(0.0), makeInfo(48.0));
  EXPECT_TRUE(contains(text, "/right/camera_info: P[3] = 48, must be negative")) << text;
  EXPECT_TRUE(contains(text, "swapped")) << text;

  StereoCalibration calibration = StereoCalibration::makeForwardPair();
  EXPECT_NO_THROW(checkStereo(calibration, "calibration"));
  std::swap(calibration.left, calibration.right);
  EXPECT_THROW(checkStereo(calibration, "calibration"), std::invalid_argument);
}

TEST(CalibrationLoader, NamesABaselineThatCannotBe)
{
  EXPECT_TRUE(contains(refusal(makeInfo(0.0), makeInfo(0.0)), "not calibrated as a pair"));
  EXPECT_TRUE(contains(refusal(makeInfo(0.0), makeInfo(-48000.0)), "baseline = 120 m"));
  EXPECT_TRUE(contains(refusal(makeInfo(0.0), makeInfo(-0.04)), "baseline = 0.0001 m"));
  sensor_msgs::CameraInfo no_rotation = makeInfo(-48.0);
  no_rotation.R.fill(0.0);
  EXPECT_TRUE(contains(refusal(makeInfo(0.0), no_rotation), "/right/camera_info: R is no rotation"));
  sensor_msgs::CameraInfo uncalibrated = makeInfo(0.0);
  uncalibrated.K.fill(0.0);
  EXPECT_TRUE(contains(refusal(uncalibrated, makeInfo(-48.0)), "/left/camera_info: K[0]"));
}

TEST(CalibrationLoader, RefusesOptionsThatContradict)
{
  const auto text = [](const CalibrationOptions& options) -> std::string
  {
    try
    {
      options.validate();
    }
    catch (const std::invalid_argument& error)
    {
      return error.what();
    }
    return "";
  };
  CalibrationOptions options;
  EXPECT_EQ("", text(options));
  options.imu_in_base = {1.0, 2.0};
  EXPECT_TRUE(contains(text(options), "calibration/imu_in_base has 2 numbers, must have 7"));
  options.imu_in_base = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
  EXPECT_TRUE(contains(text(options), "quaternion has norm 0"));
  options = CalibrationOptions();
  options.source = CalibrationSource::KALIBR;
  EXPECT_TRUE(contains(text(options), "calibration/camchain is not set"));
  options.camchain = "camchain.yaml";
  EXPECT_EQ("", text(options));
  options.rectified = true;
  EXPECT_TRUE(contains(text(options), "calibration/rectified = true"));
  options.rectified = false;
  options.left_in_imu = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  EXPECT_TRUE(contains(text(options), "calibration/left_in_imu is set"));
  options = CalibrationOptions();
  options.source = CalibrationSource::EUROC;
  EXPECT_TRUE(contains(text(options), "calibration/euroc_folder is not set"));
}

TEST(CalibrationLoader, ReadsKalibrsFilesAsTheyAre)
{
  const pi_node::test_support::TemporaryFolder folder;
  CalibrationOptions options;
  options.source = CalibrationSource::KALIBR;
  options.camchain = folder.file("camchain.yaml", R"(cam0:
  T_cam_imu:
  - [1.0, 0.0, 0.0, 0.05]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.0, 457.0, 367.0, 248.0]
  resolution: [752, 480]
  timeshift_cam_imu: 0.0125
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.0, 457.0, 367.0, 248.0]
  resolution: [752, 480]
)");
  options.imu_yaml = folder.file("imu.yaml",
                                 "update_rate: 400.0\ngyroscope_noise_density: 1.0e-3\n"
                                 "gyroscope_random_walk: 1.0e-5\naccelerometer_noise_density: 1.0e-2\n"
                                 "accelerometer_random_walk: 1.0e-4\n");
  ImuModel imu;
  imu.gyro_limit = 8.7;
  const FileCalibration calibration = loadCalibrationFiles(options, imu);
  EXPECT_NO_THROW(checkStereo(calibration.cameras, "kalibr"));
  EXPECT_NEAR(-0.05, calibration.cameras.left.T_body_camera.translation().x(), 1e-12);
  EXPECT_NEAR(0.06, calibration.cameras.right.T_body_camera.translation().x(), 1e-12);
  EXPECT_EQ(400.0, calibration.imu.rate_hz);
  EXPECT_EQ(1.0e-3, calibration.imu.gyro_noise_density);
  EXPECT_EQ(8.7, calibration.imu.gyro_limit);  // which the file does not say
  EXPECT_EQ(0.0125, calibration.imu.time_offset_s);

  options.imu_yaml.clear();
  EXPECT_EQ(imu.rate_hz, loadCalibrationFiles(options, imu).imu.rate_hz);
  options.camchain = folder.path() + "/missing.yaml";
  EXPECT_THROW(loadCalibrationFiles(options, imu), CalibrationError);
}

TEST(CalibrationLoader, NamesAFolderWithoutCalibration)
{
  const pi_node::test_support::TemporaryFolder folder;
  CalibrationOptions options;
  options.source = CalibrationSource::EUROC;
  options.euroc_folder = folder.path() + "/recording";
  try
  {
    loadCalibrationFiles(options, ImuModel());
    FAIL() << "a missing folder was read";
  }
  catch (const CalibrationError& error)
  {
    EXPECT_TRUE(contains(error.what(), "cam0/sensor.yaml: missing")) << error.what();
  }
}

}  // namespace
}  // namespace pi_slam
