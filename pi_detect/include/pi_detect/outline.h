#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace pi_detect
{

/// Convex polygon on the ground [m], its corners counter-clockwise, at least 3; empty: unknown.
using Outline = std::vector<Eigen::Vector2d>;

constexpr size_t MAX_OUTLINE_CORNERS = 12;

/// A rectangle along the axes [m].
struct OutlineBounds
{
  Eigen::Vector2d low;
  Eigen::Vector2d high;

  Eigen::Vector2d size() const { return high - low; }
};

/// The least one around finite points, with as many corners as it takes; empty if they lie on a line.
Outline convexHull(std::vector<Eigen::Vector2d> points);

/// Takes corners away until no more than `most` (at least 4) are left, those first that add the least area: the result
/// holds the whole outline.
void limitCorners(Outline* outline, size_t most = MAX_OUTLINE_CORNERS);

double areaOf(const Outline& outline);

/// @param outline  not empty.
OutlineBounds boundsOf(const Outline& outline);

/// Whether the point is inside or no farther outside than `tolerance` [m], measured from the sides' lines.
bool contains(const Outline& outline, const Eigen::Vector2d& point, double tolerance = 0.0);

/// Where a ray enters the outline, as a multiple of its direction: 0 if it begins inside, infinite if it passes by.
/// @param outline  not empty.
double rayEntry(const Outline& outline, const Eigen::Vector2d& from, const Eigen::Vector2d& direction);

/// The part to the left of the line through `from` in `direction`; empty if nothing is.
Outline leftOf(const Outline& outline, const Eigen::Vector2d& from, const Eigen::Vector2d& direction);

}  // namespace pi_detect
