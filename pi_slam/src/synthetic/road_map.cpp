#include "road_map.h"

#include <algorithm>
#include <cmath>

#include "texture.h"

namespace pi_slam::synthetic
{

RoadMap::RoadMap(const std::vector<Eigen::Vector2d>& line)
{
  Eigen::Vector2f low = line.front().cast<float>();
  Eigen::Vector2f high = low;
  for (const Eigen::Vector2d& point : line)
  {
    low = low.cwiseMin(point.cast<float>());
    high = high.cwiseMax(point.cast<float>());
  }
  origin_ = low.array() - (REACH_M + 2.0f * CELL_M);
  width_ = static_cast<int>((high.x() + REACH_M - origin_.x()) / CELL_M) + 3;
  height_ = static_cast<int>((high.y() + REACH_M - origin_.y()) / CELL_M) + 3;
  cells_.resize(static_cast<size_t>(width_) * static_cast<size_t>(height_));
  float along = 0.0f;
  for (size_t i = 1; i < line.size(); ++i)
  {
    const Eigen::Vector2f a = line[i - 1].cast<float>();
    const Eigen::Vector2f b = line[i].cast<float>();
    splat(a, b, along);
    along += (b - a).norm();
  }
}

/// Enters a piece of the line into the cells to which it is nearest so far.
void RoadMap::splat(const Eigen::Vector2f& a, const Eigen::Vector2f& b, float along)
{
  const float length = (b - a).norm();
  if (length < 1e-6f)
  {
    return;
  }
  const Eigen::Vector2f tangent = (b - a) / length;
  const Eigen::Vector2f low = (a.cwiseMin(b) - origin_).array() / CELL_M - REACH_M / CELL_M;
  const Eigen::Vector2f high = (a.cwiseMax(b) - origin_).array() / CELL_M + REACH_M / CELL_M;
  for (int y = std::max(0, static_cast<int>(low.y())); y <= std::min(height_ - 1, static_cast<int>(high.y())); ++y)
  {
    for (int x = std::max(0, static_cast<int>(low.x())); x <= std::min(width_ - 1, static_cast<int>(high.x())); ++x)
    {
      const Eigen::Vector2f point = origin_ + CELL_M * Eigen::Vector2f(static_cast<float>(x), static_cast<float>(y));
      const float s = std::clamp((point - a).dot(tangent), 0.0f, length);
      const float lateral = (point - a - s * tangent).norm();
      const bool on_left = tangent.x() * (point - a).y() > tangent.y() * (point - a).x();
      Cell& cell = cells_[static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x)];
      if (lateral < std::abs(cell.lateral))
      {
        cell = {on_left ? lateral : -lateral, along + s};
      }
    }
  }
}

RoadMap::Place RoadMap::at(float x, float y) const
{
  const float gx = (x - origin_.x()) / CELL_M;
  const float gy = (y - origin_.y()) / CELL_M;
  if (!(gx >= 0.0f && gy >= 0.0f && gx < static_cast<float>(width_ - 1) && gy < static_cast<float>(height_ - 1)))
  {
    return {};
  }
  const int ix = static_cast<int>(gx);
  const int iy = static_cast<int>(gy);
  const float fx = gx - static_cast<float>(ix);
  const float fy = gy - static_cast<float>(iy);
  const Cell* row = &cells_[static_cast<size_t>(iy) * static_cast<size_t>(width_) + static_cast<size_t>(ix)];
  const Cell* next = row + width_;
  // Distances have a kink on the line itself, which only signed ones survive; far from it, where signs change between
  // two parts of a line, only plain ones do.
  float corners[4] = {row[0].lateral, row[1].lateral, next[0].lateral, next[1].lateral};
  if (std::abs(corners[0]) > 1.0f)
  {
    for (float& corner : corners)
    {
      corner = std::abs(corner);
    }
  }
  const float top = mix(corners[0], corners[1], fx);
  const float bottom = mix(corners[2], corners[3], fx);
  Place place;
  place.lateral = std::abs(mix(top, bottom, fy));
  place.dx = mix(corners[1] - corners[0], corners[3] - corners[2], fy) / CELL_M;
  place.dy = (bottom - top) / CELL_M;
  // Where two parts of the line meet, positions along it jump and must not be mixed.
  const Cell& nearest = (fy < 0.5f ? row : next)[fx < 0.5f ? 0 : 1];
  const auto mixable = [&](const Cell& other) { return std::abs(other.along - nearest.along) < 2.0f; };
  const bool smooth = mixable(row[0]) && mixable(row[1]) && mixable(next[0]) && mixable(next[1]);
  place.along = nearest.along;
  if (smooth)
  {
    place.along = mix(mix(row[0].along, row[1].along, fx), mix(next[0].along, next[1].along, fx), fy);
  }
  return place;
}

}  // namespace pi_slam::synthetic
