// What the obstacle tracker makes of outlines.
#include <gtest/gtest.h>
#include <pi_detect/obstacle_tracker.h>

#include <algorithm>
#include <cmath>

#include "obstacles/stereo_on_mast.h"

namespace pi_detect
{
namespace
{

constexpr int64_t OUTLINE_STEP_NS = 50000000;
constexpr double OUTLINE_STEP_S = 0.05;

/// A thing 1.5 m high with that outline.
ObstacleMeasurement makeMeasurement(const Outline& outline)
{
  const OutlineBounds bounds = boundsOf(outline);
  ObstacleMeasurement measurement;
  measurement.min << bounds.low, 0.1;
  measurement.max << bounds.high, 1.5;
  measurement.nearest << bounds.low.x(), 0.5 * (bounds.low.y() + bounds.high.y()), 0.8;
  measurement.covariance = 0.0025 * Eigen::Matrix3d::Identity();
  measurement.outline = outline;
  measurement.points = 400;
  const StereoGeometry geometry = makeGeometry();
  double left = geometry.width;
  double right = 0.0;
  for (const Eigen::Vector2d& corner : outline)
  {
    left = std::min(left, geometry.cx - geometry.fx * corner.y() / corner.x());
    right = std::max(right, geometry.cx - geometry.fx * corner.y() / corner.x());
  }
  const auto row = [&](double z) { return static_cast<float>(geometry.cy - geometry.fy * (z - 1.0) / bounds.low.x()); };
  measurement.box = {static_cast<float>(left), row(1.5), static_cast<float>(right), row(0.1)};
  return measurement;
}

Outline moved(Outline outline, const Eigen::Vector2d& by)
{
  for (Eigen::Vector2d& corner : outline)
  {
    corner += by;
  }
  return outline;
}

Outline makeBox(double x, double y, double size_x, double size_y)
{
  return {{x, y - 0.5 * size_y}, {x + size_x, y - 0.5 * size_y}, {x + size_x, y + 0.5 * size_y}, {x, y + 0.5 * size_y}};
}

class OutlineDrive
{
public:
  std::vector<Obstacle> step(const std::vector<ObstacleMeasurement>& measurements)
  {
    stamp_ns_ += OUTLINE_STEP_NS;
    return tracker_.update(stamp_ns_, vehicle, measurements, {}, makeGeometry(), makeMounting());
  }

  void turnTo(double heading)
  {
    vehicle.T_odom_base.linear() = Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  }

  Outline inOdom(const Outline& outline) const
  {
    Outline result;
    for (const Eigen::Vector2d& corner : outline)
    {
      result.push_back((vehicle.T_odom_base * Eigen::Vector3d(corner.x(), corner.y(), 0.0)).head<2>());
    }
    return result;
  }

  VehicleState vehicle;

  /// @return obstacles after so many pictures of one measurement.
  std::vector<Obstacle> look(int pictures, const ObstacleMeasurement& measurement)
  {
    std::vector<Obstacle> obstacles;
    for (int i = 0; i < pictures; ++i)
    {
      obstacles = step({measurement});
    }
    return obstacles;
  }

private:
  int64_t stamp_ns_ = 100000000000;
  ObstacleTracker tracker_;
};

/// A car that stands at 45 degrees: 4 m x 1.6 m.
const Outline OBLIQUE = {{5.0, -3.2}, {6.13, -4.33}, {8.96, -1.5}, {7.83, -0.37}};

void expectSame(const Outline& expected, const Outline& found, double tolerance)
{
  ASSERT_GE(found.size(), 3U);
  EXPECT_NEAR(areaOf(expected), areaOf(found), tolerance * 10.0);
  for (const Eigen::Vector2d& corner : expected)
  {
    EXPECT_TRUE(contains(found, corner, tolerance)) << corner.transpose();
  }
}

TEST(TrackedOutlines, AreThoseThatWereMeasured)
{
  OutlineDrive drive;
  std::vector<Obstacle> obstacles = drive.look(5, makeMeasurement(OBLIQUE));
  ASSERT_EQ(obstacles.size(), 1U);
  expectSame(OBLIQUE, obstacles[0].outline, 0.02);
  EXPECT_FALSE(contains(obstacles[0].outline, {5.5, -1.5})) << "in its box, but not in the car";
  ObstacleMeasurement without = makeMeasurement(OBLIQUE);
  without.outline.clear();
  EXPECT_TRUE(drive.step({without})[0].outline.empty()) << "the box is all that is known";
}

TEST(TrackedOutlines, OfWhatIsRememberedDoNotTurnWithTheVehicle)
{
  OutlineDrive drive;
  std::vector<Obstacle> obstacles = drive.look(10, makeMeasurement(OBLIQUE));
  ASSERT_EQ(obstacles.size(), 1U);
  // A sharp turn to the left: the car leaves the view on the right.
  for (int i = 1; i <= 30; ++i)
  {
    drive.vehicle.T_odom_base.translation().x() = 0.02 * i;
    drive.turnTo(0.12 * std::min(i, 10));
    obstacles = drive.step({});
    ASSERT_EQ(obstacles.size(), 1U) << "picture " << i;
    expectSame(OBLIQUE, drive.inOdom(obstacles[0].outline), 0.05);
    if (i <= 6)
    {
      continue;
    }
    // The box lies around it, along the axes that the vehicle has by then.
    const OutlineBounds bounds = boundsOf(obstacles[0].outline);
    EXPECT_NEAR(obstacles[0].size.x(), bounds.high.x() - bounds.low.x(), 1e-6);
    EXPECT_NEAR(obstacles[0].position.y(), 0.5 * (bounds.low.y() + bounds.high.y()), 1e-6);
  }
}

TEST(TrackedOutlines, GoOnWithWhatMoves)
{
  OutlineDrive drive;
  const Outline person = makeBox(8.0, -2.0, 0.3, 0.5);
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 50; ++i)
  {
    obstacles = drive.step({makeMeasurement(moved(person, {0.0, 1.4 * OUTLINE_STEP_S * i}))});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  ASSERT_TRUE(obstacles[0].moving);
  EXPECT_TRUE(contains(obstacles[0].outline, {8.15, -2.0 + 1.4 * OUTLINE_STEP_S * 49}));
  EXPECT_LT(boundsOf(obstacles[0].outline).high.y() - boundsOf(obstacles[0].outline).low.y(), 0.8);
  for (int i = 50; i < 60; ++i)
  {
    obstacles = drive.step({});
    ASSERT_EQ(obstacles.size(), 1U);
    EXPECT_TRUE(contains(obstacles[0].outline, {8.15, -2.0 + 1.4 * OUTLINE_STEP_S * i}, 0.05)) << "picture " << i;
  }
}

TEST(TrackedOutlines, OfPiecesAreNotSaidToMove)
{
  // What of a parked car is seen beside a post shifts as the vehicle passes.
  OutlineDrive drive;
  OutlineDrive whole;
  bool whole_moves = false;
  for (int i = 0; i < 20; ++i)
  {
    ObstacleMeasurement piece = makeMeasurement(moved(makeBox(5.0, -3.0, 0.2, 0.3), {0.0, 2.0 * OUTLINE_STEP_S * i}));
    for (const Obstacle& obstacle : whole.step({piece}))
    {
      whole_moves = whole_moves || obstacle.moving;
    }
    piece.piece = true;
    for (const Obstacle& obstacle : drive.step({piece}))
    {
      EXPECT_FALSE(obstacle.moving) << "picture " << i;
    }
  }
  EXPECT_TRUE(whole_moves) << "the same of a thing of its own is a motion";
}

TEST(TrackedOutlines, DoNotGrowByWhatASinglePictureJoins)
{
  OutlineDrive drive;
  const Outline piece = makeBox(6.0, -2.0, 0.6, 1.0);
  Outline joined = convexHull({{6.0, -2.5}, {6.6, -2.5}, {6.0, -1.5}, {6.6, 1.0}, {6.0, 1.0}});
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 10; ++i)
  {
    obstacles = drive.step({makeMeasurement(i == 8 ? joined : piece)});
    for (const Obstacle& obstacle : obstacles)
    {
      EXPECT_FALSE(contains(obstacle.outline, {6.3, 0.0})) << "picture " << i;
      EXPECT_TRUE(contains(obstacle.outline, {6.3, -2.0})) << "picture " << i;
    }
  }
  drive.step({makeMeasurement(joined)});
  obstacles = drive.step({makeMeasurement(joined)});
  ASSERT_FALSE(obstacles.empty());
  EXPECT_TRUE(contains(obstacles[0].outline, {6.1, 0.9})) << "two pictures count";
}

TEST(TrackedOutlines, DoNotShrinkByWhatASinglePictureLeavesOut)
{
  OutlineDrive drive;
  const Outline whole = makeBox(6.0, 0.0, 0.5, 2.0);
  drive.look(9, makeMeasurement(whole));
  const std::vector<Obstacle> obstacles = drive.step({makeMeasurement(makeBox(6.0, 0.5, 0.5, 1.0))});
  ASSERT_FALSE(obstacles.empty());
  EXPECT_TRUE(contains(obstacles[0].outline, {6.2, -0.8}));
}

TEST(TrackedOutlines, OfWhatIsRememberedEndWhereNothingIsSeen)
{
  OutlineDrive drive;
  // Beyond what stands before its middle, a wall was seen that is gone.
  const Outline wall = makeBox(9.0, 0.0, 0.4, 8.0);
  const Outline before = makeBox(4.0, 0.0, 0.4, 1.6);
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 10; ++i)
  {
    drive.step({makeMeasurement(wall)});
  }
  for (int i = 0; i < 20; ++i)
  {
    obstacles = drive.step({makeMeasurement(before)});
  }
  ASSERT_EQ(obstacles.size(), 2U);
  EXPECT_TRUE(contains(obstacles[1].outline, {9.2, 0.0})) << "hidden: it may be there";
  EXPECT_TRUE(contains(obstacles[1].outline, {9.2, 1.6}));
  EXPECT_FALSE(contains(obstacles[1].outline, {9.2, 3.5})) << "it would be seen";
  EXPECT_FALSE(contains(obstacles[1].outline, {9.2, -3.5}));
}

}  // namespace
}  // namespace pi_detect
