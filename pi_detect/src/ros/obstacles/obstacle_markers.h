#pragma once

#include <pi_detect/ObstacleArray.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstdint>
#include <set>

namespace pi_detect
{

/// Obstacles as markers for rviz: the outline, extruded to the height of the box (or the box), coloured by class (grey
/// without class); a text "#id label 4.2 m 3.1 s" with distance and time to collision; for moving obstacles an arrow to
/// their place in 1 s. Markers have the ids of obstacles; those of vanished obstacles are deleted. Not thread safe.
class ObstacleMarkers
{
public:
  /// @param lifetime_s  after which rviz removes markers that are not renewed [s].
  explicit ObstacleMarkers(double lifetime_s);

  visualization_msgs::MarkerArrayPtr update(const ObstacleArray& obstacles);

private:
  const double lifetime_s_;
  std::set<int32_t> boxes_;  ///< shown now; a text belongs to each
  std::set<int32_t> arrows_;
};

}  // namespace pi_detect
