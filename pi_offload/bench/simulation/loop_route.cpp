#include "simulation/loop_route.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace pi_offload::simulation
{

LoopRoute::LoopRoute(std::vector<Point> points) : points_(std::move(points))
{
  if (!points_.empty())
  {
    points_.push_back(points_.front());
  }
  double way = 0.0;
  for (size_t i = 0; i < points_.size(); ++i)
  {
    way += i == 0 ? 0.0 : std::hypot(points_[i].x - points_[i - 1].x, points_[i].y - points_[i - 1].y);
    starts_.push_back(way);
  }
  if (!(way > 0.0 && std::isfinite(way)))
  {
    throw std::invalid_argument("route: length " + std::to_string(way) + " m, must be positive: at least two points");
  }
}

size_t LoopRoute::segment(double* way) const
{
  *way = std::fmod(*way, length());
  const auto after = std::upper_bound(starts_.begin(), starts_.end(), *way);
  const auto index = static_cast<size_t>(after - starts_.begin());
  return std::clamp<size_t>(index, 1, points_.size() - 1) - 1;
}

Point LoopRoute::at(double way) const
{
  const size_t i = segment(&way);
  const double share = (way - starts_[i]) / (starts_[i + 1] - starts_[i]);
  return {points_[i].x + share * (points_[i + 1].x - points_[i].x),
          points_[i].y + share * (points_[i + 1].y - points_[i].y)};
}

double LoopRoute::heading(double way) const
{
  const size_t i = segment(&way);
  return std::atan2(points_[i + 1].x - points_[i].x, points_[i + 1].y - points_[i].y);
}

std::vector<Point> LoopRoute::ahead(double way) const
{
  const Point here = at(way);
  const size_t first = segment(&way) + 1;
  std::vector<Point> route{here};
  for (size_t i = 0; i + 1 < points_.size(); ++i)
  {
    route.push_back(points_[(first + i) % (points_.size() - 1)]);
  }
  route.push_back(here);
  return route;
}

}  // namespace pi_offload::simulation
