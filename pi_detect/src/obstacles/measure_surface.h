#pragma once

#include <pi_detect/stereo_obstacles.h>

#include <Eigen/Geometry>
#include <vector>

#include "obstacles/matched_camera.h"
#include "obstacles/measure_outline.h"
#include "obstacles/surfaces.h"

namespace pi_detect::obstacles
{

/// Turns surfaces into obstacles.
class SurfaceMeter
{
public:
  SurfaceMeter(const MatchedCamera& camera, const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
               const StereoObstacleOptions& options);

  /// Appends the surface's obstacles (none if it is too small, several if its box would be mostly empty) and points.
  void add(const Surface& surface, std::vector<ObstacleMeasurement>* obstacles,
           std::vector<Eigen::Vector3f>* points) const;

private:
  void split(std::vector<SurfacePoint> part, bool cut_left, bool cut_right, bool piece,
             std::vector<ObstacleMeasurement>* obstacles, std::vector<Eigen::Vector3f>* points) const;
  bool measure(const std::vector<SurfacePoint>& part, ObstacleMeasurement* obstacle) const;
  void measureNearest(const std::vector<SurfacePoint>& part, ObstacleMeasurement* obstacle) const;

  MatchedCamera camera_;
  StereoGeometry geometry_;
  Eigen::Isometry3d T_base_left_;
  StereoObstacleOptions options_;
  OutlineScale outline_scale_;
};

}  // namespace pi_detect::obstacles
