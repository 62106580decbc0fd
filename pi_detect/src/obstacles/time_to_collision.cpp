#include <algorithm>
#include <cmath>
#include <limits>

#include <pi_detect/obstacle_tracker.h>

namespace pi_detect
{

// The vehicle's outline grown by the half size is a rectangle; the point enters it when it is between both pairs of its
// sides at once.
double timeToCollision(const Eigen::Vector2d& p, const Eigen::Vector2d& v, const Eigen::Vector2d& half_size,
                       const ObstacleTrackerOptions& options)
{
  constexpr double NEVER = std::numeric_limits<double>::infinity();
  const Eigen::Vector2d low(-options.footprint.rear - half_size.x(), -options.footprint.half_width - half_size.y());
  const Eigen::Vector2d high(options.footprint.front + half_size.x(), options.footprint.half_width + half_size.y());
  double enters = 0.0;
  double leaves = NEVER;
  for (int axis = 0; axis < 2; ++axis)
  {
    if (v(axis) == 0.0)
    {
      if (p(axis) < low(axis) || p(axis) > high(axis))
      {
        return NEVER;
      }
      continue;
    }
    const double one = (low(axis) - p(axis)) / v(axis);
    const double other = (high(axis) - p(axis)) / v(axis);
    enters = std::max(enters, std::min(one, other));
    leaves = std::min(leaves, std::max(one, other));
  }
  return enters <= leaves ? enters : NEVER;
}

}  // namespace pi_detect
