#include "obstacles/ground_viewer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "obstacles/surfaces.h"

namespace pi_detect::obstacles
{

namespace
{

constexpr int CELL_PX = SurfaceFinder::CELL_PX;
constexpr double MIDDLE = 0.5 * (CELL_PX - 1);
constexpr int GROUND_PIXELS = 3;      // of the 4 that are looked at in a cell
constexpr double SHOWS_SIGMAS = 3.0;  // within which a pixel shows the ground
constexpr int MOST_GAP = 2;           // cells without measured ground within what is free
constexpr size_t LEAST_POINTS = 2;    // of a hit
constexpr double HIT_STEP_M = 0.35;   // between two hits of a beam, at least

}  // namespace

GroundViewer::GroundViewer(const MatchedCamera& camera, const Eigen::Isometry3d& T_base_left,
                           const StereoObstacleOptions& options)
  : camera_(camera)
  , T_base_left_(T_base_left)
  , max_range_m_(options.max_range_m)
  , columns_((camera.width + CELL_PX - 1) / CELL_PX)
  , rows_((camera.height + CELL_PX - 1) / CELL_PX)
  , distances_(static_cast<size_t>(columns_))
{
}

float GroundViewer::disparityAt(int u, int v) const
{
  const float fine = disparity_.at<float>(v, u);
  if (fine > 0.0F || coarse_.empty())
  {
    return fine;
  }
  return static_cast<float>(scale_) *
         coarse_.at<float>(v * coarse_.rows / disparity_.rows, u * coarse_.cols / disparity_.cols);
}

bool GroundViewer::showsGround(const DisparityPlane& ground, int column, int row) const
{
  const double clear = SHOWS_SIGMAS * std::hypot(DISPARITY_SIGMA_PX, ground.sigma_px);
  int seen = 0;
  for (const int dv : {0, CELL_PX / 2})
  {
    for (const int du : {0, CELL_PX / 2})
    {
      const int u = std::min(camera_.width - 1, column * CELL_PX + du);
      const int v = std::min(camera_.height - 1, row * CELL_PX + dv);
      const float d = disparityAt(u, v);
      seen += d > 0.0F && std::abs(d - ground.at(u, v)) < clear ? 1 : 0;
    }
  }
  return seen >= GROUND_PIXELS;
}

double GroundViewer::distanceAt(const DisparityPlane& ground, double u, double v) const
{
  const double d = ground.at(u, v);
  if (d < camera_.fb / (2.0 * max_range_m_))
  {
    return std::numeric_limits<double>::infinity();
  }
  return (T_base_left_.linear() * (camera_.fb / d * camera_.ray(u, v))).head<2>().norm();
}

void GroundViewer::seeFree(const DisparityPlane& ground, int column, GroundBeam* beam) const
{
  const double u = column * CELL_PX + MIDDLE;
  const double nearest = beam->hit_count > 0 ? beam->hits[0].distance - beam->hits[0].sigma : max_range_m_;
  int gap = 0;
  for (int row = rows_ - 1; row >= 0 && gap <= MOST_GAP; --row)
  {
    const double from = distanceAt(ground, u, std::min(camera_.height - 1, (row + 1) * CELL_PX - 1));
    if (from >= nearest)
    {
      break;
    }
    if (!showsGround(ground, column, row))
    {
      gap += beam->free_to > 0.0F ? 1 : 0;
      continue;
    }
    gap = 0;
    beam->free_from = beam->free_to > 0.0F ? beam->free_from : static_cast<float>(from);
    beam->free_to = static_cast<float>(std::min(nearest, distanceAt(ground, u, row * CELL_PX)));
  }
}

void GroundViewer::seeHits(std::vector<float>* distances, GroundBeam* beam) const
{
  std::sort(distances->begin(), distances->end());
  for (size_t begin = 0; begin < distances->size() && beam->hit_count < GroundBeam::MOST_HITS;)
  {
    const double first = (*distances)[begin];
    const auto sigma = [this](double distance, double points)
    {
      const double disparity_sigma = std::hypot(DISPARITY_FLOOR_PX, DISPARITY_SIGMA_PX / std::sqrt(points));
      return distance * distance / camera_.fb * disparity_sigma;
    };
    const double step = std::max(HIT_STEP_M, sigma(first, 1.0));
    size_t end = begin + 1;
    while (end < distances->size() && (*distances)[end] - (*distances)[end - 1] < step)
    {
      ++end;
    }
    if (const size_t count = end - begin; count >= LEAST_POINTS)
    {
      const float middle = (*distances)[begin + count / 2];
      beam->hits[beam->hit_count++] = {middle, static_cast<float>(sigma(middle, static_cast<double>(count)))};
    }
    begin = end;
  }
}

GroundView GroundViewer::look(const cv::Mat& disparity, const cv::Mat& coarse, double scale,
                              const DisparityPlane& ground, const std::vector<Eigen::Vector3f>& points)
{
  disparity_ = disparity;
  coarse_ = coarse;
  scale_ = scale;
  GroundView view;
  view.camera = T_base_left_.translation().head<2>();
  view.beam_rad = CELL_PX / camera_.fx;
  for (std::vector<float>& distances : distances_)
  {
    distances.clear();
  }
  const Eigen::Isometry3d T_left_base = T_base_left_.inverse();
  for (const Eigen::Vector3f& point : points)
  {
    const Eigen::Vector3d p_left = T_left_base * point.cast<double>();
    const auto column = static_cast<int>((camera_.fx * p_left.x() / p_left.z() + camera_.cx) / CELL_PX);
    if (column >= 0 && column < columns_)
    {
      distances_[static_cast<size_t>(column)].push_back(
          static_cast<float>((point.head<2>().cast<double>() - view.camera).norm()));
    }
  }
  const double horizon = camera_.cy;
  for (int column = 0; column < columns_; ++column)
  {
    GroundBeam beam;
    const Eigen::Vector3d along = T_base_left_.linear() * camera_.ray(column * CELL_PX + MIDDLE, horizon);
    beam.bearing = static_cast<float>(std::atan2(along.y(), along.x()));
    seeHits(&distances_[static_cast<size_t>(column)], &beam);
    seeFree(ground, column, &beam);
    view.beams.push_back(beam);
  }
  return view;
}

}  // namespace pi_detect::obstacles
