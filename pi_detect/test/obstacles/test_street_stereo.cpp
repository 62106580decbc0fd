// Obstacles in real street pairs: rectified pictures of Karlsruhe and KITTI, cameras about level, 1.65 m high. The
// reference of kitti151 is the disparity of a strong network; that of the others is matched here at full size, over
// eight paths, and checked from both sides. Neither is laser truth. Figures are printed, with the time of the
// processor.

#include <gtest/gtest.h>
#include <pi_detect/stereo_obstacles.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "obstacles/stereo_on_mast.h"

namespace pi_detect
{
namespace
{

constexpr double NEAR_M = 15.0;       // surfaces that count: along the optical axis, ...
constexpr double LOW_M = 0.3;         // above the ground, ...
constexpr double HIGH_M = 2.0;        //
constexpr size_t SURFACE_PX = 12;     // pixels of a column, ...
constexpr double SAME_PART = 0.05;    // whose disparities differ by this part at most
constexpr double RIGHT_PART = 0.1;    // error of a depth that is right
constexpr int BESIDE_PX = 4;          // half a cell at half size
constexpr double RAISED_M = 0.1;      // above the ground: no free road
constexpr size_t RAISED_POINTS = 20;  // in the box of an obstacle that is none of the free road
constexpr double BOX_M = 0.2;         // tolerance of a box, ...
constexpr double BOX_PART = 0.05;     // with this part of its distance
constexpr int REFERENCE_DISPARITIES = 208;

struct StreetPair
{
  std::string name;
  StereoGeometry geometry;
  cv::Mat left;
  cv::Mat right;
  cv::Mat reference;  ///< disparity, not above 0: unknown

  double fb() const { return geometry.fx * geometry.baseline_m; }
};

cv::Mat matchedReference(const cv::Mat& left, const cv::Mat& right)
{
  constexpr int PADDING = REFERENCE_DISPARITIES;
  cv::Mat padded[2];
  cv::copyMakeBorder(left, padded[0], 0, 0, PADDING, 0, cv::BORDER_REPLICATE);
  cv::copyMakeBorder(right, padded[1], 0, 0, PADDING, 0, cv::BORDER_REPLICATE);
  cv::Mat fixed_point;
  cv::StereoSGBM::create(0, REFERENCE_DISPARITIES, 3, 8 * 9, 32 * 9, 1, 31, 5, 200, 2, cv::StereoSGBM::MODE_HH)
      ->compute(padded[0], padded[1], fixed_point);
  cv::Mat disparity;
  fixed_point.colRange(PADDING, fixed_point.cols).convertTo(disparity, CV_32F, 1.0 / 16.0);
  return disparity;
}

/// Visits the reference's points that have a partner in the right picture: column, depth, point in base_link, height.
void visitPoints(const StreetPair& pair, const Eigen::Isometry3d& T_base_left, const GroundPlane& ground,
                 const std::function<void(int, double, const Eigen::Vector3d&, double)>& visit)
{
  const StereoGeometry& geometry = pair.geometry;
  for (int u = 0; u < geometry.width; ++u)
  {
    for (int v = 0; v < geometry.height; ++v)
    {
      const float d = pair.reference.at<float>(v, u);
      if (d > 0.0F && d <= static_cast<float>(u))
      {
        const double depth = pair.fb() / d;
        const Eigen::Vector3d p = T_base_left * (depth * Eigen::Vector3d((u - geometry.cx) / geometry.fx,
                                                                         (v - geometry.cy) / geometry.fy, 1));
        visit(u, depth, p, ground.normal.dot(p) - ground.offset_m);
      }
    }
  }
}

/// Depth of the nearest surface of each column; 0: none that counts.
std::vector<double> nearestSurfaces(const StreetPair& pair, const Eigen::Isometry3d& T_base_left,
                                    const GroundPlane& ground)
{
  std::vector<std::vector<double>> depths(static_cast<size_t>(pair.geometry.width));
  visitPoints(pair, T_base_left, ground,
              [&](int u, double depth, const Eigen::Vector3d&, double height)
              {
                if (depth <= NEAR_M && height > LOW_M && height < HIGH_M)
                {
                  depths[static_cast<size_t>(u)].push_back(depth);
                }
              });
  std::vector<double> nearest(depths.size(), 0.0);
  for (size_t u = 0; u < depths.size(); ++u)
  {
    std::vector<double>& column = depths[u];
    std::sort(column.begin(), column.end());
    for (size_t i = 0; i + SURFACE_PX <= column.size(); ++i)
    {
      if (column[i + SURFACE_PX - 1] * (1.0 - SAME_PART) < column[i])
      {
        nearest[u] = column[i + SURFACE_PX / 2];
        break;
      }
    }
  }
  return nearest;
}

/// Part of the columns with a near surface in which an obstacle's point has its depth.
double columnRecall(const std::vector<double>& surfaces, const std::vector<Eigen::Vector3f>& points,
                    const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left)
{
  std::vector<std::vector<double>> found(surfaces.size());
  const Eigen::Isometry3d T_left_base = T_base_left.inverse();
  for (const Eigen::Vector3f& point : points)
  {
    const Eigen::Vector3d p = T_left_base * point.cast<double>();
    const int column = static_cast<int>(std::lround(geometry.fx * p.x() / p.z() + geometry.cx));
    for (int u = std::max(0, column - BESIDE_PX); u <= std::min(geometry.width - 1, column + BESIDE_PX); ++u)
    {
      found[static_cast<size_t>(u)].push_back(p.z());
    }
  }
  size_t wanted = 0;
  size_t right = 0;
  for (size_t u = 0; u < surfaces.size(); ++u)
  {
    wanted += surfaces[u] > 0.0 ? 1 : 0;
    right +=
        surfaces[u] > 0.0 && std::any_of(found[u].begin(), found[u].end(),
                                         [&](double z) { return std::abs(z - surfaces[u]) < RIGHT_PART * surfaces[u]; })
            ? 1
            : 0;
  }
  EXPECT_GT(wanted, 100U) << "a street without near surfaces tests nothing";
  return static_cast<double>(right) / static_cast<double>(std::max<size_t>(1, wanted));
}

/// Obstacles in whose box the reference has nothing above the ground.
size_t onFreeRoad(const StreetPair& pair, const Eigen::Isometry3d& T_base_left, const GroundPlane& ground,
                  const std::vector<ObstacleMeasurement>& obstacles)
{
  std::vector<size_t> raised(obstacles.size(), 0);
  visitPoints(pair, T_base_left, ground,
              [&](int, double, const Eigen::Vector3d& p, double height)
              {
                for (size_t i = 0; i < obstacles.size() && height > RAISED_M; ++i)
                {
                  const ObstacleMeasurement& obstacle = obstacles[i];
                  const double tolerance = BOX_M + BOX_PART * obstacle.nearest.head<2>().norm();
                  const bool inside = ((p - obstacle.min).array() > -tolerance).all() &&
                                      ((obstacle.max - p).array() > -tolerance).all();
                  raised[i] += inside ? 1 : 0;
                }
              });
  return static_cast<size_t>(
      std::count_if(raised.begin(), raised.end(), [](size_t points) { return points < RAISED_POINTS; }));
}

double processorMs()
{
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_nsec) * 1e-6;
}

class StreetStereo : public testing::TestWithParam<const char*>
{
protected:
  void SetUp() override
  {
    const char* data = std::getenv("PI_EDGE_DATA");
    const std::string path = std::string(data == nullptr ? "" : data) + "/detect/stereo_street/" + GetParam();
    pair_.name = GetParam();
    pair_.left = cv::imread(path + "_left.png", cv::IMREAD_GRAYSCALE);
    pair_.right = cv::imread(path + "_right.png", cv::IMREAD_GRAYSCALE);
    if (data == nullptr || pair_.left.empty())
    {
      GTEST_SKIP() << "no " << path << "_left.png; set PI_EDGE_DATA";
    }
    const bool kitti = pair_.name == "kitti151";
    StereoGeometry& geometry = pair_.geometry;
    geometry.width = pair_.left.cols;
    geometry.height = pair_.left.rows;
    geometry.fx = geometry.fy = kitti ? 721.5377 : 645.24;
    geometry.cx = kitti ? 609.5593 : 635.96;
    geometry.cy = kitti ? 172.854 : 194.13;
    geometry.baseline_m = kitti ? 0.532719 : 0.5707;
    if (kitti)
    {
      cv::imread(path + "_disparity.png", cv::IMREAD_UNCHANGED).convertTo(pair_.reference, CV_32F, 1.0 / 256.0);
    }
    else
    {
      pair_.reference = matchedReference(pair_.left, pair_.right);
    }
    T_base_left_.translation().z() = 1.65;
    cv::setNumThreads(1);
  }
  void TearDown() override { cv::setNumThreads(-1); }

  StreetPair pair_;
  Eigen::Isometry3d T_base_left_ = makeMounting();
};

TEST_P(StreetStereo, FindsWhatStandsInTheStreet)
{
  StereoObstacles detector(pair_.geometry, T_base_left_, StereoObstacleOptions());
  const GroundPlane ground =
      StereoObstacles(pair_.geometry, T_base_left_, StereoObstacleOptions()).detect(pair_.reference).ground;
  ASSERT_TRUE(ground.measured);
  const double start_ms = processorMs();
  const auto result = detector.detect(pair_.left, pair_.right);
  const double ms = processorMs() - start_ms;
  const double recall =
      columnRecall(nearestSurfaces(pair_, T_base_left_, ground), result.points, pair_.geometry, T_base_left_);
  const size_t free_road = onFreeRoad(pair_, T_base_left_, ground, result.obstacles);
  std::printf(
      "%s: %.1f %% of the columns with a surface within %.0f m, coverage %.1f %%, %zu obstacles, %zu of them on "
      "free road, ground %s, depth from %.2f m, %.1f ms\n",
      pair_.name.c_str(), 100.0 * recall, NEAR_M, 100.0 * result.coverage, result.obstacles.size(), free_road,
      result.ground.measured ? "measured" : "not measured", detector.minDepth(), ms);
  EXPECT_GE(recall, 0.95);
  EXPECT_GE(result.coverage, 0.7);
  EXPECT_EQ(free_road, 0U);
  EXPECT_TRUE(result.ground.measured);
  EXPECT_LE(detector.minDepth(), 2.0) << "1 m before the vehicle's front";
}

INSTANTIATE_TEST_SUITE_P(Pairs, StreetStereo, testing::Values("urban1", "urban2", "kitti151"),
                         [](const testing::TestParamInfo<const char*>& info) { return std::string(info.param); });

}  // namespace
}  // namespace pi_detect
