#pragma once

#include "front_end/frame_features.h"

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace pi_slam
{

/// What odometry hands to the map: a pair of pictures, where it was taken, and the landmarks seen.
struct MapFrame
{
  struct Landmark
  {
    int64_t id = 0;
    Eigen::Vector2f pixel;     ///< in the left picture, as the lens shows it
    Eigen::Vector3d p_body;    ///< in the body frame at the time of the pair [m]
    double deviation_m = 0.0;  ///< of its distance
  };

  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_odom_body = Eigen::Isometry3d::Identity();
  cv::Mat left;  ///< CV_8UC1; shared, never written to again
  cv::Mat right;
  std::vector<Landmark> landmarks;
};

}  // namespace pi_slam
