#include "ros/lens.h"
#include <pi_node/formatting.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <stdexcept>
#include <vector>

namespace pi_detect
{

using pi_node::format;
using pi_node::sizeText;

namespace
{

constexpr uint32_t MAX_PICTURE_SIDE_PX = 16384;

/// K or the first columns of P for the pictures as they come, with binning and region of interest.
cv::Matx33d adjusted(cv::Matx33d matrix, const sensor_msgs::CameraInfo& info)
{
  const bool whole = info.roi.width == 0 || info.roi.height == 0;
  const double binning_x = std::max(info.binning_x, 1U);
  const double binning_y = std::max(info.binning_y, 1U);
  matrix(0, 0) /= binning_x;
  matrix(1, 1) /= binning_y;
  matrix(0, 2) = (matrix(0, 2) - (whole ? 0.0 : info.roi.x_offset)) / binning_x;
  matrix(1, 2) = (matrix(1, 2) - (whole ? 0.0 : info.roi.y_offset)) / binning_y;
  return matrix;
}

}  // namespace

cv::Size pictureSize(const sensor_msgs::CameraInfo& info, const std::string& name)
{
  if (info.width == 0 || info.height == 0 || info.width > MAX_PICTURE_SIDE_PX || info.height > MAX_PICTURE_SIDE_PX)
  {
    throw std::invalid_argument(name + ": size is " + sizeText(info.width, info.height) +
                                ": the camera is not calibrated");
  }
  const bool whole = info.roi.width == 0 || info.roi.height == 0;
  return {static_cast<int>((whole ? info.width : info.roi.width) / std::max(info.binning_x, 1U)),
          static_cast<int>((whole ? info.height : info.roi.height) / std::max(info.binning_y, 1U))};
}

cv::Matx33d projection(const sensor_msgs::CameraInfo& info, const std::string& name)
{
  const auto& P = info.P;
  if (!(P[0] > 0.0) || !(P[5] > 0.0) || !std::isfinite(P[0] + P[2] + P[5] + P[6]))
  {
    throw std::invalid_argument(name + ": P[0] = " + format("%g", P[0]) +
                                ", must be a focal length [px]: the camera is not calibrated");
  }
  return adjusted(cv::Matx33d(P[0], P[1], P[2], P[4], P[5], P[6], P[8], P[9], P[10]), info);
}

Lens Lens::rectified(const sensor_msgs::CameraInfo& info, const std::string& name)
{
  Lens lens;
  lens.K = projection(info, name);
  lens.D = cv::Mat::zeros(4, 1, CV_64F);
  return lens;
}

Lens::Lens(const sensor_msgs::CameraInfo& info, const std::string& name)
{
  const std::string& lens = info.distortion_model;
  const bool zero = std::all_of(info.D.begin(), info.D.end(), [](double value) { return value == 0.0; });
  equidistant = lens == "equidistant" || lens == "fisheye";
  if (!equidistant && !zero && lens != "plumb_bob" && lens != "rational_polynomial")
  {
    throw std::invalid_argument(name + ": distortion_model = \"" + lens +
                                "\", must be plumb_bob, rational_polynomial or equidistant");
  }
  const size_t coefficients = info.D.size();
  if (equidistant ? coefficients != 4
                  : coefficients != 0 && coefficients != 4 && coefficients != 5 && coefficients != 8 &&
                        coefficients != 12 && coefficients != 14)
  {
    throw std::invalid_argument(name + ": D has " + std::to_string(coefficients) + " values, must have " +
                                (equidistant ? "4" : "4, 5, 8, 12 or 14") + " for " + lens);
  }
  if (!(info.K[0] > 0.0) || !(info.K[4] > 0.0))
  {
    throw std::invalid_argument(name + ": K[0] = " + format("%g", info.K[0]) +
                                ", must be a focal length [px]: the camera is not calibrated");
  }
  K = adjusted(cv::Matx33d(info.K.data()), info);
  D = coefficients == 0
          ? cv::Mat::zeros(4, 1, CV_64F)
          : cv::Mat(static_cast<int>(coefficients), 1, CV_64F, const_cast<double*>(info.D.data())).clone();
}

Eigen::Vector3d Lens::ray(const Eigen::Vector2d& pixel) const
{
  const std::vector<cv::Point2d> pixels{{pixel.x(), pixel.y()}};
  std::vector<cv::Point2d> plane;
  if (equidistant)
  {
    cv::fisheye::undistortPoints(pixels, plane, K, D);
  }
  else
  {
    cv::undistortPoints(pixels, plane, K, D);
  }
  return {plane[0].x, plane[0].y, 1.0};
}

Eigen::Vector2d Lens::pixel(const Eigen::Vector3d& ray) const
{
  std::vector<cv::Point2d> pixels;
  if (equidistant)
  {
    const std::vector<cv::Point2d> plane{{ray.x() / ray.z(), ray.y() / ray.z()}};
    cv::fisheye::distortPoints(plane, pixels, K, D);
  }
  else
  {
    const std::vector<cv::Point3d> points{{ray.x(), ray.y(), ray.z()}};
    cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), K, D, pixels);
  }
  return {pixels[0].x, pixels[0].y};
}

}  // namespace pi_detect
