#pragma once

#include <pi_detect/outline.h>
#include <pi_detect/stereo_obstacles.h>

#include <Eigen/Geometry>
#include <vector>

namespace pi_detect::obstacles
{

/// Tells which places one stereo pair shows to be free. Refers to its arguments.
class ObstacleView
{
public:
  /// @param min_depth_m  nearer things are not seen [m].
  ObstacleView(const std::vector<ObstacleMeasurement>& measurements, const StereoGeometry& geometry,
               const Eigen::Isometry3d& T_base_left, double min_depth_m);

  /// Whether an obstacle at this point would be visible: inside the picture, and not behind a measured one.
  bool isExposed(const Eigen::Vector3d& p_base) const;

  /// The part of an outline that would not be visible: the outline without its visible ends. May be empty.
  /// @param outline  in base_link. @param z  height in base_link at which visibility is tested.
  Outline hiddenPart(const Outline& outline, double z) const;

private:
  const std::vector<ObstacleMeasurement>& measurements_;
  const StereoGeometry& geometry_;
  Eigen::Isometry3d T_base_left_;
  Eigen::Isometry3d T_left_base_;
  double min_depth_m_;
};

}  // namespace pi_detect::obstacles
