#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>
#include <string>

namespace pi_detect
{

// A camera's calibration, for the pictures as they come: with binning and region of interest.
// name: of its topic. All throw std::invalid_argument naming topic, field and value.

/// [px]
cv::Size pictureSize(const sensor_msgs::CameraInfo& info, const std::string& name);
/// The first three columns of P: of rectified pictures.
cv::Matx33d projection(const sensor_msgs::CameraInfo& info, const std::string& name);

/// The lens of a camera's raw pictures: plumb_bob, rational_polynomial or equidistant.
struct Lens
{
  cv::Matx33d K;
  cv::Mat D;  ///< at least 4 x 1, CV_64F
  bool equidistant = false;

  Lens() = default;
  Lens(const sensor_msgs::CameraInfo& info, const std::string& name);

  /// Of its rectified pictures: none.
  static Lens rectified(const sensor_msgs::CameraInfo& info, const std::string& name);

  /// The direction that a pixel sees, with z = 1.
  Eigen::Vector3d ray(const Eigen::Vector2d& pixel) const;
  /// @param ray  with z above 0.
  Eigen::Vector2d pixel(const Eigen::Vector3d& ray) const;
};

}  // namespace pi_detect
