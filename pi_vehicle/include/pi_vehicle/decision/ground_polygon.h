#pragma once

#include <pi_vehicle/decision/pose2.h>

#include <Eigen/Core>
#include <vector>

namespace pi_vehicle
{

/// A rectangle on the ground.
struct GroundRectangle
{
  Eigen::Vector2d centre;
  Eigen::Vector2d along;  ///< unit vector along its x axis
  Eigen::Vector2d half;   ///< half sizes along its axes [m]
};

/// A convex polygon on the ground [m].
class GroundPolygon
{
public:
  GroundPolygon() = default;
  /// @param corners  valid by isOutline().
  explicit GroundPolygon(std::vector<Eigen::Vector2d> corners);
  /// @param pose  centre, heading of its x axis. @param half  half sizes [m].
  static GroundPolygon box(const Pose2& pose, const Eigen::Vector2d& half);

  /// Finite, convex (within 1 mm), counter-clockwise, 3 corners or more, and not a line.
  static bool isOutline(const std::vector<Eigen::Vector2d>& corners);

  /// In another frame: T maps from this one. @param shift  in that frame.
  GroundPolygon in(const Pose2& T, const Eigen::Vector2d& shift = Eigen::Vector2d::Zero()) const;

  /// Whether the polygon, moved by `shift`, and the rectangle have a point in common. Exact: separating axes.
  bool overlaps(const GroundRectangle& rectangle, const Eigen::Vector2d& shift) const
  {
    const double reach = rectangle.half.norm() + radius_;
    return (rectangle.centre - shift - middle_).squaredNorm() <= reach * reach && isSeparatedByNone(rectangle, shift);
  }

  const std::vector<Eigen::Vector2d>& corners() const { return corners_; }
  const Eigen::Vector2d& middle() const { return middle_; }  ///< of a circle around it
  double radius() const { return radius_; }                  ///< of that circle [m]
  double mostX() const;
  /// Across the line of sight from `eye` [m]: the size along it is hardly known of what cameras see far away.
  double widthFrom(const Eigen::Vector2d& eye) const;

private:
  bool isSeparatedByNone(const GroundRectangle& rectangle, const Eigen::Vector2d& shift) const;

  struct Side
  {
    Eigen::Vector2d outward;  // unit vector
    double offset;            // of the side's line along it
  };

  std::vector<Eigen::Vector2d> corners_;
  std::vector<Side> sides_;
  Eigen::Vector2d middle_ = Eigen::Vector2d::Zero();
  double radius_ = 0.0;
};

}  // namespace pi_vehicle
