#include <gtest/gtest.h>
#include <pi_bringup/stereo_rectification.h>

#include <random>
#include <stdexcept>

using pi_bringup::CameraCalibration;
using pi_bringup::Rectification;
using pi_bringup::rectifyMono;
using pi_bringup::rectifyStereo;

namespace
{

CameraCalibration camera(const Eigen::Vector3d& position, const Eigen::Vector3d& rotation)
{
  CameraCalibration calibration;
  calibration.width = 752;
  calibration.height = 480;
  calibration.intrinsics = {458.0, 457.0, 367.0, 248.0};
  calibration.distortion = {-0.28, 0.07, 0.0002, 0.00002};
  calibration.T_body_camera.translation() = position;
  if (rotation.norm() > 0.0)
  {
    calibration.T_body_camera.linear() = Eigen::AngleAxisd(rotation.norm(), rotation.normalized()).toRotationMatrix();
  }
  return calibration;
}

/// Pixel of a point given in the raw optical frame, by the convention of CameraInfo. The left frame's P is used for
/// points in the left rectified frame, the right one's P(0, 3) moves them over.
Eigen::Vector2d project(const Rectification& rectification, const Eigen::Vector3d& p_raw)
{
  const Eigen::Vector3d p_rectified = rectification.R * p_raw;
  const Eigen::Vector3d pixel = rectification.P.leftCols<3>() * p_rectified;
  return pixel.head<2>() / pixel.z();
}

}  // namespace

TEST(StereoRectification, PutsAPointIntoTheSameRowWithTheDisparityOfItsDepth)
{
  // Slightly turned against each other, as real pairs are.
  const CameraCalibration left = camera({0.0, 0.0, 0.0}, {0.01, -0.02, 0.03});
  const CameraCalibration right = camera({0.11, 0.002, -0.001}, {-0.01, 0.01, 0.0});
  const auto rectification = rectifyStereo(left, right);
  const double baseline = (right.T_body_camera.translation() - left.T_body_camera.translation()).norm();
  EXPECT_NEAR(-rectification.right.P(0, 0) * baseline, rectification.right.P(0, 3), 1e-6);
  EXPECT_EQ(0.0, rectification.left.P(0, 3));

  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(-2.0, 2.0);
  std::uniform_real_distribution<double> distance(3.0, 20.0);
  for (int i = 0; i < 100; ++i)
  {
    const Eigen::Vector3d p_body(side(random), side(random), distance(random));
    const Eigen::Vector3d p_left = left.T_body_camera.inverse() * p_body;
    const Eigen::Vector3d p_right = right.T_body_camera.inverse() * p_body;
    const Eigen::Vector2d in_left = project(rectification.left, p_left);
    const Eigen::Vector2d in_right = project(rectification.right, p_right);
    EXPECT_NEAR(in_left.y(), in_right.y(), 1e-6);
    const double depth = (rectification.left.R * p_left).z();
    EXPECT_NEAR(rectification.left.P(0, 0) * baseline / depth, in_left.x() - in_right.x(), 1e-6);
  }
}

TEST(StereoRectification, RefusesPicturesOfDifferentSizes)
{
  CameraCalibration right = camera({0.1, 0.0, 0.0}, {0.0, 0.0, 0.0});
  right.width = 640;
  EXPECT_THROW(rectifyStereo(camera({0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}), right), std::invalid_argument);
}

TEST(StereoRectification, KeepsTheIntrinsicsOfASingleCamera)
{
  const Rectification rectification = rectifyMono(camera({0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}));
  EXPECT_TRUE(rectification.R.isIdentity());
  EXPECT_EQ(458.0, rectification.P(0, 0));
  EXPECT_EQ(248.0, rectification.P(1, 2));
  EXPECT_EQ(0.0, rectification.P(0, 3));
}
