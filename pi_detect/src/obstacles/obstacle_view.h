#pragma once

#include <pi_detect/outline.h>
#include <pi_detect/stereo_obstacles.h>

#include <Eigen/Geometry>
#include <vector>

namespace pi_detect::obstacles
{

/// What one stereo pair shows, and so, where nothing is. Refers to its arguments.
class ObstacleView
{
public:
  /// @param min_depth_m  nearer things are not seen [m].
  ObstacleView(const std::vector<ObstacleMeasurement>& measurements, const StereoGeometry& geometry,
               const Eigen::Isometry3d& T_base_left, double min_depth_m);

  /// A thing there should be seen: inside the picture, and nothing measured lies before it.
  bool isExposed(const Eigen::Vector3d& p_base) const;

  /// An outline that is not measured, without the ends on which a thing should be seen; empty if it should be wholly.
  /// @param outline  in base_link. @param z  height in base_link at which it should be seen.
  Outline hiddenPart(const Outline& outline, double z) const;

private:
  const std::vector<ObstacleMeasurement>& measurements_;
  const StereoGeometry& geometry_;
  Eigen::Isometry3d T_base_left_;
  Eigen::Isometry3d T_left_base_;
  double min_depth_m_;
};

}  // namespace pi_detect::obstacles
