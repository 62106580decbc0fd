#include "ros/obstacles/stereo_camera.h"
#include <pi_detect/ros/conversions.h>
#include <pi_node/formatting.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace pi_detect
{
namespace
{

using pi_node::format;
using pi_node::sizeText;
using pi_os_transport::zero_copy::ImageHandle;

constexpr double MIN_BASELINE_M = 0.01;
constexpr double MAX_BASELINE_M = 3.0;
constexpr int POINTS_PER_SIDE = 5;  ///< of a box's outline, which a lens bends

[[noreturn]] void fail(const std::string& text)
{
  throw std::invalid_argument(text);
}

Eigen::Matrix3d rotation(const sensor_msgs::CameraInfo& info, const std::string& name)
{
  const Eigen::Matrix3d R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(info.R.data());
  // Files carry a handful of digits.
  if (!((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3) || R.determinant() < 0.0)
  {
    fail(name + ": R is no rotation: the cameras are not calibrated as a pair");
  }
  return Eigen::Quaterniond(R).normalized().toRotationMatrix();
}

StereoGeometry geometryOf(const sensor_msgs::CameraInfo& left, const std::string& name)
{
  const cv::Size size = pictureSize(left, name);
  const cv::Matx33d P = projection(left, name);
  StereoGeometry geometry;
  geometry.width = size.width;
  geometry.height = size.height;
  geometry.fx = P(0, 0);
  geometry.fy = P(1, 1);
  geometry.cx = P(0, 2);
  geometry.cy = P(1, 2);
  return geometry;
}

void requireBaseline(double baseline_m, const std::string& name)
{
  if (!(baseline_m >= MIN_BASELINE_M && baseline_m <= MAX_BASELINE_M))
  {
    fail(name + ": baseline = " + format("%g", baseline_m) + " m, must be in [" + format("%g", MIN_BASELINE_M) + ", " +
         format("%g", MAX_BASELINE_M) + "]: check the unit of the calibration");
  }
}

}  // namespace

StereoCamera StereoCamera::fromMsg(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right,
                                   const std::string& left_name, const std::string& right_name)
{
  StereoCamera camera;
  camera.geometry = geometryOf(left, left_name);
  camera.R_rectified_left = rotation(left, left_name);
  const cv::Matx33d P_right = projection(right, right_name);
  const cv::Size size = pictureSize(right, right_name);
  StereoGeometry& geometry = camera.geometry;
  if (size.width != geometry.width || size.height != geometry.height)
  {
    fail(right_name + " is for " + sizeText(size.width, size.height) + ", but " + left_name + " for " +
         sizeText(geometry.width, geometry.height) + "; set both cameras to the same size");
  }
  const double baseline_m = left.P[3] / left.P[0] - right.P[3] / right.P[0];
  const std::string number = format("%g", right.P[3]);
  if (baseline_m < 0.0)
  {
    fail(right_name + ": P[3] = " + number +
         ", must be -focal length * baseline: the cameras are swapped; swap the topics of left and right");
  }
  if (!(baseline_m > 0.0))
  {
    fail(right_name + ": P[3] = " + number +
         ", must be -focal length * baseline: the cameras are not calibrated as a pair; calibrate them as one");
  }
  requireBaseline(baseline_m, right_name);
  if (std::abs(P_right(0, 0) - geometry.fx) > 1e-3 * geometry.fx ||
      std::abs(P_right(1, 1) - geometry.fy) > 1e-3 * geometry.fy || std::abs(P_right(1, 2) - geometry.cy) > 0.5)
  {
    fail(right_name + ": P has fx, fy, cy = " + format("%.2f, ", P_right(0, 0)) + format("%.2f, ", P_right(1, 1)) +
         format("%.2f", P_right(1, 2)) + ", those of " + left_name + " are " + format("%.2f, ", geometry.fx) +
         format("%.2f, ", geometry.fy) + format("%.2f", geometry.cy) +
         ": the pair is not rectified; calibrate the cameras as one");
  }
  geometry.baseline_m = baseline_m;
  geometry.cx_difference = geometry.cx - P_right(0, 2);
  geometry.validate();
  return camera;
}

StereoCamera StereoCamera::fromMsg(const sensor_msgs::CameraInfo& left, const stereo_msgs::DisparityImage& disparity,
                                   const std::string& left_name)
{
  StereoCamera camera;
  camera.geometry = geometryOf(left, left_name);
  camera.R_rectified_left = rotation(left, left_name);
  StereoGeometry& geometry = camera.geometry;
  if (std::abs(disparity.f - geometry.fx) > 1e-2 * geometry.fx)
  {
    fail(left_name + ": P[0] = " + format("%.2f", geometry.fx) +
         ", but the disparity's f = " + format("%.2f", disparity.f) + " [px]: they must be of the same camera");
  }
  geometry.baseline_m = disparity.T;
  requireBaseline(geometry.baseline_m, "disparity");
  geometry.validate();
  return camera;
}

bool sameCamera(sensor_msgs::CameraInfo a, const sensor_msgs::CameraInfo& b)
{
  a.header.seq = b.header.seq;
  a.header.stamp = b.header.stamp;
  return a == b;
}

// ----------------------------------------------------------------------------------------------------------- Rectifier

Rectifier::Rectifier(const sensor_msgs::CameraInfo& info, const std::string& name)
  : lens_(info, name), P_(projection(info, name))
{
  cv::eigen2cv(rotation(info, name), R_);
  const cv::Size size = pictureSize(info, name);
  if (lens_.equidistant)
  {
    cv::fisheye::initUndistortRectifyMap(lens_.K, lens_.D, R_, P_, size, CV_16SC2, map_xy_, map_fraction_);
  }
  else
  {
    cv::initUndistortRectifyMap(lens_.K, lens_.D, R_, P_, size, CV_16SC2, map_xy_, map_fraction_);
  }
}

cv::Mat Rectifier::rectify(const cv::Mat& raw) const
{
  cv::Mat rectified;
  cv::remap(raw, rectified, map_xy_, map_fraction_, cv::INTER_LINEAR);
  return rectified;
}

Box Rectifier::rectify(const Box& raw) const
{
  std::vector<cv::Point2f> outline;
  for (int i = 0; i < POINTS_PER_SIDE; ++i)
  {
    const float part = static_cast<float>(i) / (POINTS_PER_SIDE - 1);
    const float x = raw.x1 + part * raw.width();
    const float y = raw.y1 + part * raw.height();
    outline.insert(outline.end(), {{x, raw.y1}, {x, raw.y2}, {raw.x1, y}, {raw.x2, y}});
  }
  std::vector<cv::Point2f> straight;
  if (lens_.equidistant)
  {
    cv::fisheye::undistortPoints(outline, straight, lens_.K, lens_.D, R_, P_);
  }
  else
  {
    cv::undistortPoints(outline, straight, lens_.K, lens_.D, R_, P_);
  }
  Box box{straight[0].x, straight[0].y, straight[0].x, straight[0].y};
  for (const cv::Point2f& point : straight)
  {
    box.x1 = std::min(box.x1, point.x);
    box.y1 = std::min(box.y1, point.y);
    box.x2 = std::max(box.x2, point.x);
    box.y2 = std::max(box.y2, point.y);
  }
  return box;
}

// ------------------------------------------------------------------------------------------------------- StereoPairing

}  // namespace pi_detect
