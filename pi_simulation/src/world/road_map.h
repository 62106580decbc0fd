#pragma once

#include "renderer/texture.h"

#include <Eigen/Core>
#include <vector>

namespace pi_simulation::synthetic
{

/// Distance to the nearest point of a road's centre line and that point's distance along it, in a grid that textures
/// look up with bilinear interpolation. Read by any thread once built.
class RoadMap
{
public:
  static constexpr float REACH_M = 8.0f;  ///< distances are known up to here and constant beyond

  struct Place
  {
    float lateral = REACH_M;  ///< distance from the centre line [m], 0 or more
    float along = 0.0f;       ///< [m]
    float dx = 0.0f;          ///< gradient of lateral, of either sign; (0, 0) beyond REACH_M
    float dy = 0.0f;
  };

  RoadMap() = default;
  explicit RoadMap(const std::vector<Eigen::Vector2d>& line);

  Place at(float x, float y) const;

  /// Places of many points.
  struct alignas(64) Places
  {
    float lateral[LANES];
    float along[LANES];
    float dx[LANES];
    float dy[LANES];
  };
  /// at() of the first n points of x and y, which have room for LANES; in vector code.
  void locate(const float* x, const float* y, int n, Places* places) const;

private:
  static constexpr float CELL_M = 0.25f;

  /// The cells around points.
  struct Corners
  {
    float lateral[4][LANES];
    float along[4][LANES];
  };

  void splat(const Eigen::Vector2f& a, const Eigen::Vector2f& b, float along);

  Eigen::Vector2f origin_ = Eigen::Vector2f::Zero();
  int width_ = 0;
  int height_ = 0;
  std::vector<float> lateral_;  ///< of each cell, above 0 on the left of the line
  std::vector<float> along_;
};

}  // namespace pi_simulation::synthetic
