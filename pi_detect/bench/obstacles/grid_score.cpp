#include "grid_score.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

namespace pi_detect::bench
{

namespace
{

constexpr double SIDE_M = 0.1;
constexpr double PASSED_M = 10.0;
constexpr double SLOW_M_S = 0.1;
constexpr double TOP_M =
    1.8;  // of what is in the way: the vehicle is 1.6 m high; crowns of trees hang above free ground
constexpr int WITHIN_CELLS = 2;
constexpr int OCCUPIED_PERCENT = 65;
constexpr int FREE_PERCENT = 35;

OccupancyGridOptions wholeDrive()
{
  OccupancyGridOptions options;
  options.cell_m = SIDE_M;
  options.size_m = 2000 * SIDE_M;
  options.memory_s = 3600.0;
  return options;
}

double threadMs()
{
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_nsec) * 1e-6;
}

}  // namespace

GridScore::GridScore() : grid_(wholeDrive()) {}

GridScore::Cell GridScore::cellOf(const Eigen::Vector2d& p) const
{
  return {static_cast<int>(std::floor(p.x() / SIDE_M)), static_cast<int>(std::floor(p.y() / SIDE_M))};
}

void GridScore::add(int64_t stamp_ns, const Eigen::Isometry3d& T_world_base, const StereoObstacles::Result& result,
                    const std::vector<Obstacle>& obstacles, const TruthCloud& truth)
{
  std::vector<Outline> left_out;
  for (const Obstacle& obstacle : obstacles)
  {
    if (obstacle.moving && !obstacle.outline.empty())
    {
      left_out.push_back(obstacle.outline);
    }
  }
  const double start = threadMs();
  grid_.add(stamp_ns, T_world_base, result.view, left_out, {});
  ms_.push_back(threadMs() - start);
  std::set<Cell> moves;
  for (const TruthCloud::Seen& seen : truth.objects())
  {
    for (const Eigen::Vector3d& p : seen.points)
    {
      if (seen.velocity_base.norm() > SLOW_M_S)
      {
        moves.insert(cellOf((T_world_base * p).head<2>()));
      }
    }
  }
  for (const Eigen::Vector3d& p : truth.raised())
  {
    const Cell cell = cellOf((T_world_base * p).head<2>());
    if (isNear(moves, cell))
    {
      continue;
    }
    raised_.insert(cell);
    const double height = (T_world_base * p).z();
    if (p.head<2>().norm() <= PASSED_M && height > StereoObstacleOptions().min_height_m && height < TOP_M)
    {
      passed_.insert(cell);
    }
  }
  moving_.insert(moves.begin(), moves.end());
}

bool GridScore::isNear(const std::set<Cell>& cells, const Cell& cell)
{
  for (int dy = -WITHIN_CELLS; dy <= WITHIN_CELLS; ++dy)
  {
    for (int dx = -WITHIN_CELLS; dx <= WITHIN_CELLS; ++dx)
    {
      if (cells.count({cell.first + dx, cell.second + dy}) != 0)
      {
        return true;
      }
    }
  }
  return false;
}

std::set<GridScore::Cell> GridScore::occupied() const
{
  std::set<Cell> cells;
  const std::vector<int8_t> values = grid_.cells();
  const Cell low = cellOf(grid_.origin() + Eigen::Vector2d::Constant(0.5 * SIDE_M));
  for (int i = 0; i < static_cast<int>(values.size()); ++i)
  {
    if (values[static_cast<size_t>(i)] >= OCCUPIED_PERCENT)
    {
      cells.insert({low.first + i % grid_.side(), low.second + i / grid_.side()});
    }
  }
  return cells;
}

void GridScore::print() const
{
  const std::set<Cell> found = occupied();
  const auto part = [](const std::set<Cell>& of, const std::set<Cell>& near)
  {
    const auto count = std::count_if(of.begin(), of.end(), [&near](const Cell& cell) { return isNear(near, cell); });
    return 100.0 * static_cast<double>(count) / static_cast<double>(std::max<size_t>(1, of.size()));
  };
  const std::vector<int8_t> values = grid_.cells();
  const Cell low = cellOf(grid_.origin() + Eigen::Vector2d::Constant(0.5 * SIDE_M));
  size_t free = 0;
  size_t wrong = 0;
  for (int i = 0; i < static_cast<int>(values.size()); ++i)
  {
    if (values[static_cast<size_t>(i)] >= 0 && values[static_cast<size_t>(i)] <= FREE_PERCENT)
    {
      ++free;
      wrong += passed_.count({low.first + i % grid_.side(), low.second + i / grid_.side()});
    }
  }
  std::printf("  grid: %.0f m^2 free, of which %.2f %% hold something that stands\n",
              static_cast<double>(free) * SIDE_M * SIDE_M,
              100.0 * static_cast<double>(wrong) / static_cast<double>(std::max<size_t>(1, free)));
  std::vector<double> ms = ms_;
  std::sort(ms.begin(), ms.end());
  std::printf(
      "  grid: %zu occupied cells, %.1f %% within 0.2 m of something true (%.1f %% of where something moved); of %zu "
      "true cells within %.0f m %.1f %% present; median %.2f ms per view\n",
      found.size(), part(found, raised_), part(moving_, found), passed_.size(), PASSED_M, part(passed_, found),
      ms.empty() ? 0.0 : ms[ms.size() / 2]);
}

void GridScore::draw(const std::string& file) const
{
  if (file.empty())
  {
    return;
  }
  const std::vector<int8_t> values = grid_.cells();
  const std::set<Cell> found = occupied();
  const Cell low = cellOf(grid_.origin() + Eigen::Vector2d::Constant(0.5 * SIDE_M));
  cv::Mat picture(grid_.side(), grid_.side(), CV_8UC3, cv::Scalar::all(128));
  const auto paint = [&](int x, int y, const cv::Vec3b& color)
  {
    if (x >= 0 && y >= 0 && x < picture.cols && y < picture.rows)
    {
      picture.at<cv::Vec3b>(picture.rows - 1 - y, x) = color;
    }
  };
  int left = picture.cols, right = 0, lower = picture.rows, upper = 0;
  for (int i = 0; i < static_cast<int>(values.size()); ++i)
  {
    const int value = values[static_cast<size_t>(i)];
    const int x = i % grid_.side();
    const int y = i / grid_.side();
    if (value >= 0)
    {
      const auto grey = static_cast<uint8_t>(255 - 255 * value / 100);
      paint(x, y, {grey, grey, grey});
      left = std::min(left, x);
      right = std::max(right, x);
      lower = std::min(lower, y);
      upper = std::max(upper, y);
    }
  }
  for (const Cell& cell : passed_)
  {
    if (!isNear(found, cell))
    {
      paint(cell.first - low.first, cell.second - low.second, {0, 0, 255});
    }
  }
  if (right <= left ||
      !cv::imwrite(file, picture(cv::Rect(left, picture.rows - 1 - upper, right - left + 1, upper - lower + 1))))
  {
    throw std::runtime_error(file + ": cannot be written");
  }
}

}  // namespace pi_detect::bench
