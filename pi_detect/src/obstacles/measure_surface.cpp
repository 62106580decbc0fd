#include "obstacles/measure_surface.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "obstacles/split_view.h"

namespace pi_detect::obstacles
{

namespace
{

constexpr double LARGE_M = 1.5;        // larger things may hold ground that is free
constexpr double LONG_M = 4.0;         // longer things are looked at: a box around a bent wall covers what is free
constexpr double THIN_M = 1.5;         // a box that is this thin covers little
constexpr double TILE_M = 0.5;         // to see how full a box is
constexpr double MIN_FULL = 0.4;       // part of its tiles
constexpr size_t MIN_CELLS = 6;        // of an obstacle
constexpr double MIN_COVERED = 0.5;    // part of a square of min_size_m that must be seen, at least
constexpr double OUTSIDE_PART = 0.02;  // of the points that may be outside of the box, at each side
constexpr double NEAREST_FROM = 0.02;  // part of the points, by distance: those before may be wrong
constexpr double NEAREST_TO = 0.10;
constexpr size_t MOST_BEFORE = 12;  // likewise in cells: of a long wall, 2 % may be metres
constexpr size_t MOST_NEAREST = 24;

struct Range
{
  double low;
  double high;
  double size() const { return high - low; }
};

/// What remains of the points' coordinates without the outermost.
Range rangeOf(const std::vector<SurfacePoint>& part, int axis, double outside)
{
  std::vector<float> values;
  values.reserve(part.size());
  for (const SurfacePoint& point : part)
  {
    values.push_back(point.position(axis));
  }
  const auto drop = static_cast<ptrdiff_t>(outside * static_cast<double>(values.size()));
  std::nth_element(values.begin(), values.begin() + drop, values.end());
  const double low = values[drop];
  std::nth_element(values.begin(), values.end() - 1 - drop, values.end());
  return {low, *(values.end() - 1 - drop)};
}

/// Part of the box's tiles on the ground that have a point.
double fullness(const std::vector<SurfacePoint>& part, const Range& x, const Range& y)
{
  std::set<std::pair<int, int>> tiles;
  for (const SurfacePoint& point : part)
  {
    tiles.emplace(static_cast<int>(std::floor((point.position.x() - x.low) / TILE_M)),
                  static_cast<int>(std::floor((point.position.y() - y.low) / TILE_M)));
  }
  return static_cast<double>(tiles.size()) / (std::ceil(x.size() / TILE_M) * std::ceil(y.size() / TILE_M));
}

}  // namespace

SurfaceMeter::SurfaceMeter(const MatchedCamera& camera, const StereoGeometry& geometry,
                           const Eigen::Isometry3d& T_base_left, const StereoObstacleOptions& options)
  : camera_(camera), geometry_(geometry), T_base_left_(T_base_left), options_(options)
{
  outline_scale_.camera = T_base_left.translation().head<2>();
  outline_scale_.cell_rad = SurfaceFinder::CELL_PX / camera.fx;
  outline_scale_.fb = camera.fb;
}

void SurfaceMeter::add(const Surface& surface, std::vector<ObstacleMeasurement>* obstacles,
                       std::vector<Eigen::Vector3f>* points) const
{
  std::vector<SurfacePoint> part;
  part.reserve(surface.cells.size());
  const Eigen::Matrix3d R = T_base_left_.linear();
  constexpr double MIDDLE = 0.5 * (SurfaceFinder::CELL_PX - 1);
  for (const Cell& cell : surface.cells)
  {
    const Eigen::Vector3d ray =
        camera_.ray(cell.column * SurfaceFinder::CELL_PX + MIDDLE, cell.row * SurfaceFinder::CELL_PX + MIDDLE);
    const Eigen::Vector3d p = R * (camera_.fb / cell.disparity * ray) + T_base_left_.translation();
    if (p.head<2>().norm() <= options_.max_range_m)
    {
      part.push_back({p.cast<float>(), cell.column, cell.row, cell.pixels});
    }
  }
  split(std::move(part), surface.cut_left, surface.cut_right, false, obstacles, points);
}

void SurfaceMeter::split(std::vector<SurfacePoint> part, bool cut_left, bool cut_right, bool piece,
                         std::vector<ObstacleMeasurement>* obstacles, std::vector<Eigen::Vector3f>* points) const
{
  if (part.size() < MIN_CELLS)
  {
    return;
  }
  const Range x = rangeOf(part, 0, OUTSIDE_PART);
  const Range y = rangeOf(part, 1, OUTSIDE_PART);
  if (std::max(x.size(), y.size()) > LARGE_M)
  {
    if (const std::optional<ViewSplit> at = splitView(part, outline_scale_))
    {
      const auto right = std::partition(part.begin(), part.end(),
                                        [&at](const SurfacePoint& point) { return point.column < at->column; });
      const std::vector<SurfacePoint> rest(right, part.end());
      part.erase(right, part.end());
      split(std::move(part), cut_left, cut_right || at->left_goes_on, true, obstacles, points);
      split(rest, cut_left || at->right_goes_on, cut_right, true, obstacles, points);
      return;
    }
  }
  const bool along_x = x.size() > y.size();
  if (std::max(x.size(), y.size()) > LONG_M && std::min(x.size(), y.size()) > THIN_M && fullness(part, x, y) < MIN_FULL)
  {
    const int axis = along_x ? 0 : 1;
    const auto middle = static_cast<float>(along_x ? 0.5 * (x.low + x.high) : 0.5 * (y.low + y.high));
    const auto upper = std::partition(part.begin(), part.end(),
                                      [&](const SurfacePoint& point) { return point.position(axis) < middle; });
    const std::vector<SurfacePoint> rest(upper, part.end());
    part.erase(upper, part.end());
    // Ends are cut in y: each piece continues in the other one, in whatever direction the wall runs.
    split(std::move(part), true, true, piece, obstacles, points);
    split(rest, true, true, piece, obstacles, points);
    return;
  }
  ObstacleMeasurement obstacle;
  if (!measure(part, &obstacle))
  {
    return;
  }
  obstacle.cut_left = cut_left;
  obstacle.cut_right = cut_right;
  obstacle.piece = piece;
  obstacle.outline = measureOutline(part, outline_scale_);
  obstacles->push_back(std::move(obstacle));
  for (const SurfacePoint& point : part)
  {
    points->push_back(point.position);
  }
}

bool SurfaceMeter::measure(const std::vector<SurfacePoint>& part, ObstacleMeasurement* obstacle) const
{
  int left = 1 << 30;
  int top = 1 << 30;
  int right = -1;
  int bottom = -1;
  for (const SurfacePoint& point : part)
  {
    left = std::min(left, point.column);
    right = std::max(right, point.column);
    top = std::min(top, point.row);
    bottom = std::max(bottom, point.row);
    obstacle->points += point.pixels;
  }
  for (int axis = 0; axis < 3; ++axis)
  {
    const Range range = rangeOf(part, axis, OUTSIDE_PART);
    obstacle->min(axis) = range.low;
    obstacle->max(axis) = range.high;
  }
  measureNearest(part, obstacle);

  const double depth_m = (T_base_left_.inverse() * obstacle->nearest).z();
  const double cell_m = SurfaceFinder::CELL_PX * depth_m / camera_.fx;
  // Cells reach half their size beyond their middle.
  for (const int axis : {1, 2})
  {
    obstacle->min(axis) -= 0.5 * cell_m;
    obstacle->max(axis) += 0.5 * cell_m;
  }
  const Eigen::Vector3d size = obstacle->max - obstacle->min;
  const double covered_m2 = obstacle->points * std::pow(depth_m / camera_.fx, 2);
  if (std::max(size.y(), size.z()) < options_.min_size_m ||
      covered_m2 < MIN_COVERED * options_.min_size_m * options_.min_size_m)
  {
    return false;
  }
  const auto scale_x = static_cast<float>(geometry_.width) / static_cast<float>(camera_.width);
  const auto scale_y = static_cast<float>(geometry_.height) / static_cast<float>(camera_.height);
  const auto pixels = [](int cells) { return static_cast<float>(SurfaceFinder::CELL_PX * cells); };
  obstacle->box.x1 = pixels(left) * scale_x;
  obstacle->box.y1 = pixels(top) * scale_y;
  obstacle->box.x2 = std::min(pixels(right + 1) * scale_x, static_cast<float>(geometry_.width));
  obstacle->box.y2 = std::min(pixels(bottom + 1) * scale_y, static_cast<float>(geometry_.height));
  return true;
}

void SurfaceMeter::measureNearest(const std::vector<SurfacePoint>& part, ObstacleMeasurement* obstacle) const
{
  std::vector<std::pair<float, size_t>> distances;
  distances.reserve(part.size());
  for (size_t i = 0; i < part.size(); ++i)
  {
    distances.emplace_back(part[i].position.head<2>().norm(), i);
  }
  std::sort(distances.begin(), distances.end());
  const auto n = static_cast<double>(distances.size());
  const size_t from = std::min(MOST_BEFORE, static_cast<size_t>(NEAREST_FROM * n));
  const size_t wanted = std::clamp<size_t>(static_cast<size_t>((NEAREST_TO - NEAREST_FROM) * n), 3, MOST_NEAREST);
  const size_t to = std::min(distances.size(), from + wanted);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (size_t i = from; i < to; ++i)
  {
    sum += part[distances[i].second].position.cast<double>();
  }
  obstacle->nearest = sum / static_cast<double>(to - from);

  const Eigen::Vector3d p_left = T_base_left_.inverse() * obstacle->nearest;
  const double z = p_left.z();
  const double disparity_sigma =
      std::hypot(DISPARITY_FLOOR_PX, DISPARITY_SIGMA_PX / std::sqrt(0.25 * static_cast<double>(to - from)));
  const double depth_sigma = z * z / camera_.fb * disparity_sigma;
  const double side_sigma = SurfaceFinder::CELL_PX / std::sqrt(12.0) * z / camera_.fx;  // anywhere in a cell
  const Eigen::Vector3d along = T_base_left_.linear() * p_left.normalized();
  obstacle->covariance =
      side_sigma * side_sigma * Eigen::Matrix3d::Identity() + depth_sigma * depth_sigma * along * along.transpose();
}

}  // namespace pi_detect::obstacles
