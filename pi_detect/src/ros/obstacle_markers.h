#pragma once

#include <pi_detect/ObstacleArray.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstdint>
#include <set>

namespace pi_detect
{

/// Obstacles as rviz shows them: the outline as high as the box (the box where there is none), coloured by class (grey
/// without), a text "#id label 4.2 m 3.1 s" with distance and time to collision, an arrow for the velocity of what
/// moves (its end is where the obstacle is in one second). Markers keep the obstacle's id; those of vanished obstacles
/// are deleted. Not thread safe.
class ObstacleMarkers
{
public:
  /// @param lifetime_s  after which rviz removes them by itself, when no more come [s].
  explicit ObstacleMarkers(double lifetime_s);

  visualization_msgs::MarkerArrayPtr update(const ObstacleArray& obstacles);

private:
  const double lifetime_s_;
  std::set<int32_t> boxes_;  ///< shown now; a text belongs to each
  std::set<int32_t> arrows_;
};

}  // namespace pi_detect
