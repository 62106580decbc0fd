#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace pi_detect
{

/// Convex polygon on the ground [m], its corners counter-clockwise, at least 3; empty: unknown.
using Outline = std::vector<Eigen::Vector2d>;

constexpr size_t MAX_OUTLINE_CORNERS = 12;

/// An axis-aligned rectangle [m].
struct OutlineBounds
{
  Eigen::Vector2d low;
  Eigen::Vector2d high;

  Eigen::Vector2d size() const { return high - low; }
};

/// The convex hull of finite points; empty if they lie on a line. Own code: OpenCV's hull takes 32-bit floats only, and
/// that of Boost keeps corners that turn by next to nothing.
Outline convexHull(std::vector<Eigen::Vector2d> points);

/// Removes sides until at most `most` (at least 4) corners are left, those first that add the least area. The result
/// contains the whole outline.
void limitCorners(Outline* outline, size_t most = MAX_OUTLINE_CORNERS);

double areaOf(const Outline& outline);

/// @param outline  not empty.
OutlineBounds boundsOf(const Outline& outline);

/// Whether the point is inside, or at most `tolerance` [m] outside of each side's line.
bool contains(const Outline& outline, const Eigen::Vector2d& point, double tolerance = 0.0);

/// Where a ray enters the outline, as a multiple of `direction`: 0 if it begins inside, infinite if it misses.
/// @param outline  not empty.
double rayEntry(const Outline& outline, const Eigen::Vector2d& from, const Eigen::Vector2d& direction);

/// The part to the left of the line through `from` in `direction`; may be empty.
Outline leftOf(const Outline& outline, const Eigen::Vector2d& from, const Eigen::Vector2d& direction);

}  // namespace pi_detect
