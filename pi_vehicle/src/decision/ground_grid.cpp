#include "decision/ground_grid.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <utility>

namespace pi_vehicle
{
namespace
{

constexpr double STEP_M = 0.2;        // cells are joined to about this size, or stay as they are
constexpr float UNKNOWN_COST = 3.0F;  // of a way over unknown ground, by its length
constexpr double LEAST_LEG_M = 4.0;   // between two corners
constexpr double START_M = 1.5;       // around the start

/// Coarse cells: the cost of a way over them by its length; 0: too near to something.
struct CostMap
{
  int width = 0;
  int height = 0;
  double cell_m = 0.0;
  std::vector<float> cost;

  float& at(int x, int y) { return cost[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)]; }
  bool contains(int x, int y) const { return x >= 0 && y >= 0 && x < width && y < height; }
};

CostMap makeCosts(const GroundGrid& grid, const Eigen::Vector2d& start, double radius)
{
  const int join = std::max(1, static_cast<int>(std::lround(STEP_M / grid.cell_m)));
  CostMap map;
  map.width = (grid.width + join - 1) / join;
  map.height = (grid.height + join - 1) / join;
  map.cell_m = join * grid.cell_m;
  const auto cells = static_cast<size_t>(map.width) * static_cast<size_t>(map.height);
  map.cost.assign(cells, UNKNOWN_COST);
  std::vector<std::pair<int, int>> occupied;
  for (int y = 0; y < grid.height; ++y)
  {
    for (int x = 0; x < grid.width; ++x)
    {
      const int value =
          (*grid.cells)[static_cast<size_t>(y) * static_cast<size_t>(grid.width) + static_cast<size_t>(x)];
      const auto cell = std::make_pair(x / join, y / join);
      if (value >= GroundGrid::OCCUPIED && (occupied.empty() || occupied.back() != cell))
      {
        occupied.push_back(cell);
      }
      if (value >= 0)
      {
        map.at(cell.first, cell.second) = 1.0F;
      }
    }
  }
  const double reach = radius / map.cell_m;
  for (const auto& [x, y] : occupied)
  {
    for (int dy = static_cast<int>(-reach); dy <= reach; ++dy)
    {
      for (int dx = static_cast<int>(-reach); dx <= reach; ++dx)
      {
        const Eigen::Vector2d middle = map.cell_m * Eigen::Vector2d(x + dx + 0.5, y + dy + 0.5);
        if (std::hypot(dx, dy) <= reach && map.contains(x + dx, y + dy) && (middle - start).norm() >= START_M)
        {
          map.at(x + dx, y + dy) = 0.0F;
        }
      }
    }
  }
  return map;
}

/// Of the straight line; infinite if it leads too near to something.
double lineCost(CostMap* map, const Eigen::Vector2d& a, const Eigen::Vector2d& b)
{
  const double length = (b - a).norm();
  const int steps = std::max(1, static_cast<int>(std::ceil(2.0 * length / map->cell_m)));
  double cost = 0.0;
  for (int i = 0; i <= steps; ++i)
  {
    const Eigen::Vector2d p = (a + (b - a) * i / steps) / map->cell_m;
    const auto x = static_cast<int>(std::floor(p.x()));
    const auto y = static_cast<int>(std::floor(p.y()));
    if (!map->contains(x, y) || map->at(x, y) == 0.0F)
    {
      return std::numeric_limits<double>::infinity();
    }
    cost += static_cast<double>(map->at(x, y)) * length / (steps + 1);
  }
  return cost;
}

/// @return indices of cells from the start to the goal; empty: there is no way.
std::vector<int> searchCells(CostMap* map, int start, int goal)
{
  const auto heuristic = [map, goal](int cell)
  { return std::hypot(cell % map->width - goal % map->width, cell / map->width - goal / map->width); };
  std::vector<float> reached(map->cost.size(), std::numeric_limits<float>::infinity());
  std::vector<int> before(map->cost.size(), -1);
  using Open = std::pair<double, int>;
  std::priority_queue<Open, std::vector<Open>, std::greater<>> open;
  reached[static_cast<size_t>(start)] = 0.0F;
  open.push({heuristic(start), start});
  while (!open.empty())
  {
    const auto [estimate, cell] = open.top();
    open.pop();
    if (cell == goal)
    {
      break;
    }
    const float so_far = reached[static_cast<size_t>(cell)];
    if (estimate > static_cast<double>(so_far) + heuristic(cell) + 1e-3)
    {
      continue;  // a shorter way to it was found since
    }
    for (int dy = -1; dy <= 1; ++dy)
    {
      for (int dx = -1; dx <= 1; ++dx)
      {
        const int x = cell % map->width + dx;
        const int y = cell / map->width + dy;
        if ((dx == 0 && dy == 0) || !map->contains(x, y) || map->at(x, y) == 0.0F)
        {
          continue;
        }
        const auto next = static_cast<size_t>(y) * static_cast<size_t>(map->width) + static_cast<size_t>(x);
        const float cost = so_far + map->at(x, y) * (dx != 0 && dy != 0 ? 1.41421F : 1.0F);
        if (cost < reached[next] - 1e-4F)
        {
          reached[next] = cost;
          before[next] = cell;
          open.push({static_cast<double>(cost) + heuristic(static_cast<int>(next)), static_cast<int>(next)});
        }
      }
    }
  }
  std::vector<int> cells;
  if (std::isfinite(reached[static_cast<size_t>(goal)]))
  {
    for (int cell = goal; cell >= 0; cell = before[static_cast<size_t>(cell)])
    {
      cells.push_back(cell);
    }
    std::reverse(cells.begin(), cells.end());
  }
  return cells;
}

/// Two corners that are too near to each other to be driven become one, where their outer legs meet, if it is free.
void joinCorners(CostMap* map, std::vector<Eigen::Vector2d>* points)
{
  for (size_t i = 1; i + 2 < points->size();)
  {
    const Eigen::Vector2d before = (*points)[i - 1];
    const Eigen::Vector2d first = (*points)[i];
    const Eigen::Vector2d second = (*points)[i + 1];
    const Eigen::Vector2d after = (*points)[i + 2];
    Eigen::Matrix2d legs;
    legs << first - before, second - after;
    const double length = (second - first).norm();
    if (length < LEAST_LEG_M && std::abs(legs.determinant()) > 1e-6)
    {
      const Eigen::Vector2d meet = before + (first - before) * legs.inverse().row(0).dot(after - before);
      if ((meet - first).norm() < 2.0 * LEAST_LEG_M && std::isfinite(lineCost(map, before, meet)) &&
          std::isfinite(lineCost(map, meet, after)))
      {
        (*points)[i] = meet;
        points->erase(points->begin() + static_cast<ptrdiff_t>(i) + 1);
        continue;
      }
    }
    ++i;
  }
}

}  // namespace

std::optional<std::vector<Eigen::Vector2d>> findWay(const GroundGrid& grid, const Eigen::Vector2d& from,
                                                    const Eigen::Vector2d& to, double radius)
{
  const Pose2 T_grid_map = grid.T_map_grid.inverse();
  const Eigen::Vector2d start = T_grid_map * from;
  const Eigen::Vector2d goal = T_grid_map * to;
  CostMap map = makeCosts(grid, start, radius);
  const auto cellOf = [&map](const Eigen::Vector2d& p)
  {
    const auto x = static_cast<int>(std::floor(p.x() / map.cell_m));
    const auto y = static_cast<int>(std::floor(p.y() / map.cell_m));
    return map.contains(x, y) && map.at(x, y) > 0.0F ? y * map.width + x : -1;
  };
  const int first = cellOf(start);
  const int last = cellOf(goal);
  if (first < 0 || last < 0)
  {
    return std::nullopt;
  }
  const std::vector<int> cells = searchCells(&map, first, last);
  if (cells.empty())
  {
    return std::nullopt;
  }
  std::vector<Eigen::Vector2d> points{start};
  std::vector<double> way{0.0};  // its cost up to each point
  for (const int cell : cells)
  {
    points.push_back(map.cell_m * Eigen::Vector2d(cell % map.width + 0.5, cell / map.width + 0.5));
  }
  points.push_back(goal);
  for (size_t i = 1; i < points.size(); ++i)
  {
    way.push_back(way.back() + lineCost(&map, points[i - 1], points[i]));
  }
  // From each corner to the farthest point that a straight line reaches at no higher cost.
  std::vector<Eigen::Vector2d> corners{start};
  for (size_t at = 0; at + 1 < points.size();)
  {
    size_t next = points.size() - 1;
    while (next > at + 1 && lineCost(&map, points[at], points[next]) > way[next] - way[at] + 1e-6)
    {
      --next;
    }
    corners.push_back(points[next]);
    at = next;
  }
  joinCorners(&map, &corners);
  corners.erase(corners.begin());
  for (Eigen::Vector2d& corner : corners)
  {
    corner = grid.T_map_grid * corner;
  }
  return corners;
}

}  // namespace pi_vehicle
