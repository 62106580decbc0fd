#pragma once

#include <pi_detect/stereo_obstacles.h>

namespace pi_detect
{

constexpr double CAMERA_HEIGHT_M = 1.0;

/// Stereo cameras as tests have them: 640x480, 12 cm apart.
inline StereoGeometry makeGeometry()
{
  StereoGeometry geometry;
  geometry.width = 640;
  geometry.height = 480;
  geometry.fx = geometry.fy = 320.0;
  geometry.cx = 319.5;
  geometry.cy = 239.5;
  geometry.baseline_m = 0.12;
  return geometry;
}

/// They look along x of base_link, above its origin.
inline Eigen::Isometry3d makeMounting()
{
  Eigen::Isometry3d T_base_left = Eigen::Isometry3d::Identity();
  T_base_left.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  T_base_left.translation().z() = CAMERA_HEIGHT_M;
  return T_base_left;
}

}  // namespace pi_detect
