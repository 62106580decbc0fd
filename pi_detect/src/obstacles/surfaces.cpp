#include "obstacles/surfaces.h"

#include <algorithm>
#include <cmath>

namespace pi_detect::obstacles
{

namespace
{

constexpr int MIN_PIXELS_OF_CELL = 6;    // of 16
constexpr double GROUND_SIGMAS = 3.0;    // by which something must be nearer than the ground behind it
constexpr double SURFACE_STEP_PX = 0.5;  // between neighbouring cells of one surface: noise
constexpr double SURFACE_STEP_M = 0.35;  // likewise: slant and shape
constexpr int REACH = 2;                 // of connections [cells]
constexpr int SMOOTHINGS = 2;

}  // namespace

SurfaceFinder::SurfaceFinder(const MatchedCamera& camera, const StereoObstacleOptions& options)
  : camera_(camera)
  , options_(options)
  , columns_((camera.width + CELL_PX - 1) / CELL_PX)
  , rows_((camera.height + CELL_PX - 1) / CELL_PX)
  , disparity_(static_cast<size_t>(columns_) * rows_)
  , pixels_(disparity_.size())
  , surface_of_(disparity_.size())
{
}

// A point with disparity d at a pixel where the ground has the disparity g is H (1 - g / d) above it, H being the
// camera's height: with d > 0, bounds for the height are linear in d.
void SurfaceFinder::markCells(const cv::Mat& disparity, const DisparityPlane& ground, double max_depth_m)
{
  const auto H = static_cast<float>(ground.camera_height_m);
  const float below_min = H - static_cast<float>(options_.min_height_m);
  const float below_max = H - static_cast<float>(options_.max_height_m);
  const auto clear = static_cast<float>(GROUND_SIGMAS * std::hypot(DISPARITY_SIGMA_PX, ground.sigma_px));
  const auto least = static_cast<float>(camera_.fb / max_depth_m);
  for (int row = 0; row < rows_; ++row)
  {
    const int v_end = std::min(camera_.height, (row + 1) * CELL_PX);
    for (int column = 0; column < columns_; ++column)
    {
      const int u_end = std::min(camera_.width, (column + 1) * CELL_PX);
      float nearest = 0.0F;
      float values[CELL_PX * CELL_PX];
      int count = 0;
      for (int v = row * CELL_PX; v < v_end; ++v)
      {
        const auto* from = disparity.ptr<float>(v);
        const auto g_row = static_cast<float>(ground.b * v + ground.c);
        for (int u = column * CELL_PX; u < u_end; ++u)
        {
          const float d = from[u];
          const float g = g_row + static_cast<float>(ground.a) * static_cast<float>(u);
          if (d > least && d > g + clear && d * below_min > H * g && d * below_max < H * g)
          {
            values[count++] = d;
            nearest = std::max(nearest, d);
          }
        }
      }
      float sum = 0.0F;
      int kept = 0;
      const float width = 1.0F + 0.05F * nearest;
      for (int i = 0; i < count; ++i)
      {
        if (values[i] > nearest - width)
        {
          sum += values[i];
          ++kept;
        }
      }
      const size_t index = static_cast<size_t>(row) * columns_ + column;
      disparity_[index] = kept >= MIN_PIXELS_OF_CELL ? sum / static_cast<float>(kept) : 0.0F;
      pixels_[index] = static_cast<uint8_t>(kept);
    }
  }
}

void SurfaceFinder::connect()
{
  surfaces_.clear();
  std::fill(surface_of_.begin(), surface_of_.end(), -1);
  const auto step_part = static_cast<float>(SURFACE_STEP_M / camera_.fb);
  for (int start = 0; start < static_cast<int>(disparity_.size()); ++start)
  {
    if (disparity_[start] <= 0.0F || surface_of_[start] >= 0)
    {
      continue;
    }
    const int id = static_cast<int>(surfaces_.size());
    surfaces_.emplace_back();
    surface_of_[start] = id;
    queue_.assign(1, start);
    for (size_t next = 0; next < queue_.size(); ++next)
    {
      const int index = queue_[next];
      const int column = index % columns_;
      const int row = index / columns_;
      const float d = disparity_[index];
      surfaces_.back().cells.push_back({column, row, d, pixels_[index]});
      // A step in depth is one in disparity of d^2 / fb.
      const float limit = std::max(static_cast<float>(SURFACE_STEP_PX), step_part * d * d);
      for (int r = std::max(0, row - REACH); r <= std::min(rows_ - 1, row + REACH); ++r)
      {
        for (int c = std::max(0, column - REACH); c <= std::min(columns_ - 1, column + REACH); ++c)
        {
          const int other = r * columns_ + c;
          if (surface_of_[other] < 0 && disparity_[other] > 0.0F && std::abs(disparity_[other] - d) < limit)
          {
            surface_of_[other] = id;
            queue_.push_back(other);
          }
        }
      }
    }
  }
}

/// Means over neighbours of the same surface.
void SurfaceFinder::smooth(Surface* surface)
{
  const int id = surface_of_[surface->cells.front().row * columns_ + surface->cells.front().column];
  for (int round = 0; round < SMOOTHINGS; ++round)
  {
    for (Cell& cell : surface->cells)
    {
      float sum = 0.0F;
      int count = 0;
      const float d = disparity_[cell.row * columns_ + cell.column];
      for (int r = std::max(0, cell.row - 1); r <= std::min(rows_ - 1, cell.row + 1); ++r)
      {
        for (int c = std::max(0, cell.column - 1); c <= std::min(columns_ - 1, cell.column + 1); ++c)
        {
          const int other = r * columns_ + c;
          if (surface_of_[other] == id && std::abs(disparity_[other] - d) < static_cast<float>(SURFACE_STEP_PX))
          {
            sum += disparity_[other];
            ++count;
          }
        }
      }
      cell.disparity = sum / static_cast<float>(count);
    }
    for (const Cell& cell : surface->cells)
    {
      disparity_[cell.row * columns_ + cell.column] = cell.disparity;
    }
  }
}

void SurfaceFinder::findCuts(Surface* surface) const
{
  int first = columns_;
  int last = -1;
  for (const Cell& cell : surface->cells)
  {
    first = std::min(first, cell.column);
    last = std::max(last, cell.column);
  }
  const auto isCut = [&](int end, int outward)
  {
    int cells = 0;
    int hidden = 0;
    for (const Cell& cell : surface->cells)
    {
      if (cell.column != end)
      {
        continue;
      }
      ++cells;
      bool nearer = false;
      for (int i = 1; i <= REACH + 1; ++i)
      {
        const int c = end + i * outward;
        // The left margin of the left picture has no partner in the right one.
        const bool outside = c < static_cast<int>(cell.disparity) / CELL_PX + 1 || c >= columns_ - 1;
        nearer = nearer || outside || disparity_[cell.row * columns_ + c] > cell.disparity + SURFACE_STEP_PX;
      }
      hidden += nearer ? 1 : 0;
    }
    return 2 * hidden > cells;
  };
  surface->cut_left = isCut(first, -1);
  surface->cut_right = isCut(last, 1);
}

const std::vector<Surface>& SurfaceFinder::find(const cv::Mat& disparity, const DisparityPlane& ground,
                                                double max_depth_m)
{
  markCells(disparity, ground, max_depth_m);
  connect();
  for (Surface& surface : surfaces_)
  {
    findCuts(&surface);
    smooth(&surface);
  }
  return surfaces_;
}

}  // namespace pi_detect::obstacles
