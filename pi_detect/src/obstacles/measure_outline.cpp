#include "obstacles/measure_outline.h"

#include <algorithm>
#include <cmath>

#include "obstacles/matched_camera.h"

namespace pi_detect::obstacles
{

namespace
{

constexpr size_t FEW = 12;              // of so few points none is left out
constexpr size_t COMPANY = 4;           // points near to one that counts
constexpr double COMPANY_M = 0.12;      // so near, ...
constexpr double COMPANY_CELLS = 2.0;   // and by so many cells, ...
constexpr double COMPANY_SIGMAS = 0.5;  // and by a disparity's noise
constexpr double MOST_ALONE = 0.05;     // part of the points that may be left out
constexpr double MOST_THICKER_M = 0.15;
constexpr double LEAST_HALF_M = 0.05;

/// Points by column, and of each column those that count.
class Columns
{
public:
  Columns(const std::vector<SurfacePoint>& part, const Eigen::Vector2d& camera)
    : part_(part), camera_(camera.cast<float>())
  {
    const auto [first, last] = std::minmax_element(
        part.begin(), part.end(), [](const SurfacePoint& a, const SurfacePoint& b) { return a.column < b.column; });
    first_ = first->column;
    extremes_.resize(static_cast<size_t>(last->column - first_) + 1);
    alone_.assign(part.size(), false);
    for (size_t i = 0; i < part.size(); ++i)
    {
      put(i);
    }
  }

  /// The nearest and the farthest of each column: all that the hull may go through.
  std::vector<size_t> candidates() const
  {
    std::vector<size_t> found;
    for (const Extremes& column : extremes_)
    {
      if (column.nearest != NONE)
      {
        found.push_back(column.nearest);
      }
      if (column.farthest != NONE && column.farthest != column.nearest)
      {
        found.push_back(column.farthest);
      }
    }
    return found;
  }

  void leaveOut(size_t index)
  {
    alone_[index] = true;
    const int column = part_[index].column;
    extremes_[static_cast<size_t>(column - first_)] = Extremes();
    for (size_t i = 0; i < part_.size(); ++i)
    {
      if (part_[i].column == column && !alone_[i])
      {
        put(i);
      }
    }
  }

private:
  static constexpr size_t NONE = static_cast<size_t>(-1);
  struct Extremes
  {
    size_t nearest = NONE;
    size_t farthest = NONE;
    float least2 = 0.0F;
    float most2 = 0.0F;
  };

  void put(size_t index)
  {
    Extremes& column = extremes_[static_cast<size_t>(part_[index].column - first_)];
    const float range2 = (part_[index].position.head<2>() - camera_).squaredNorm();
    if (column.nearest == NONE || range2 < column.least2)
    {
      column.nearest = index;
      column.least2 = range2;
    }
    if (column.farthest == NONE || range2 > column.most2)
    {
      column.farthest = index;
      column.most2 = range2;
    }
  }

  const std::vector<SurfacePoint>& part_;
  Eigen::Vector2f camera_;
  int first_ = 0;
  std::vector<Extremes> extremes_;
  std::vector<bool> alone_;
};

bool hasCompany(const std::vector<SurfacePoint>& part, const Eigen::Vector2d& place, double radius)
{
  const Eigen::Vector2f p = place.cast<float>();
  const auto radius2 = static_cast<float>(radius * radius);
  size_t near = 0;
  for (const SurfacePoint& point : part)
  {
    // It is near to itself.
    if ((point.position.head<2>() - p).squaredNorm() <= radius2 && ++near > COMPANY)
    {
      return true;
    }
  }
  return false;
}

}  // namespace

Outline measureOutline(const std::vector<SurfacePoint>& part, const OutlineScale& scale)
{
  Columns columns(part, scale.camera);
  const auto placeOf = [&part](size_t index) { return Eigen::Vector2d(part[index].position.head<2>().cast<double>()); };
  // A disparity's error makes one of depth that grows with the square of the depth.
  const auto depthError = [&scale](double range, double pixels) { return range * range / scale.fb * pixels; };
  size_t may_leave_out = part.size() < FEW ? 0 : static_cast<size_t>(std::ceil(MOST_ALONE * part.size()));
  std::vector<Eigen::Vector2d> corners;
  for (bool settled = false; !settled;)
  {
    settled = true;
    const std::vector<size_t> candidates = columns.candidates();
    std::vector<Eigen::Vector2d> places(candidates.size());
    std::transform(candidates.begin(), candidates.end(), places.begin(), placeOf);
    corners = convexHull(places);
    if (corners.empty())
    {
      corners = places;
    }
    for (size_t i = 0; i < candidates.size() && may_leave_out > 0; ++i)
    {
      if (std::find(corners.begin(), corners.end(), places[i]) == corners.end())
      {
        continue;
      }
      const double range = (places[i] - scale.camera).norm();
      const double radius =
          COMPANY_M + COMPANY_CELLS * scale.cell_rad * range + COMPANY_SIGMAS * depthError(range, DISPARITY_SIGMA_PX);
      if (!hasCompany(part, places[i], radius))
      {
        columns.leaveOut(candidates[i]);
        --may_leave_out;
        settled = false;
      }
    }
  }
  std::vector<Eigen::Vector2d> around;
  around.reserve(4 * corners.size());
  for (const Eigen::Vector2d& corner : corners)
  {
    const Eigen::Vector2d way = corner - scale.camera;
    const double range = std::max(1e-3, way.norm());
    const Eigen::Vector2d ray = way / range;
    const double half_m = std::max(LEAST_HALF_M, 0.5 * scale.cell_rad * range);
    const double error_m = std::clamp(depthError(range, DISPARITY_FLOOR_PX), LEAST_HALF_M, MOST_THICKER_M);
    const Eigen::Vector2d aside = half_m * Eigen::Vector2d(-ray.y(), ray.x());
    for (const double sign : {-1.0, 1.0})
    {
      around.push_back(corner - error_m * ray + sign * aside);
      around.push_back(corner + error_m * ray + sign * aside);
    }
  }
  Outline outline = convexHull(std::move(around));
  limitCorners(&outline);
  return outline;
}

}  // namespace pi_detect::obstacles
