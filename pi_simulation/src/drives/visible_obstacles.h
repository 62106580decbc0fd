#pragma once

#include "renderer/stereo_renderer.h"
#include "world/synthetic_world.h"

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

namespace pi_simulation
{

/// What a perfect detector would report of one obstacle in the left picture.
struct VisibleObstacle
{
  int id = 0;
  std::string class_name;
  cv::Rect box;                                      ///< around its visible pixels
  int pixels = 0;                                    ///< that see it
  double visible = 1.0;                              ///< part of what would be seen in the picture if nothing hid it
  double nearest_depth_m = 0.0;                      ///< least depth of these pixels, along the optical axis [m]
  Eigen::Vector3d p_body = Eigen::Vector3d::Zero();  ///< centre of its box in the body frame [m]
  Eigen::Vector3d v_body = Eigen::Vector3d::Zero();  ///< its velocity over the ground, in body axes [m/s]
  Eigen::Vector3d size = Eigen::Vector3d::Zero();    ///< of its box, along its own axes [m]
  double heading = 0.0;                              ///< of its x axis, seen from the body's [rad]
};

/// @param frame       rendered with StereoRendererOptions::truth.
/// @param min_pixels  obstacles with fewer visible pixels are left out.
/// @throws std::invalid_argument if the frame carries no truth.
std::vector<VisibleObstacle> visibleObstacles(const SyntheticWorld& world, const StereoFrame& frame,
                                              const Eigen::Isometry3d& T_world_body, int min_pixels = 20);

/// {"stamp_ns": ..., "obstacles": [{"id", "class", "box": [x1, y1, x2, y2], "pixels", "visible", "nearest_depth_m",
/// "position", "velocity", "size", "heading"}]} on one line. x2 and y2 are exclusive.
std::string toJson(int64_t stamp_ns, const std::vector<VisibleObstacle>& obstacles);

}  // namespace pi_simulation
