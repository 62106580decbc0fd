#pragma once

#include <pi_detect/stereo_obstacles.h>

#include <Eigen/Core>

namespace pi_detect::obstacles
{

/// Camera of the matched disparity picture: the geometry at the size of the picture.
struct MatchedCamera
{
  int width = 0;
  int height = 0;
  double fx = 0.0;
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
  double fb = 0.0;             ///< fx * baseline: depth = fb / disparity [px m]
  double cx_difference = 0.0;  ///< what matching finds for infinitely far points [px]

  MatchedCamera(const StereoGeometry& geometry, int matched_width, int matched_height)
    : width(matched_width), height(matched_height)
  {
    const double scale_x = static_cast<double>(width) / geometry.width;
    const double scale_y = static_cast<double>(height) / geometry.height;
    fx = geometry.fx * scale_x;
    fy = geometry.fy * scale_y;
    cx = (geometry.cx + 0.5) * scale_x - 0.5;
    cy = (geometry.cy + 0.5) * scale_y - 0.5;
    fb = fx * geometry.baseline_m;
    cx_difference = geometry.cx_difference * scale_x;
  }

  /// Ray of a pixel to depth 1, in the optical frame.
  Eigen::Vector3d ray(double u, double v) const { return {(u - cx) / fx, (v - cy) / fy, 1.0}; }
};

/// Noise of a matched disparity, standard deviation [px]. Measured with bench_obstacles: 0.2 to 0.3 on surfaces.
constexpr double DISPARITY_SIGMA_PX = 0.25;
/// The part of this noise that does not average out [px].
constexpr double DISPARITY_FLOOR_PX = 0.08;

}  // namespace pi_detect::obstacles
