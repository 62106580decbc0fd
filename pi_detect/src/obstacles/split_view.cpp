#include "obstacles/split_view.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "obstacles/matched_camera.h"

namespace pi_detect::obstacles
{

namespace
{

constexpr double LEAST_POCKET_M = 0.7;  // that is looked into
constexpr double POCKET_SIGMAS = 3.0;   // of the depth's error that does not average out, beyond that
constexpr double JOINED_M = 0.35;       // of depth between two columns: one surface
constexpr int LEAST_CELLS = 12;         // of a piece
constexpr int TALL = 4;                 // cells of a column, of which the nearest may be wrong

/// The nearest cells of a column, as the camera sees them.
struct Column
{
  int column = 0;
  int cells = 0;
  size_t nearest = 0;
  size_t second = 0;
  float nearest_range2 = std::numeric_limits<float>::max();  // squared
  float second_range2 = std::numeric_limits<float>::max();
  Eigen::Vector2d place = Eigen::Vector2d::Zero();
  double range = 0.0;
};

std::vector<Column> columnsOf(const std::vector<SurfacePoint>& part, const Eigen::Vector2d& camera)
{
  const auto [first, last] = std::minmax_element(
      part.begin(), part.end(), [](const SurfacePoint& a, const SurfacePoint& b) { return a.column < b.column; });
  const int from = first->column;
  std::vector<Column> columns(static_cast<size_t>(last->column - from) + 1);
  const Eigen::Vector2f origin = camera.cast<float>();
  for (size_t i = 0; i < part.size(); ++i)
  {
    Column& column = columns[static_cast<size_t>(part[i].column - from)];
    const float range2 = (part[i].position.head<2>() - origin).squaredNorm();
    ++column.cells;
    if (range2 < column.nearest_range2)
    {
      column.second = column.nearest;
      column.second_range2 = column.nearest_range2;
      column.nearest = i;
      column.nearest_range2 = range2;
    }
    else if (range2 < column.second_range2)
    {
      column.second = i;
      column.second_range2 = range2;
    }
  }
  for (size_t i = 0; i < columns.size(); ++i)
  {
    Column& column = columns[i];
    column.column = from + static_cast<int>(i);
    column.place = part[column.cells >= TALL ? column.second : column.nearest].position.head<2>().cast<double>();
    column.range = (column.place - camera).norm();
  }
  columns.erase(std::remove_if(columns.begin(), columns.end(), [](const Column& column) { return column.cells == 0; }),
                columns.end());
  return columns;
}

}  // namespace

std::optional<ViewSplit> splitView(const std::vector<SurfacePoint>& part, const OutlineScale& scale)
{
  const std::vector<Column> columns = columnsOf(part, scale.camera);
  std::vector<Eigen::Vector2d> places;
  places.reserve(columns.size());
  for (const Column& column : columns)
  {
    places.push_back(column.place);
  }
  const Outline hull = convexHull(std::move(places));
  if (hull.empty())
  {
    return std::nullopt;
  }
  // What lies left and right of a boundary has to be worth a piece.
  int before = 0;
  double deepest = 0.0;
  size_t at = columns.size();
  for (size_t i = 0; i < columns.size(); ++i)
  {
    const bool enough =
        before + columns[i].cells >= LEAST_CELLS && static_cast<int>(part.size()) - before >= LEAST_CELLS;
    before += columns[i].cells;
    if (!enough)
    {
      continue;
    }
    const double range = columns[i].range;
    const double error = POCKET_SIGMAS * DISPARITY_FLOOR_PX * range * range / scale.fb;
    const Eigen::Vector2d ray = (columns[i].place - scale.camera) / range;
    const double pocket = range - rayEntry(hull, scale.camera, ray) - LEAST_POCKET_M - error;
    if (std::isfinite(pocket) && pocket > deepest)
    {
      deepest = pocket;
      at = i;
    }
  }
  if (at == columns.size() || at == 0 || at + 1 == columns.size())
  {
    return std::nullopt;
  }
  // On the side on which the view comes out of the pocket.
  const bool right = columns[at + 1].range < columns[at - 1].range;
  const size_t boundary = right ? at + 1 : at;
  int left_cells = 0;
  for (size_t i = 0; i < boundary; ++i)
  {
    left_cells += columns[i].cells;
  }
  if (left_cells < LEAST_CELLS || static_cast<int>(part.size()) - left_cells < LEAST_CELLS)
  {
    return std::nullopt;
  }
  const double step = columns[boundary].range - columns[boundary - 1].range;
  ViewSplit split;
  split.column = columns[boundary].column;
  split.left_goes_on = step < JOINED_M;
  split.right_goes_on = -step < JOINED_M;
  return split;
}

}  // namespace pi_detect::obstacles
