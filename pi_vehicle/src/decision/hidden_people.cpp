#include "decision/hidden_people.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_vehicle::hidden_people
{
namespace
{

constexpr double CHILD_HEIGHT = 0.9;      // [m]
constexpr double ADULT_SHOULDERS = 1.55;  // over a lower thing they are seen, before the person steps out [m]
constexpr double HIDING_WIDTH = 1.1;      // poles, boards and people are less wide: they hide nobody for long [m]
constexpr double SIDE_DEPTH = 0.5;        // of the side that faces the way: its far end is where people come from [m]
constexpr double CONTACT_SPEED = 0.5;     // that hurts nobody [m/s]

struct Beside
{
  double along;
  double gap;
};

Beside placeOf(const Eigen::Vector2d& point, const std::vector<Pose2>& way, double half_width)
{
  const auto nearest =
      std::min_element(way.begin(), way.end(),
                       [&point](const Pose2& a, const Pose2& b)
                       { return (a.position() - point).squaredNorm() < (b.position() - point).squaredNorm(); });
  double along = 0.0;
  for (auto pose = way.begin(); pose != nearest; ++pose)
  {
    along += ((pose + 1)->position() - pose->position()).norm();
  }
  const Eigen::Vector2d in_pose = nearest->inverse() * point;
  return {along + in_pose.x(), std::abs(in_pose.y()) - half_width};
}

}  // namespace

Who behind(const GroundPolygon& outline, const Eigen::Vector2d& eye, double top)
{
  // Across the line of sight: along it, the size of distant things is hardly known.
  const Eigen::Vector2d sight = (outline.middle() - eye).normalized();
  double left = -std::numeric_limits<double>::infinity();
  double right = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector2d& corner : outline.corners())
  {
    const double across = sight.x() * corner.y() - sight.y() * corner.x();
    left = std::max(left, across);
    right = std::min(right, across);
  }
  if (left - right < HIDING_WIDTH)
  {
    return Who::NOBODY;
  }
  return top >= ADULT_SHOULDERS ? Who::ADULT : top >= CHILD_HEIGHT ? Who::CHILD : Who::NOBODY;
}

Edge edgeOf(const GroundPolygon& outline, const std::vector<Pose2>& way, double half_width)
{
  std::vector<Beside> corners;
  Edge edge{-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  for (const Eigen::Vector2d& corner : outline.corners())
  {
    corners.push_back(placeOf(corner, way, half_width));
    edge.gap = std::min(edge.gap, corners.back().gap);
  }
  for (const Beside& corner : corners)
  {
    if (corner.gap < edge.gap + SIDE_DEPTH)
    {
      edge.distance = std::max(edge.distance, corner.along);
    }
  }
  return edge;
}

double allowedSpeed(const Edge& edge, double step_out_speed, const Vehicle& vehicle)
{
  constexpr double ANY = std::numeric_limits<double>::infinity();
  const double left = edge.distance - vehicle.front;
  if (step_out_speed <= 0.0 || edge.gap <= 0.0 || left <= 0.0)
  {
    return ANY;
  }
  const double braking_s = std::max(0.0, edge.gap / step_out_speed - vehicle.reaction_time);
  const double slow = CONTACT_SPEED + vehicle.emergency_deceleration * braking_s;
  const double stop = slow * vehicle.reaction_time + 0.5 * slow * slow / vehicle.emergency_deceleration;
  return std::sqrt(slow * slow + 2.0 * vehicle.deceleration * std::max(0.0, left - stop));
}

}  // namespace pi_vehicle::hidden_people
