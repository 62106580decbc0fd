#include <pi_runtime/kernels/corner_grid.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pi_runtime::kernels
{
namespace
{

void require(bool valid, const char* field, double value, const char* bound)
{
  if (!valid)
  {
    throw std::invalid_argument("CornerGrid: " + std::string(field) + " = " + std::to_string(value) + ", must be " +
                                bound);
  }
}

/// The points in each cell of the grid.
class Cells
{
public:
  explicit Cells(const CornerGrid& grid)
    : grid_(grid)
    , columns_((grid.width + grid.cell - 1) / grid.cell)
    , rows_((grid.height + grid.cell - 1) / grid.cell)
    , reach_(static_cast<int>(std::ceil(grid.min_distance / static_cast<float>(grid.cell))))
    , points_(static_cast<size_t>(columns_) * static_cast<size_t>(rows_))
  {
  }

  size_t size() const { return points_.size(); }
  size_t indexOf(const Point2f& point) const
  {
    return static_cast<size_t>(place(point.y, rows_)) * static_cast<size_t>(columns_) +
           static_cast<size_t>(place(point.x, columns_));
  }
  void add(const Point2f& point) { points_[indexOf(point)].push_back(point); }
  bool full(const Point2f& point) const
  {
    return points_[indexOf(point)].size() >= static_cast<size_t>(grid_.per_cell);
  }

  /// True if a point lies nearer than min_distance.
  bool crowded(const Point2f& point) const
  {
    const int column = place(point.x, columns_);
    const int row = place(point.y, rows_);
    for (int y = std::max(row - reach_, 0); y <= std::min(row + reach_, rows_ - 1); ++y)
    {
      for (int x = std::max(column - reach_, 0); x <= std::min(column + reach_, columns_ - 1); ++x)
      {
        for (const Point2f& other : points_[static_cast<size_t>(y * columns_ + x)])
        {
          if (std::hypot(point.x - other.x, point.y - other.y) < grid_.min_distance)
          {
            return true;
          }
        }
      }
    }
    return false;
  }

private:
  int place(float coordinate, int places) const
  {
    const float limited = std::min(std::max(0.0f, coordinate), static_cast<float>(places * grid_.cell - 1));
    return static_cast<int>(limited) / grid_.cell;
  }

  const CornerGrid& grid_;
  const int columns_;
  const int rows_;
  const int reach_;  ///< cells to look at in each direction
  std::vector<std::vector<Point2f>> points_;
};

Point2f pointOf(const Corner& corner)
{
  return {static_cast<float>(corner.x), static_cast<float>(corner.y)};
}

void requireInside(const Corner* corners, size_t count, const CornerGrid& grid)
{
  for (size_t i = 0; i < count; ++i)
  {
    if (corners[i].x >= grid.width || corners[i].y >= grid.height)
    {
      throw std::invalid_argument("selectGridCorners: corner " + std::to_string(i) + " at (" +
                                  std::to_string(corners[i].x) + ", " + std::to_string(corners[i].y) +
                                  ") is outside of the image of " + std::to_string(grid.width) + " x " +
                                  std::to_string(grid.height));
    }
  }
}

/// Indices of the corners: the strongest of each cell, then the second strongest of each, ...
std::vector<size_t> orderByRank(const Corner* corners, size_t count, const Cells& cells)
{
  std::vector<size_t> order(count);
  for (size_t i = 0; i < count; ++i)
  {
    order[i] = i;
  }
  std::stable_sort(order.begin(), order.end(),
                   [corners](size_t a, size_t b) { return corners[a].score > corners[b].score; });
  std::vector<size_t> seen(cells.size(), 0);
  std::vector<size_t> rank(count);
  for (const size_t i : order)
  {
    rank[i] = seen[cells.indexOf(pointOf(corners[i]))]++;
  }
  std::stable_sort(order.begin(), order.end(), [&rank](size_t a, size_t b) { return rank[a] < rank[b]; });
  return order;
}

}  // namespace

void CornerGrid::validate() const
{
  require(width >= 1, "width", width, "at least 1");
  require(height >= 1, "height", height, "at least 1");
  require(cell >= 1, "cell", cell, "at least 1");
  require(per_cell >= 1, "per_cell", per_cell, "at least 1");
  require(min_distance >= 0.0f && std::isfinite(min_distance), "min_distance", min_distance, "at least 0");
}

std::vector<Corner> selectGridCorners(const Corner* corners, size_t count, const CornerGrid& grid,
                                      const std::vector<Point2f>& existing)
{
  grid.validate();
  requireInside(corners, count, grid);
  Cells cells(grid);
  for (const Point2f& point : existing)
  {
    cells.add(point);
  }
  std::vector<Corner> chosen;
  for (const size_t i : orderByRank(corners, count, cells))
  {
    if (chosen.size() + existing.size() >= grid.max_points)
    {
      break;
    }
    const Point2f point = pointOf(corners[i]);
    if (!cells.full(point) && !cells.crowded(point))
    {
      cells.add(point);
      chosen.push_back(corners[i]);
    }
  }
  return chosen;
}

}  // namespace pi_runtime::kernels
