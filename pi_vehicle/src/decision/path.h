#pragma once

#include <pi_vehicle/decision/pose2.h>

#include <vector>

namespace pi_vehicle
{

/// A point of a path.
struct PathPoint
{
  double x = 0.0;          ///< [m]
  double y = 0.0;          ///< [m]
  double heading = 0.0;    ///< of the tangent [rad]
  double curvature = 0.0;  ///< left positive [1/m]
  double s = 0.0;          ///< way from the start [m]

  Pose2 pose() const { return {x, y, heading}; }
};

/// Where a pose lies beside a path.
struct PathProjection
{
  double s = 0.0;              ///< of the nearest point, in [0, length] [m]
  double cross_track = 0.0;    ///< of the pose, left of the path positive [m]
  double heading_error = 0.0;  ///< heading of the pose less that of the path, in [-pi, pi] [rad]
};

/// A dense polyline with tangents and curvatures; constant, so any thread may read it.
class Path
{
public:
  Path() = default;

  /// Takes points in order, best spaced by 0.05 to 0.2 m; headings and curvatures come from neighbours.
  /// @param closed  the last point is joined to the first, which must not be repeated.
  /// @throws std::invalid_argument naming the point: fewer than 2 points (closed: 3), not finite, two equal neighbours.
  explicit Path(const std::vector<Eigen::Vector2d>& points, bool closed = false);

  bool empty() const { return points_.empty(); }
  bool closed() const { return closed_; }
  double length() const { return length_; }  ///< [m]; of a closed path with its last piece
  const std::vector<PathPoint>& points() const { return points_; }

  /// @param s  [m]; a closed path goes round, an open one ends at its ends. The path must not be empty.
  PathPoint at(double s) const;

  /// s brought into [0, length): closed paths; into [0, length]: open ones.
  double wrap(double s) const;

  /// The nearest place of the part [from, to] of the path (closed: may reach beyond its ends). Of places that are
  /// about as near, the heading decides: each radian of difference counts as `heading_weight` [m].
  PathProjection project(const Pose2& pose, double from, double to, double heading_weight = 0.0) const;
  /// The same on the whole path.
  PathProjection project(const Pose2& pose, double heading_weight = 0.0) const;

private:
  size_t segmentAt(double s) const;

  std::vector<PathPoint> points_;  // closed: the first once more at the end
  bool closed_ = false;
  double length_ = 0.0;
};

}  // namespace pi_vehicle
