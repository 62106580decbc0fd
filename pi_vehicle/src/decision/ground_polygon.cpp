#include <pi_vehicle/decision/ground_polygon.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace pi_vehicle
{
namespace
{

constexpr double DENT_M = 1e-3;    // corners lie on a side or beyond it, within this
constexpr double LEAST_M2 = 1e-6;  // area of what is not a line
constexpr double SAME_M = 1e-6;    // shorter sides have no direction

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b)
{
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

GroundPolygon::GroundPolygon(std::vector<Eigen::Vector2d> corners) : corners_(std::move(corners))
{
  Eigen::Vector2d low = corners_.front();
  Eigen::Vector2d high = low;
  for (size_t i = 0; i < corners_.size(); ++i)
  {
    const Eigen::Vector2d& corner = corners_[i];
    low = low.cwiseMin(corner);
    high = high.cwiseMax(corner);
    const Eigen::Vector2d side = corners_[(i + 1) % corners_.size()] - corner;
    const double length = side.norm();
    if (length > SAME_M)
    {
      const Eigen::Vector2d outward = Eigen::Vector2d(side.y(), -side.x()) / length;
      sides_.push_back({outward, outward.dot(corner)});
    }
  }
  middle_ = 0.5 * (low + high);
  for (const Eigen::Vector2d& corner : corners_)
  {
    radius_ = std::max(radius_, (corner - middle_).norm());
  }
}

GroundPolygon GroundPolygon::box(const Pose2& pose, const Eigen::Vector2d& half)
{
  return GroundPolygon({pose * Eigen::Vector2d(-half.x(), -half.y()), pose * Eigen::Vector2d(half.x(), -half.y()),
                        pose * Eigen::Vector2d(half.x(), half.y()), pose * Eigen::Vector2d(-half.x(), half.y())});
}

bool GroundPolygon::isOutline(const std::vector<Eigen::Vector2d>& corners)
{
  const size_t n = corners.size();
  if (n < 3 || !std::all_of(corners.begin(), corners.end(), [](const auto& corner) { return corner.allFinite(); }))
  {
    return false;
  }
  double twice_area = 0.0;
  for (size_t i = 0; i < n; ++i)
  {
    const Eigen::Vector2d side = corners[(i + 1) % n] - corners[i];
    // Of one that goes round twice, too, a corner lies beyond a side.
    for (const Eigen::Vector2d& corner : corners)
    {
      if (cross(side, corner - corners[i]) < -DENT_M * side.norm())
      {
        return false;
      }
    }
    twice_area += cross(corners[i] - corners[0], corners[(i + 1) % n] - corners[0]);
  }
  return twice_area > 2.0 * LEAST_M2;
}

GroundPolygon GroundPolygon::in(const Pose2& T, const Eigen::Vector2d& shift) const
{
  const double c = std::cos(T.heading);
  const double s = std::sin(T.heading);
  const Eigen::Vector2d origin = T.position() + shift;
  const auto turned = [c, s](const Eigen::Vector2d& v)
  { return Eigen::Vector2d(c * v.x() - s * v.y(), s * v.x() + c * v.y()); };
  GroundPolygon result(*this);
  for (Eigen::Vector2d& corner : result.corners_)
  {
    corner = origin + turned(corner);
  }
  for (Side& side : result.sides_)
  {
    side.outward = turned(side.outward);
    side.offset += side.outward.dot(origin);
  }
  result.middle_ = origin + turned(middle_);
  return result;
}

bool GroundPolygon::isSeparatedByNone(const GroundRectangle& rectangle, const Eigen::Vector2d& shift) const
{
  const Eigen::Vector2d centre = rectangle.centre - shift;
  const Eigen::Vector2d& along = rectangle.along;
  const Eigen::Vector2d across(-along.y(), along.x());
  for (const Side& side : sides_)
  {
    const double half = rectangle.half.x() * std::abs(side.outward.dot(along)) +
                        rectangle.half.y() * std::abs(side.outward.dot(across));
    if (side.outward.dot(centre) - half > side.offset)
    {
      return false;
    }
  }
  constexpr double FAR = std::numeric_limits<double>::infinity();
  Eigen::Vector2d low(FAR, FAR);
  Eigen::Vector2d high(-FAR, -FAR);
  for (const Eigen::Vector2d& corner : corners_)
  {
    const Eigen::Vector2d p(along.dot(corner - centre), across.dot(corner - centre));
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return low.x() <= rectangle.half.x() && high.x() >= -rectangle.half.x() && low.y() <= rectangle.half.y() &&
         high.y() >= -rectangle.half.y();
}

double GroundPolygon::widthFrom(const Eigen::Vector2d& eye) const
{
  const Eigen::Vector2d sight = (middle_ - eye).normalized();
  double left = -std::numeric_limits<double>::infinity();
  double right = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector2d& corner : corners_)
  {
    const double across = sight.x() * corner.y() - sight.y() * corner.x();
    left = std::max(left, across);
    right = std::min(right, across);
  }
  return left - right;
}

double GroundPolygon::mostX() const
{
  double most = -std::numeric_limits<double>::infinity();
  for (const Eigen::Vector2d& corner : corners_)
  {
    most = std::max(most, corner.x());
  }
  return most;
}

}  // namespace pi_vehicle
