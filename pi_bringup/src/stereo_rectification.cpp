#include <pi_bringup/stereo_rectification.h>

#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

namespace pi_bringup
{

namespace
{

cv::Matx33d cameraMatrix(const CameraCalibration& camera)
{
  const auto& [fx, fy, cx, cy] = camera.intrinsics;
  return {fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0};
}

cv::Vec4d distortion(const CameraCalibration& camera)
{
  return {camera.distortion[0], camera.distortion[1], camera.distortion[2], camera.distortion[3]};
}

Rectification toRectification(const cv::Mat& R, const cv::Mat& P)
{
  Rectification rectification;
  for (int row = 0; row < 3; ++row)
  {
    for (int column = 0; column < 3; ++column)
    {
      rectification.R(row, column) = R.at<double>(row, column);
    }
    for (int column = 0; column < 4; ++column)
    {
      rectification.P(row, column) = P.at<double>(row, column);
    }
  }
  return rectification;
}

}  // namespace

Rectification rectifyMono(const CameraCalibration& camera)
{
  Rectification rectification;
  const auto& [fx, fy, cx, cy] = camera.intrinsics;
  rectification.P << fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0;
  return rectification;
}

StereoRectification rectifyStereo(const CameraCalibration& left, const CameraCalibration& right)
{
  if (left.width != right.width || left.height != right.height)
  {
    throw std::invalid_argument("stereo pair: left is " + std::to_string(left.width) + "x" +
                                std::to_string(left.height) + ", right is " + std::to_string(right.width) + "x" +
                                std::to_string(right.height) + "; both must have the same size");
  }
  const Eigen::Isometry3d T_right_left = right.T_body_camera.inverse() * left.T_body_camera;
  cv::Matx33d R_right_left;
  cv::Vec3d p_right_left;
  for (int row = 0; row < 3; ++row)
  {
    for (int column = 0; column < 3; ++column)
    {
      R_right_left(row, column) = T_right_left.linear()(row, column);
    }
    p_right_left(row) = T_right_left.translation()(row);
  }
  cv::Mat R_left, R_right, P_left, P_right, Q;
  cv::stereoRectify(cameraMatrix(left), distortion(left), cameraMatrix(right), distortion(right),
                    cv::Size(left.width, left.height), R_right_left, p_right_left, R_left, R_right, P_left, P_right, Q,
                    cv::CALIB_ZERO_DISPARITY, 0.0);
  return {toRectification(R_left, P_left), toRectification(R_right, P_right)};
}

}  // namespace pi_bringup
