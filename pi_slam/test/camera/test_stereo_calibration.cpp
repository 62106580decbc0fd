#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_slam/stereo_calibration.h>

using namespace pi_slam;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

namespace
{

std::string eurocYaml(const std::string& distortion, const std::string& model = "pinhole")
{
  return "%YAML:1.0\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0.0, -1.0, 0.0, 0.1,\n"
         "         1.0, 0.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0]\nrate_hz: 20\nresolution: [752, 480]\n"
         "camera_model: " +
         model + "\nintrinsics: [458.6, 457.2, 367.2, 248.3] # fu fv cu cv\ndistortion_model: " + distortion +
         "\ndistortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]\n";
}

/// Kalibr writes T_cam_imu: imu to camera.
const char* const CAMCHAIN = R"(cam0:
  T_cam_imu:
  - [0.0, -1.0, 0.0, 0.5]
  - [0.0, 0.0, -1.0, 0.0]
  - [1.0, 0.0, 0.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [0.0034, 0.0007, -0.0020, 0.0002]
  distortion_model: equidistant
  intrinsics: [190.9, 190.9, 254.9, 256.8]
  resolution: [512, 512]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.0034, 0.0007, -0.0020, 0.0002]
  distortion_model: equidistant
  intrinsics: [190.4, 190.4, 252.5, 255.1]
  resolution: [512, 512]
)";

}  // namespace

TEST(StereoCalibration, WritesWhatKalibrWouldForATurnedImu)
{
  const TemporaryFolder folder;
  const StereoCalibration before = StereoCalibration::loadKalibr(folder.file("before.yaml", CAMCHAIN));
  Eigen::Isometry3d T_body_imu = Eigen::Isometry3d::Identity();
  T_body_imu.linear() = Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const std::string file = folder.file("after.yaml", "");
  before.saveKalibr(file, T_body_imu, -0.0087);
  const StereoCalibration after = StereoCalibration::loadKalibr(file);
  EXPECT_TRUE(after.left.T_body_camera.isApprox(T_body_imu.inverse() * before.left.T_body_camera, 1e-9));
  EXPECT_TRUE(after.right.T_body_camera.isApprox(T_body_imu.inverse() * before.right.T_body_camera, 1e-9));
  EXPECT_EQ(after.right.model.coefficients, before.right.model.coefficients);
  EXPECT_EQ(after.left.model.width, 512);
  EXPECT_EQ(after.left.model.distortion, Distortion::EQUIDISTANT);
  EXPECT_NE(messageOf<CalibrationError>([&] { before.saveKalibr("/nowhere/at/all.yaml", T_body_imu, 0.0); })
                .find("cannot be written"),
            std::string::npos);
}

TEST(StereoCalibration, LensesHaveFourFiveOrEightCoefficients)
{
  const TemporaryFolder folder;
  const auto load = [&](const std::string& distortion, const std::string& more)
  {
    std::string yaml = eurocYaml(distortion);
    yaml.insert(yaml.rfind(']'), more);
    const std::string file = folder.file("camera.yaml", yaml);
    return StereoCalibration::loadEuroc(file, file);
  };
  StereoCalibration with_k3 = load("radial-tangential", ", -0.0021");
  EXPECT_EQ(-0.0021, with_k3.left.model.coefficients[4]);
  EXPECT_EQ(0.5, load("radial-tangential", ", 0.1, 0.3, 0.4, 0.5").left.model.coefficients[7]);
  EXPECT_NE(messageOf<CalibrationError>([&] { load("radial-tangential", ", 0.1, 0.3"); })
                .find("distortion_coefficients has 6 values, expected 4, or 5 with k3, or 8 with k3 to k6"),
            std::string::npos);
  EXPECT_NE(messageOf<CalibrationError>([&] { load("equidistant", ", 0.1"); }).find("has 5 values, expected 4"),
            std::string::npos);
  const std::string file = folder.file("kalibr.yaml", "");
  with_k3.saveKalibr(file, Eigen::Isometry3d::Identity(), 0.0);
  EXPECT_EQ(with_k3.left.model.coefficients, StereoCalibration::loadKalibr(file).left.model.coefficients);
}

TEST(StereoCalibration, ReadsEurocFiles)
{
  const TemporaryFolder folder;
  const std::string left = folder.file("left.yaml", eurocYaml("radial-tangential"));
  const std::string right = folder.file("right.yaml", eurocYaml("equidistant"));
  const StereoCalibration calibration = StereoCalibration::loadEuroc(left, right);
  EXPECT_EQ(calibration.left.model.width, 752);
  EXPECT_EQ(calibration.left.model.distortion, Distortion::RADTAN);
  EXPECT_EQ(calibration.right.model.distortion, Distortion::EQUIDISTANT);
  EXPECT_DOUBLE_EQ(calibration.left.model.coefficients[3], 1.8e-5);
  EXPECT_EQ(calibration.left.T_body_camera.translation(), Eigen::Vector3d(0.1, 0.2, 0.3));
}

TEST(StereoCalibration, ReadsKalibrAsItIs)
{
  const TemporaryFolder folder;
  const StereoCalibration calibration = StereoCalibration::loadKalibr(folder.file("camchain.yaml", CAMCHAIN));
  EXPECT_EQ(calibration.left.model.distortion, Distortion::EQUIDISTANT);
  EXPECT_DOUBLE_EQ(calibration.right.model.cx, 252.5);
  // The optical axis is the body's x axis.
  EXPECT_LT((calibration.left.T_body_camera.linear().col(2) - Eigen::Vector3d::UnitX()).norm(), 1e-9);
  // T_cn_cnm1 takes points of cam0 to cam1: cam1 stands 0.1 m along cam0's x.
  const Eigen::Isometry3d T_left_right = calibration.left.T_body_camera.inverse() * calibration.right.T_body_camera;
  EXPECT_LT((T_left_right.translation() - Eigen::Vector3d(0.1, 0.0, 0.0)).norm(), 1e-12);
}

TEST(StereoCalibration, ForwardPairLooksAheadWithTheLeftCameraOnTheLeft)
{
  const StereoCalibration calibration = StereoCalibration::makeForwardPair(640, 480, 0.12);
  EXPECT_LT((calibration.left.T_body_camera.linear().col(2) - Eigen::Vector3d::UnitX()).norm(), 1e-12);
  EXPECT_DOUBLE_EQ(calibration.left.T_body_camera.translation().y(), 0.06);
  EXPECT_DOUBLE_EQ(calibration.right.T_body_camera.translation().y(), -0.06);
  EXPECT_THROW(StereoCalibration::makeForwardPair(8, 480, 0.12), std::invalid_argument);
  EXPECT_THROW(StereoCalibration::makeForwardPair(640, 480, 0.0), std::invalid_argument);
}

TEST(StereoCalibration, NamesFileAndKeyOfWhatIsWrong)
{
  const TemporaryFolder folder;
  const auto complaint = [&](const std::string& text)
  {
    const std::string file = folder.file("sensor.yaml", text);
    return messageOf<CalibrationError>([&] { StereoCalibration::loadEuroc(file, file); });
  };
  EXPECT_NE(complaint(eurocYaml("fov")).find("sensor.yaml: distortion_model is \"fov\""), std::string::npos);
  EXPECT_NE(complaint(eurocYaml("equidistant", "omni")).find("camera_model is \"omni\""), std::string::npos);
  EXPECT_NE(complaint("rate_hz: 20\n").find("has no camera_model"), std::string::npos);
  EXPECT_NE(complaint("a: [1, 2\nb: }").find("is not YAML"), std::string::npos);
  std::string skewed = eurocYaml("equidistant");
  skewed.replace(skewed.find("-1.0"), 4, "-2.0");
  EXPECT_NE(complaint(skewed).find("T_BS is not a rigid transform"), std::string::npos);
  EXPECT_NE(messageOf<CalibrationError>([] { StereoCalibration::loadKalibr("/nowhere.yaml"); }).find("missing"),
            std::string::npos);
}
