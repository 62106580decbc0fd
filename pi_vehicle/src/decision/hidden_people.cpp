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
constexpr double OUT_REACH = 1.0;         // from what hid somebody to where the stereo cameras see them first [m]
constexpr double LEAST_RADIUS = 0.2;      // of a circle around a person who is seen in part; poles are thinner [m]
constexpr double LEAST_SPEED = 0.35;      // that a child was found to have after three pictures, not yet certain [m/s]

struct Beside
{
  double along;
  double gap;
};

std::vector<Pose2>::const_iterator nearestOf(const std::vector<Pose2>& way, const Eigen::Vector2d& point)
{
  return std::min_element(way.begin(), way.end(),
                          [&point](const Pose2& a, const Pose2& b)
                          { return (a.position() - point).squaredNorm() < (b.position() - point).squaredNorm(); });
}

Beside placeOf(const Eigen::Vector2d& point, const std::vector<Pose2>& way, double half_width)
{
  const auto nearest = nearestOf(way, point);
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
  if (outline.widthFrom(eye) < HIDING_WIDTH)
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
  const double room = std::max(0.0, left - stop);
  const double delayed = vehicle.deceleration * vehicle.brakes_delay;
  return std::max(slow, std::sqrt(delayed * delayed + slow * slow + 2.0 * vehicle.deceleration * room) - delayed);
}

bool isNotWiderThanPerson(const GroundPolygon& outline, const Eigen::Vector2d& eye)
{
  return outline.widthFrom(eye) < HIDING_WIDTH;
}

bool comesOut(const GroundPolygon& seen, const Eigen::Vector2d& velocity, const GroundPolygon& hider,
              const std::vector<Pose2>& way)
{
  return seen.radius() > LEAST_RADIUS && isNotWiderThanPerson(seen, way.front().position()) &&
         velocity.dot(towards(way, seen.middle())) > LEAST_SPEED &&
         hider.overlaps({seen.middle(), Eigen::Vector2d::UnitX(), {OUT_REACH, OUT_REACH}}, Eigen::Vector2d::Zero()) &&
         placeOf(seen.middle(), way, 0.0).along > edgeOf(hider, way, 0.0).distance;
}

Eigen::Vector2d towards(const std::vector<Pose2>& way, const Eigen::Vector2d& point)
{
  const Pose2& nearest = *nearestOf(way, point);
  const Eigen::Vector2d left(-std::sin(nearest.heading), std::cos(nearest.heading));
  return (nearest.inverse() * point).y() > 0.0 ? Eigen::Vector2d(-left) : left;
}

}  // namespace pi_vehicle::hidden_people
