#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>
#include <string>

namespace pi_detect
{

/// K or the first columns of P for the pictures as they come, with binning and region of interest.
cv::Matx33d adjusted(cv::Matx33d matrix, const sensor_msgs::CameraInfo& info);

/// The lens of a camera's raw pictures: plumb_bob, rational_polynomial or equidistant.
struct Lens
{
  cv::Matx33d K;
  cv::Mat D;  ///< at least 4 x 1, CV_64F
  bool equidistant = false;

  Lens() = default;
  /// @param name  of the topic. @throws std::invalid_argument naming topic, field and value.
  Lens(const sensor_msgs::CameraInfo& info, const std::string& name);

  /// The direction that a pixel sees, with z = 1.
  Eigen::Vector3d ray(const Eigen::Vector2d& pixel) const;
  /// @param ray  with z above 0.
  Eigen::Vector2d pixel(const Eigen::Vector3d& ray) const;
};

}  // namespace pi_detect
