#include "usual_recipe.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace pi_detect::bench
{

namespace
{

constexpr double CELL_M = 0.2;
constexpr int BLOCK_PX = 5;
constexpr int DISPARITIES = 64;  // default of stereo_image_proc
constexpr int MIN_PIXELS = 50;

}  // namespace

UsualRecipe::UsualRecipe(const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
                         const StereoObstacleOptions& options)
  : geometry_(geometry)
  , T_base_left_(T_base_left)
  , options_(options)
  , matcher_(cv::StereoSGBM::create(0, DISPARITIES, BLOCK_PX, 8 * BLOCK_PX * BLOCK_PX, 32 * BLOCK_PX * BLOCK_PX, 1, 63,
                                    10, 100, 2))
{
}

std::vector<ObstacleMeasurement> UsualRecipe::detect(const cv::Mat& left, const cv::Mat& right)
{
  cv::Mat fixed_point;
  matcher_->compute(left, right, fixed_point);
  const int size = static_cast<int>(options_.max_range_m / CELL_M);
  cv::Mat counts = cv::Mat::zeros(size, 2 * size, CV_8UC1);
  struct Point
  {
    Eigen::Vector3d p;
    cv::Point cell;
    int u;
    int v;
  };
  std::vector<Point> points;
  for (int v = 0; v < fixed_point.rows; ++v)
  {
    for (int u = 0; u < fixed_point.cols; ++u)
    {
      const double d = fixed_point.at<int16_t>(v, u) / 16.0;
      if (d <= 0.0)
      {
        continue;
      }
      const double z = geometry_.fx * geometry_.baseline_m / d;
      const Eigen::Vector3d p = T_base_left_ * Eigen::Vector3d(z * (u - geometry_.cx) / geometry_.fx,
                                                               z * (v - geometry_.cy) / geometry_.fy, z);
      if (p.z() < options_.min_height_m || p.z() > options_.max_height_m || p.x() <= 0.0)
      {
        continue;
      }
      const cv::Point cell(size + static_cast<int>(std::floor(p.y() / CELL_M)), static_cast<int>(p.x() / CELL_M));
      if (cell.x >= 0 && cell.x < counts.cols && cell.y < counts.rows)
      {
        counts.at<uint8_t>(cell) = 255;
        points.push_back({p, cell, u, v});
      }
    }
  }
  cv::Mat labels;
  const int groups = cv::connectedComponents(counts, labels, 8);
  std::vector<ObstacleMeasurement> found(static_cast<size_t>(groups));
  for (const Point& point : points)
  {
    ObstacleMeasurement& obstacle = found[static_cast<size_t>(labels.at<int>(point.cell))];
    const Box pixel{static_cast<float>(point.u), static_cast<float>(point.v), static_cast<float>(point.u + 1),
                    static_cast<float>(point.v + 1)};
    if (obstacle.points++ == 0)
    {
      obstacle.min = obstacle.max = obstacle.nearest = point.p;
      obstacle.box = pixel;
      continue;
    }
    obstacle.min = obstacle.min.cwiseMin(point.p);
    obstacle.max = obstacle.max.cwiseMax(point.p);
    obstacle.box = {std::min(obstacle.box.x1, pixel.x1), std::min(obstacle.box.y1, pixel.y1),
                    std::max(obstacle.box.x2, pixel.x2), std::max(obstacle.box.y2, pixel.y2)};
    if (point.p.head<2>().norm() < obstacle.nearest.head<2>().norm())
    {
      obstacle.nearest = point.p;
    }
  }
  found.erase(std::remove_if(found.begin(), found.end(),
                             [](const ObstacleMeasurement& obstacle) { return obstacle.points < MIN_PIXELS; }),
              found.end());
  for (ObstacleMeasurement& obstacle : found)
  {
    obstacle.covariance = 0.04 * Eigen::Matrix3d::Identity();
  }
  return found;
}

}  // namespace pi_detect::bench
