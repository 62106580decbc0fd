#include "world/road_map.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation::synthetic
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
  lateral_.resize(static_cast<size_t>(width_) * static_cast<size_t>(height_), REACH_M);
  along_.resize(lateral_.size());
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
      const size_t cell = static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
      if (lateral < std::abs(lateral_[cell]))
      {
        lateral_[cell] = on_left ? lateral : -lateral;
        along_[cell] = along + s;
      }
    }
  }
}

RoadMap::Place RoadMap::at(float x, float y) const
{
  float xs[LANES] = {x};
  float ys[LANES] = {y};
  Places places;
  locate(xs, ys, 1, &places);
  return {places.lateral[0], places.along[0], places.dx[0], places.dy[0]};
}

PI_SIMULATION_VECTORISED void RoadMap::locate(const float* x, const float* y, int n, Places* __restrict places) const
{
  alignas(64) int index[LANES];
  alignas(64) float fx[LANES];
  alignas(64) float fy[LANES];
  alignas(64) float inside[LANES];
  const float ox = origin_.x();
  const float oy = origin_.y();
  const auto last_x = static_cast<float>(width_ - 1);
  const auto last_y = static_cast<float>(height_ - 1);
  for (int i = 0; i < n; ++i)
  {
    const float gx = (x[i] - ox) / CELL_M;
    const float gy = (y[i] - oy) / CELL_M;
    const bool in = (gx >= 0.0f) & (gy >= 0.0f) & (gx < last_x) & (gy < last_y);
    const float px = in ? gx : 0.0f;
    const float py = in ? gy : 0.0f;
    const int ix = static_cast<int>(px);
    const int iy = static_cast<int>(py);
    fx[i] = px - static_cast<float>(ix);
    fy[i] = py - static_cast<float>(iy);
    inside[i] = in ? 1.0f : 0.0f;
    index[i] = iy * width_ + ix;
  }
  Corners c = {};
  if (!lateral_.empty())
  {
    const float* lateral = lateral_.data();
    const float* along = along_.data();
    const int offsets[4] = {0, 1, width_, width_ + 1};
    for (int k = 0; k < 4; ++k)
    {
      for (int i = 0; i < n; ++i)
      {
        c.lateral[k][i] = lateral[index[i] + offsets[k]];
        c.along[k][i] = along[index[i] + offsets[k]];
      }
    }
  }
  for (int i = 0; i < n; ++i)
  {
    // Distances have a kink on the line itself, which only signed ones survive; far from it, where signs change
    // between two parts of a line, only plain ones do.
    const bool far = std::abs(c.lateral[0][i]) > 1.0f;
    const float c0 = far ? std::abs(c.lateral[0][i]) : c.lateral[0][i];
    const float c1 = far ? std::abs(c.lateral[1][i]) : c.lateral[1][i];
    const float c2 = far ? std::abs(c.lateral[2][i]) : c.lateral[2][i];
    const float c3 = far ? std::abs(c.lateral[3][i]) : c.lateral[3][i];
    const float top = mix(c0, c1, fx[i]);
    const float bottom = mix(c2, c3, fx[i]);
    const float lateral = std::abs(mix(top, bottom, fy[i]));
    const float dx = mix(c1 - c0, c3 - c2, fy[i]) / CELL_M;
    const float dy = (bottom - top) / CELL_M;
    // Where two parts of the line meet, positions along it jump and must not be mixed.
    const float a0 = c.along[0][i];
    const float a1 = c.along[1][i];
    const float a2 = c.along[2][i];
    const float a3 = c.along[3][i];
    const float near_top = fx[i] < 0.5f ? a0 : a1;
    const float near_bottom = fx[i] < 0.5f ? a2 : a3;
    const float nearest = fy[i] < 0.5f ? near_top : near_bottom;
    const bool smooth = (std::abs(a0 - nearest) < 2.0f) & (std::abs(a1 - nearest) < 2.0f) &
                        (std::abs(a2 - nearest) < 2.0f) & (std::abs(a3 - nearest) < 2.0f);
    const float mixed = mix(mix(a0, a1, fx[i]), mix(a2, a3, fx[i]), fy[i]);
    const float along = smooth ? mixed : nearest;
    const bool in = inside[i] > 0.0f;
    places->lateral[i] = in ? lateral : REACH_M;
    places->along[i] = in ? along : 0.0f;
    places->dx[i] = in ? dx : 0.0f;
    places->dy[i] = in ? dy : 0.0f;
  }
}

}  // namespace pi_simulation::synthetic
