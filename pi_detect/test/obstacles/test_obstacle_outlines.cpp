// From disparities to outlines: what is seen of things that stand at an angle.
#include <gtest/gtest.h>
#include <pi_detect/stereo_obstacles.h>

#include <cmath>
#include <limits>
#include <optional>
#include <random>

#include "obstacles/measure_outline.h"
#include "obstacles/stereo_on_mast.h"

namespace pi_detect
{
namespace
{

/// A block on the ground, turned by `heading` about its middle; base_link.
struct TurnedBlock
{
  Eigen::Vector2d middle;
  double heading;
  Eigen::Vector2d size;
  double height;

  Outline outline() const
  {
    const Eigen::Rotation2Dd turn(heading);
    Outline corners;
    for (const Eigen::Vector2d& sign : {Eigen::Vector2d(-1, -1), {1, -1}, {1, 1}, {-1, 1}})
    {
      corners.push_back(middle + turn * Eigen::Vector2d(0.5 * sign.cwiseProduct(size)));
    }
    return corners;
  }

  /// Depth at which a ray enters it, if it does: y and z per metre of x.
  std::optional<double> entry(double side, double rise) const
  {
    const Eigen::Rotation2Dd back(-heading);
    const Eigen::Vector2d from = back * Eigen::Vector2d(-middle);
    const Eigen::Vector2d way = back * Eigen::Vector2d(1.0, side);
    double enters = 0.0;
    double leaves = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 2; ++axis)
    {
      const double one = (-0.5 * size(axis) - from(axis)) / way(axis);
      const double other = (0.5 * size(axis) - from(axis)) / way(axis);
      enters = std::max(enters, std::min(one, other));
      leaves = std::min(leaves, std::max(one, other));
    }
    const double z = CAMERA_HEIGHT_M + rise * enters;
    return enters < leaves && enters > 0.0 && z >= 0.0 && z <= height ? std::optional<double>(enters) : std::nullopt;
  }
};

/// What a pair sees, and the true places on blocks that it sees.
struct View
{
  cv::Mat disparity;
  std::vector<Eigen::Vector2d> seen;

  View(const std::vector<TurnedBlock>& blocks, double noise_px)
  {
    const StereoGeometry geometry = makeGeometry();
    disparity = cv::Mat(geometry.height, geometry.width, CV_32FC1, cv::Scalar(-1.0));
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0.0, noise_px);
    for (int v = 0; v < geometry.height; ++v)
    {
      for (int u = 0; u < geometry.width; ++u)
      {
        const double side = -(u - geometry.cx) / geometry.fx;
        const double rise = -(v - geometry.cy) / geometry.fy;
        double depth = rise < 0.0 ? -CAMERA_HEIGHT_M / rise : std::numeric_limits<double>::infinity();
        for (const TurnedBlock& block : blocks)
        {
          const auto entry = block.entry(side, rise);
          if (entry && *entry < depth)
          {
            depth = *entry;
            if (CAMERA_HEIGHT_M + rise * depth > 0.3)
            {
              seen.emplace_back(depth, side * depth);
            }
          }
        }
        if (depth < 60.0)
        {
          disparity.at<float>(v, u) =
              static_cast<float>(geometry.fx * geometry.baseline_m / depth + (noise_px > 0.0 ? noise(random) : 0.0));
        }
      }
    }
  }
};

std::vector<Outline> outlinesOf(const View& view)
{
  std::vector<Outline> outlines;
  for (const ObstacleMeasurement& obstacle :
       StereoObstacles(makeGeometry(), makeMounting(), StereoObstacleOptions()).detect(view.disparity).obstacles)
  {
    EXPECT_GE(obstacle.outline.size(), 3U);
    EXPECT_LE(obstacle.outline.size(), MAX_OUTLINE_CORNERS);
    outlines.push_back(obstacle.outline);
  }
  return outlines;
}

double partInside(const std::vector<Outline>& outlines, const std::vector<Eigen::Vector2d>& points, double tolerance)
{
  size_t inside = 0;
  for (const Eigen::Vector2d& point : points)
  {
    inside += std::any_of(outlines.begin(), outlines.end(),
                          [&](const Outline& outline) { return contains(outline, point, tolerance); })
                  ? 1
                  : 0;
  }
  return static_cast<double>(inside) / static_cast<double>(points.size());
}

/// How far an outline reaches out of a convex shape [m].
double reachesOut(const Outline& outline, const Outline& shape)
{
  double most = 0.0;
  for (const Eigen::Vector2d& corner : outline)
  {
    for (size_t i = 0; i < shape.size(); ++i)
    {
      const Eigen::Vector2d side = shape[(i + 1) % shape.size()] - shape[i];
      most = std::max(most, Eigen::Vector2d(side.y(), -side.x()).normalized().dot(corner - shape[i]));
    }
  }
  return most;
}

TEST(ObstacleOutlines, AnObliqueCarHasTheOutlineOfACar)
{
  const TurnedBlock car{{8.0, -2.6}, M_PI / 4.0, {4.4, 1.8}, 1.5};
  for (const double noise_px : {0.0, 0.25})
  {
    const View view({car}, noise_px);
    const std::vector<Outline> outlines = outlinesOf(view);
    ASSERT_EQ(outlines.size(), 1U);
    // Its box is 4.4 x 4.4 m; the car alone has 7.9 m^2, of which one half is not seen.
    EXPECT_LT(areaOf(outlines[0]), noise_px > 0.0 ? 8.5 : 6.5);
    EXPECT_LT(reachesOut(outlines[0], car.outline()), noise_px > 0.0 ? 0.5 : 0.25);
    EXPECT_GT(partInside(outlines, view.seen, 0.2), 0.99);
  }
}

TEST(ObstacleOutlines, AWallSeenObliquelyIsAStrip)
{
  const TurnedBlock wall{{9.0, 2.5}, 0.5, {7.0, 0.2}, 1.8};
  const View view({wall}, 0.0);
  const std::vector<Outline> outlines = outlinesOf(view);
  ASSERT_FALSE(outlines.empty());
  double area = 0.0;
  for (const Outline& outline : outlines)
  {
    area += areaOf(outline);
    EXPECT_LT(reachesOut(outline, wall.outline()), 0.25);
  }
  EXPECT_LT(area, 4.0) << "its box has more than 20 m^2";
  EXPECT_GT(partInside(outlines, view.seen, 0.2), 0.98) << "but for a part of the farthest cell";
}

TEST(ObstacleOutlines, AnEdgeTowardsTheCameraIsATriangle)
{
  // Two walls that meet at (6, 0.3), the nearest point.
  const TurnedBlock left{{6.9, 1.2}, M_PI / 4.0, {2.6, 0.1}, 1.2};
  const TurnedBlock right{{6.9, -0.6}, -M_PI / 4.0, {2.6, 0.1}, 1.2};
  const View view({left, right}, 0.0);
  const std::vector<Outline> outlines = outlinesOf(view);
  ASSERT_EQ(outlines.size(), 1U);
  EXPECT_GT(partInside(outlines, view.seen, 0.2), 0.99);
  // The box around them has 2 x 3.9 m.
  EXPECT_LT(areaOf(outlines[0]), 5.2);
  EXPECT_FALSE(contains(outlines[0], {6.0, 1.5})) << "what is free beside the edge";
  EXPECT_FALSE(contains(outlines[0], {6.0, -0.9}));
  EXPECT_TRUE(contains(outlines[0], {6.8, 0.3})) << "what the edge hides";
}

std::vector<obstacles::SurfacePoint> makeFront(double x, double half_width)
{
  std::vector<obstacles::SurfacePoint> points;
  const double cell = 4.0 / 320.0;
  const int half = static_cast<int>(half_width / (cell * x));
  for (int column = -half; column <= half; ++column)
  {
    for (int row = 0; row < 10; ++row)
    {
      points.push_back(
          {Eigen::Vector3f(static_cast<float>(x), static_cast<float>(-column * cell * x), 1.0F), 80 + column, row, 16});
    }
  }
  return points;
}

obstacles::OutlineScale makeScale()
{
  obstacles::OutlineScale scale;
  scale.cell_rad = 4.0 / 320.0;
  scale.fb = 38.4;
  return scale;
}

TEST(MeasureOutline, OfAFrontIsAThinStrip)
{
  const Outline outline = obstacles::measureOutline(makeFront(6.0, 0.5), makeScale());
  ASSERT_GE(outline.size(), 4U);
  const OutlineBounds bounds = boundsOf(outline);
  EXPECT_GT(bounds.high.x() - bounds.low.x(), 0.1);
  EXPECT_LT(bounds.high.x() - bounds.low.x(), 0.35);
  EXPECT_NEAR(bounds.high.y() - bounds.low.y(), 1.05, 0.15);
  EXPECT_LT(bounds.low.x(), 6.0 - 0.05) << "nearer by the depth's error";
}

TEST(MeasureOutline, LeavesOutSinglePoints)
{
  std::vector<obstacles::SurfacePoint> points = makeFront(6.0, 0.5);
  const double expected = areaOf(obstacles::measureOutline(points, makeScale()));
  points[3].position.x() = 4.5F;
  points[40].position.x() = 9.0F;
  points.back().position.y() -= 1.0F;
  EXPECT_NEAR(areaOf(obstacles::measureOutline(points, makeScale())), expected, 0.15);
}

TEST(MeasureOutline, KeepsWhatSeveralPointsShow)
{
  std::vector<obstacles::SurfacePoint> points = makeFront(6.0, 0.5);
  for (size_t i = 40; i < 46; ++i)
  {
    points[i].position.x() = 5.0F;
  }
  EXPECT_TRUE(contains(obstacles::measureOutline(points, makeScale()), {5.0, points[40].position.y()}));
}

TEST(MeasureOutline, OfFewPointsHoldsThemAll)
{
  std::vector<obstacles::SurfacePoint> points = makeFront(6.0, 0.04);
  points.resize(3);
  points[2].position.x() = 6.8F;
  const Outline outline = obstacles::measureOutline(points, makeScale());
  for (const obstacles::SurfacePoint& point : points)
  {
    EXPECT_TRUE(contains(outline, point.position.head<2>().cast<double>()));
  }
  points.resize(1);
  EXPECT_GE(obstacles::measureOutline(points, makeScale()).size(), 3U);
}

}  // namespace
}  // namespace pi_detect
