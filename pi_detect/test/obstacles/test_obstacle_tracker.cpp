#include <gtest/gtest.h>
#include <pi_detect/obstacle_tracker.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "obstacles/stereo_on_mast.h"

namespace pi_detect
{
namespace
{

constexpr int64_t SECOND_NS = 1000000000;
constexpr int64_t STEP_NS = SECOND_NS / 10;
constexpr double STEP_S = 0.1;
constexpr int64_t IN_VIEW_NS = 2 * SECOND_NS / 5;  // after which it has to be known that something crosses

/// A thing 0.6 m wide and 1.6 m high, its near side at x, y of base_link.
ObstacleMeasurement makeMeasurement(double x, double y, double noise_m = 0.05)
{
  ObstacleMeasurement measurement;
  measurement.min << x, y - 0.3, 0.1;
  measurement.max << x + 0.4, y + 0.3, 1.7;
  measurement.nearest << x, y, 0.9;
  measurement.covariance = noise_m * noise_m * Eigen::Matrix3d::Identity();
  const StereoGeometry geometry = makeGeometry();
  const auto column = [&](double side) { return static_cast<float>(geometry.cx - geometry.fx * side / x); };
  const auto row = [&](double z) { return static_cast<float>(geometry.cy - geometry.fy * (z - 1.0) / x); };
  measurement.box = {column(y + 0.3), row(1.7), column(y - 0.3), row(0.1)};
  measurement.points = 400;
  return measurement;
}

class Drive
{
public:
  explicit Drive(const ObstacleTrackerOptions& options = ObstacleTrackerOptions()) : tracker_(options) {}

  std::vector<Obstacle> step(const std::vector<ObstacleMeasurement>& measurements,
                             const std::vector<ObjectTrack>& tracks = {})
  {
    stamp_ns += STEP_NS;
    return at(stamp_ns, measurements, tracks);
  }

  std::vector<Obstacle> at(int64_t time_ns, const std::vector<ObstacleMeasurement>& measurements,
                           const std::vector<ObjectTrack>& tracks = {})
  {
    return tracker_.update(time_ns, vehicle, measurements, tracks, makeGeometry(), makeMounting());
  }

  int64_t stamp_ns = 100 * SECOND_NS;
  VehicleState vehicle;

private:
  ObstacleTracker tracker_;
};

TEST(ObstacleTracker, ReportsAnObstacleAfterTheWantedNumberOfMeasurements)
{
  Drive drive;
  EXPECT_TRUE(drive.step({makeMeasurement(6.0, 0.0)}).empty());
  EXPECT_TRUE(drive.step({makeMeasurement(6.0, 0.0)}).empty());
  const auto obstacles = drive.step({makeMeasurement(6.0, 0.0)});
  ASSERT_EQ(obstacles.size(), 1U);
  EXPECT_EQ(obstacles[0].id, 1);
  EXPECT_NEAR(obstacles[0].distance_m, 6.0, 0.05);
  EXPECT_NEAR(obstacles[0].position.x(), 6.2, 0.05);
  EXPECT_NEAR(obstacles[0].size.y(), 0.6, 0.05);
  EXPECT_EQ(obstacles[0].first_seen_ns, drive.stamp_ns - 2 * STEP_NS);
  EXPECT_EQ(obstacles[0].last_seen_ns, drive.stamp_ns);
}

TEST(ObstacleTracker, GivesAStandingObstacleNoVelocityWhileTheVehicleDrives)
{
  Drive drive;
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 0.05);
  drive.vehicle.velocity.x() = 3.0;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 20; ++i)
  {
    drive.vehicle.T_odom_base.translation().x() = 3.0 * STEP_S * i;
    const double x = 12.0 - 3.0 * STEP_S * i + noise(random);
    obstacles = drive.step({makeMeasurement(x, 1.5 + noise(random))});
    for (const Obstacle& obstacle : obstacles)
    {
      EXPECT_FALSE(obstacle.moving) << "picture " << i;
    }
  }
  ASSERT_EQ(obstacles.size(), 1U);
  EXPECT_EQ(obstacles[0].id, 1);
  EXPECT_LT(obstacles[0].velocity.norm(), 0.3);
}

TEST(ObstacleTracker, MeasuresTheVelocityOfWhatCrosses)
{
  Drive drive;
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0.0, 0.04);
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 25; ++i)
  {
    const double x = 8.0 + noise(random);
    obstacles = drive.step({makeMeasurement(x, -2.0 + 1.4 * STEP_S * i + noise(random))});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  EXPECT_TRUE(obstacles[0].moving);
  EXPECT_NEAR(obstacles[0].velocity.x(), 0.0, 0.3);
  EXPECT_NEAR(obstacles[0].velocity.y(), 1.4, 0.3);
}

TEST(ObstacleTracker, TurnsVelocitiesIntoTheAxesOfTheVehicle)
{
  Drive drive;
  // The vehicle looks along y of odom; the obstacle goes along -x of odom, that is to the vehicle's left.
  drive.vehicle.T_odom_base.linear() = Eigen::AngleAxisd(M_PI_2, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 25; ++i)
  {
    obstacles = drive.step({makeMeasurement(8.0, -1.5 + STEP_S * i)});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  EXPECT_NEAR(obstacles[0].velocity.y(), 1.0, 0.1);
  EXPECT_NEAR(obstacles[0].position.y(), -1.5 + STEP_S * 24, 0.1);
}

TEST(ObstacleTracker, KnowsWhenTheVehicleReachesWhatStandsBeforeIt)
{
  Drive drive;
  drive.vehicle.velocity.x() = 2.0;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 10; ++i)
  {
    drive.vehicle.T_odom_base.translation().x() = 2.0 * STEP_S * i;
    obstacles =
        drive.step({makeMeasurement(9.0 - 2.0 * STEP_S * i, 0.0), makeMeasurement(9.0 - 2.0 * STEP_S * i, 4.0)});
  }
  ASSERT_EQ(obstacles.size(), 2U);
  // Its near side is at 7.2 m, the vehicle's front at 1 m: 6.2 m at 2 m/s.
  EXPECT_NEAR(obstacles[0].time_to_collision_s, 3.1, 0.05);
  EXPECT_TRUE(std::isinf(obstacles[1].time_to_collision_s)) << "it is passed at the side";
}

TEST(ObstacleTracker, KnowsWhenWhatComesReachesTheVehicle)
{
  Drive drive;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 20; ++i)
  {
    obstacles = drive.step({makeMeasurement(15.0 - 4.0 * STEP_S * i, 0.0)});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  ASSERT_TRUE(obstacles[0].moving);
  // 15 - 7.6 - 1 m at 4 m/s.
  EXPECT_NEAR(obstacles[0].time_to_collision_s, 1.6, 0.2);
}

TEST(ObstacleTracker, RemembersForAWhileWhatLeftTheView)
{
  ObstacleTrackerOptions options;
  Drive drive(options);
  for (int i = 0; i < 5; ++i)
  {
    drive.step({makeMeasurement(3.0, 2.0)});
  }
  // The vehicle drives past: the obstacle is beside it now.
  drive.vehicle.T_odom_base.translation().x() = 3.0;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 20; ++i)
  {
    obstacles = drive.step({});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  EXPECT_NEAR(obstacles[0].position.x(), 0.2, 0.1);
  EXPECT_NEAR(obstacles[0].position.y(), 2.0, 0.1);
  EXPECT_EQ(drive.stamp_ns - obstacles[0].last_seen_ns, 2 * SECOND_NS);
  for (int i = 0; i < 20; ++i)
  {
    obstacles = drive.step({});
  }
  EXPECT_TRUE(obstacles.empty()) << "after memory_s";
}

TEST(ObstacleTracker, LeavesWhereItWasWhatIsNotKnownToMove)
{
  Drive drive;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 5; ++i)
  {
    // What of a parked car is seen shifts while it is passed: too short for a motion, but the filter has a velocity.
    obstacles = drive.step({makeMeasurement(3.0, 2.0 - 0.08 * i)});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  ASSERT_FALSE(obstacles[0].moving);
  ASSERT_LT(obstacles[0].velocity.y(), -0.4);
  const double y = obstacles[0].position.y();
  drive.vehicle.T_odom_base.translation().x() = 3.0;
  for (int i = 0; i < 30; ++i)
  {
    obstacles = drive.step({});
    ASSERT_EQ(obstacles.size(), 1U) << "picture " << i;
    EXPECT_NEAR(obstacles[0].position.x(), 0.2, 0.3) << "picture " << i;
    EXPECT_NEAR(obstacles[0].position.y(), y, 0.3) << "picture " << i;
    EXPECT_FALSE(obstacles[0].moving);
  }
}

TEST(ObstacleTracker, GoesOnWithWhatMovesWhileItIsNotSeen)
{
  Drive drive;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 25; ++i)
  {
    obstacles = drive.step({makeMeasurement(8.0, -2.0 + 1.4 * STEP_S * i)});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  ASSERT_TRUE(obstacles[0].moving);
  for (int i = 25; i < 30; ++i)
  {
    obstacles = drive.step({});
    ASSERT_EQ(obstacles.size(), 1U);
    EXPECT_TRUE(obstacles[0].moving) << "picture " << i;
    EXPECT_NEAR(obstacles[0].position.y(), -2.0 + 1.4 * STEP_S * i, 0.3);
  }
  obstacles = drive.step({makeMeasurement(8.0, -2.0 + 1.4 * STEP_S * 30)});
  ASSERT_EQ(obstacles.size(), 1U);
  EXPECT_EQ(obstacles[0].id, 1);
  EXPECT_TRUE(obstacles[0].moving);
}

/// What the picture shows of a box 1.6 m long and 1.0 m wide beside the way, as the vehicle comes nearer.
std::optional<ObstacleMeasurement> seeBox(double near_end, double side)
{
  const StereoGeometry geometry = makeGeometry();
  const double border =
      side * geometry.fx / (geometry.width - geometry.cx);  // where it leaves the picture, on its side
  ObstacleMeasurement measurement = makeMeasurement(std::max(near_end, border), -side - 0.5);
  measurement.min << std::max(near_end, border), -side - 1.0, 0.1;
  measurement.max << near_end + 1.6, -side, 1.2;
  if (measurement.max.x() - measurement.min.x() < 0.2)
  {
    return std::nullopt;
  }
  measurement.cut_right = near_end < border;
  measurement.outline = {{measurement.min.x(), -side - 1.0},
                         {measurement.max.x(), -side - 1.0},
                         {measurement.max.x(), -side},
                         {measurement.min.x(), -side}};
  return measurement;
}

TEST(ObstacleTracker, WhatLeavesThePictureStaysWhereItStandsAndIsNotTakenForWhatComesOut)
{
  constexpr double SPEED = 2.0;
  Drive drive;
  drive.vehicle.velocity.x() = SPEED;
  std::vector<Obstacle> obstacles;
  int seen = 0;
  for (double x = 0.0; x < 8.0; x += SPEED * STEP_S)
  {
    drive.vehicle.T_odom_base.translation().x() = x;
    std::vector<ObstacleMeasurement> measurements;
    if (const auto box = seeBox(8.0 - x, 1.6))
    {
      measurements.push_back(*box);
    }
    seen += measurements.empty() ? 0 : 1;
    obstacles = drive.step(measurements);
    for (const Obstacle& obstacle : obstacles)
    {
      EXPECT_NEAR(8.8, obstacle.position.x() + x, 0.25) << "at " << x;
      EXPECT_LT(obstacle.velocity.norm(), 0.3) << "at " << x;
    }
    if (seen > 0 && measurements.empty())
    {
      break;
    }
  }
  ASSERT_EQ(1U, obstacles.size());
  const double far_end = 9.6 - drive.vehicle.T_odom_base.translation().x();
  ObstacleMeasurement child = makeMeasurement(far_end + 0.4, -1.6);
  child.min.y() = -1.8;
  child.max.y() = -1.4;
  child.max.z() = 1.1;
  for (int i = 0; i < 3; ++i)
  {
    obstacles = drive.step({child});
  }
  ASSERT_EQ(2U, obstacles.size());
  EXPECT_NE(obstacles[0].id, obstacles[1].id);
}

TEST(ObstacleTracker, TakesNoOtherThingForWhatItLostFromView)
{
  // Pieces of parked cars at the picture's side, whose velocity nobody knows: one is lost, another one comes up.
  Drive drive;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 5; ++i)
  {
    obstacles = drive.step({makeMeasurement(4.0, -4.0)});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  drive.vehicle.T_odom_base.translation().x() = 1.5;
  for (int i = 0; i < 10; ++i)
  {
    obstacles = drive.step({});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  for (int i = 0; i < 8; ++i)
  {
    obstacles = drive.step({makeMeasurement(4.0, -2.4)});
    for (const Obstacle& obstacle : obstacles)
    {
      EXPECT_FALSE(obstacle.moving) << "picture " << i << ", id " << obstacle.id;
      EXPECT_LT(obstacle.velocity.norm(), 0.2) << "picture " << i << ", id " << obstacle.id;
    }
  }
  ASSERT_EQ(obstacles.size(), 2U);
  EXPECT_EQ(std::set<int64_t>({obstacles[0].id, obstacles[1].id}), std::set<int64_t>({1, 2}));
}

TEST(ObstacleTracker, MeasuresVelocitiesAnewAfterAGap)
{
  Drive drive;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 10; ++i)
  {
    obstacles = drive.step({makeMeasurement(6.0, -1.0, 0.15)});
  }
  for (int i = 0; i < 5; ++i)
  {
    drive.step({});
  }
  // Another part of the same thing: that it is elsewhere is no motion.
  for (int i = 0; i < 10; ++i)
  {
    obstacles = drive.step({makeMeasurement(6.2, -0.6, 0.15)});
    ASSERT_EQ(obstacles.size(), 1U);
    EXPECT_EQ(obstacles[0].id, 1);
    EXPECT_FALSE(obstacles[0].moving) << "picture " << i;
    EXPECT_LT(obstacles[0].velocity.norm(), 0.1) << "picture " << i;
  }
}

TEST(ObstacleTracker, EndsWhatShouldBeSeenButIsNot)
{
  Drive drive;
  for (int i = 0; i < 5; ++i)
  {
    drive.step({makeMeasurement(6.0, 0.0)});
  }
  EXPECT_EQ(drive.step({}).size(), 1U);
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 7; ++i)
  {
    obstacles = drive.step({});
  }
  EXPECT_TRUE(obstacles.empty());
}

TEST(ObstacleTracker, RemembersWhatIsHidden)
{
  Drive drive;
  for (int i = 0; i < 5; ++i)
  {
    drive.step({makeMeasurement(8.0, 0.0)});
  }
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 10; ++i)
  {
    obstacles = drive.step({makeMeasurement(4.0, 0.0)});
  }
  ASSERT_EQ(obstacles.size(), 2U);
  EXPECT_NEAR(obstacles[1].distance_m, 8.0, 0.1);
}

ObjectTrack makeTrack(int64_t id, int class_id, const Box& box)
{
  ObjectTrack track;
  track.id = id;
  track.class_id = class_id;
  track.score = 0.8F;
  track.box = box;
  return track;
}

TEST(ObstacleTracker, TakesLabelsFromTracksAndKeepsThem)
{
  Drive drive;
  const ObstacleMeasurement person = makeMeasurement(6.0, 0.0);
  const ObstacleMeasurement behind = makeMeasurement(12.0, 0.1);
  const ObstacleMeasurement other = makeMeasurement(6.0, 3.0);
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 4; ++i)
  {
    obstacles = drive.step({person, behind, other}, {makeTrack(7, 1, person.box)});
  }
  ASSERT_EQ(obstacles.size(), 3U);
  EXPECT_EQ(obstacles[0].class_id, 1);
  EXPECT_EQ(obstacles[0].track_id, 7);
  EXPECT_FLOAT_EQ(obstacles[0].score, 0.8F);
  EXPECT_EQ(obstacles[1].class_id, -1) << "beside the track's box";
  EXPECT_EQ(obstacles[2].class_id, -1) << "in the track's box, but further away";

  obstacles = drive.step({person, behind, other});
  EXPECT_EQ(obstacles[0].class_id, 1) << "the label stays when the detector misses a picture";
  obstacles = drive.step({person, behind, other}, {makeTrack(9, 2, person.box)});
  EXPECT_EQ(obstacles[0].class_id, 2);
  EXPECT_EQ(obstacles[0].track_id, 9) << "a new track takes over";
}

/// A person 0.5 m wide as the stereo camera sees it: noise of a disparity, ends that the picture's sides cut off.
std::optional<ObstacleMeasurement> seePerson(const Eigen::Vector2d& place, std::mt19937* random)
{
  std::normal_distribution<double> noise(0.0, 1.0);
  const StereoGeometry geometry = makeGeometry();
  const double depth = place.x() + place.x() * place.x() / (geometry.fx * geometry.baseline_m) * 0.05 * noise(*random);
  const double left_side = depth * geometry.cx / geometry.fx - geometry.baseline_m;
  const double right_side = -depth * (geometry.width - geometry.cx) / geometry.fx;
  const double left = place.y() + 0.25 + 0.02 * noise(*random);
  const double right = place.y() - 0.25 + 0.02 * noise(*random);
  ObstacleMeasurement measurement = makeMeasurement(depth, 0.0);
  // As StereoObstacles says it.
  const double side_sigma = 4.0 / std::sqrt(12.0) * depth / geometry.fx;
  const double depth_sigma = 0.12 * depth * depth / (geometry.fx * geometry.baseline_m);
  const Eigen::Vector3d along = Eigen::Vector3d(place.x(), place.y(), 0.0).normalized();
  measurement.covariance =
      side_sigma * side_sigma * Eigen::Matrix3d::Identity() + depth_sigma * depth_sigma * along * along.transpose();
  measurement.max.y() = std::min(left, left_side);
  measurement.min.y() = std::max(right, right_side);
  if (measurement.max.y() - measurement.min.y() < 0.1)
  {
    return std::nullopt;
  }
  measurement.nearest.y() = 0.5 * (measurement.min.y() + measurement.max.y());
  const auto column = [&](double side) { return static_cast<float>(geometry.cx - geometry.fx * side / depth); };
  measurement.box.x1 = column(measurement.max.y());
  measurement.box.x2 = column(measurement.min.y());
  return measurement;
}

/// Person and vehicle will meet: the person keeps its bearing. Judged from 0.4 s in view on.
void crossTheWay(double speed, double side, unsigned seed)
{
  constexpr int64_t PICTURE_NS = SECOND_NS / 20;
  constexpr double VEHICLE_M_S = 3.0;
  Drive drive;
  drive.vehicle.velocity.x() = VEHICLE_M_S;
  const Eigen::Vector2d velocity(0.0, -side * speed);
  std::mt19937 random(seed);
  std::optional<int64_t> first_ns;
  int judged = 0;
  for (int64_t time_ns = -2 * SECOND_NS; time_ns < -SECOND_NS / 5; time_ns += PICTURE_NS)
  {
    const double ahead_s = -1e-9 * static_cast<double>(time_ns);
    drive.vehicle.T_odom_base.translation().x() = -VEHICLE_M_S * ahead_s;
    std::vector<ObstacleMeasurement> measurements;
    if (const auto seen = seePerson({1.0 + VEHICLE_M_S * ahead_s, side * speed * ahead_s}, &random))
    {
      measurements.push_back(*seen);
      first_ns = first_ns.value_or(time_ns);
    }
    const auto obstacles = drive.at(drive.stamp_ns + time_ns, measurements);
    if (!first_ns || time_ns - *first_ns < IN_VIEW_NS)
    {
      continue;
    }
    SCOPED_TRACE(std::to_string(ahead_s) + " s before they meet");
    ASSERT_EQ(1U, obstacles.size());
    EXPECT_TRUE(obstacles.front().moving);
    const Eigen::Vector2d measured = obstacles.front().velocity.head<2>();
    EXPECT_LT((measured - velocity).norm(), 0.5) << measured.transpose();
    EXPECT_GT(measured.normalized().dot(velocity.normalized()), std::cos(20.0 * M_PI / 180.0)) << measured.transpose();
    ++judged;
  }
  EXPECT_GT(judged, 5);
}

TEST(ObstacleTracker, KnowsInTimeThatAPersonCrossesAlsoAtThePicturesBorder)
{
  for (const double speed : {1.0, 1.4, 2.0, 2.8, 3.4, 4.0})
  {
    for (const double side : {1.0, -1.0})
    {
      for (unsigned seed = 1; seed <= 5; ++seed)
      {
        SCOPED_TRACE(std::to_string(speed) + " m/s from " + (side > 0.0 ? "left" : "right") + ", seed " +
                     std::to_string(seed));
        crossTheWay(speed, side, seed);
      }
    }
  }
}

TEST(ObstacleTracker, KnowsInTimeThatSomebodyRunsOutWhoIsSeenInPart)
{
  constexpr int64_t PICTURE_NS = SECOND_NS / 20;
  constexpr double ACCELERATION = 4.0;
  constexpr double SPEED = 2.2;
  constexpr double MOVING_SPEED = 0.5;
  int known = 0;
  for (const double side : {1.0, -1.0})
  {
    for (unsigned seed = 1; seed <= 20; ++seed)
    {
      SCOPED_TRACE("seed " + std::to_string(seed));
      Drive drive;
      std::mt19937 random(seed);
      std::vector<Obstacle> obstacles;
      for (int i = -20; i <= 10; ++i)
      {
        const double t = 0.05 * std::max(0, i);
        const double faster = std::min(t, SPEED / ACCELERATION);
        const double gone = 0.5 * ACCELERATION * faster * faster + SPEED * (t - faster);
        auto seen = seePerson({8.0, side * (4.0 - gone)}, &random);
        ASSERT_TRUE(seen);
        seen->cut_left = side > 0.0;
        seen->cut_right = side < 0.0;
        seen->outline = {{seen->min.x(), seen->min.y()},
                         {seen->max.x(), seen->min.y()},
                         {seen->max.x(), seen->max.y()},
                         {seen->min.x(), seen->max.y()}};
        obstacles = drive.at(drive.stamp_ns + i * PICTURE_NS, {*seen});
        EXPECT_FALSE(i < 0 && !obstacles.empty() && obstacles.front().moving) << "picture " << i;
      }
      known += std::any_of(obstacles.begin(), obstacles.end(),
                           [side](const Obstacle& obstacle)
                           { return obstacle.moving && side * obstacle.velocity.y() < -MOVING_SPEED; })
                   ? 1
                   : 0;
    }
  }
  EXPECT_GE(known, 36) << "of 40, after half a second";
}

/// A person beside a hedge, seen as one with it from afar, and alone from nearby.
TEST(ObstacleTracker, ForgetsTheHedgeThatAPersonWasSeenWith)
{
  constexpr int64_t PICTURE_NS = SECOND_NS / 20;
  Drive drive;
  std::vector<Obstacle> obstacles;
  ObstacleMeasurement both = makeMeasurement(8.0, -4.2);
  both.min << 8.0, -5.4, 0.1;
  both.max << 10.0, -3.0, 1.9;
  for (int i = 0; i < 20; ++i)
  {
    obstacles = drive.at(drive.stamp_ns + i * PICTURE_NS, {both});
  }
  for (int i = 0; i < 12; ++i)
  {
    obstacles = drive.at(drive.stamp_ns + (20 + i) * PICTURE_NS, {makeMeasurement(8.0, -3.3 + 0.1 * i)});
  }
  ASSERT_EQ(1U, obstacles.size());
  EXPECT_EQ(1, obstacles.front().id);
  EXPECT_TRUE(obstacles.front().moving);
  EXPECT_NEAR(0.6, obstacles.front().size.y(), 0.1);
  EXPECT_NEAR(2.0, obstacles.front().velocity.y(), 0.4);
}

TEST(ObstacleTracker, BelievesTheVelocityOfWhatJustAppearedOnlyIfItHasAClass)
{
  constexpr int64_t PICTURE_NS = 50000000;
  constexpr double SPEED = 3.0;
  const auto pictureOfMotion = [](bool labelled)
  {
    Drive drive;
    for (int i = 0; i < 20; ++i)
    {
      const ObstacleMeasurement measurement = makeMeasurement(7.0, -1.5 + SPEED * 0.05 * i, 0.02);
      const auto tracks =
          labelled ? std::vector<ObjectTrack>{makeTrack(7, 1, measurement.box)} : std::vector<ObjectTrack>();
      const auto obstacles = drive.at(drive.stamp_ns + i * PICTURE_NS, {measurement}, tracks);
      if (!obstacles.empty() && obstacles[0].moving)
      {
        return i;
      }
    }
    return 20;
  };
  EXPECT_LT(pictureOfMotion(true), 6);
  EXPECT_GE(pictureOfMotion(false), 6) << "0.2 s, and two pictures";
  EXPECT_LT(pictureOfMotion(false), 14);
}

TEST(ObstacleTracker, GoesOnWithWhatMovedAsLongAsCrossingTheWayTakes)
{
  Drive drive;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 10; ++i)
  {
    obstacles = drive.step({makeMeasurement(8.0, -2.0 + 1.4 * STEP_S * i, 0.02)});
  }
  ASSERT_EQ(obstacles.size(), 1U);
  ASSERT_TRUE(obstacles[0].moving);
  // A wall before it hides it.
  ObstacleMeasurement wall = makeMeasurement(4.0, 0.0, 0.02);
  wall.min.y() = -4.0;
  wall.max.y() = 4.0;
  wall.box = {0.0F, 0.0F, 640.0F, 400.0F};
  std::vector<double> seen_at;
  for (int i = 0; i < 22; ++i)
  {
    for (const Obstacle& obstacle : drive.step({wall}))
    {
      if (obstacle.id == obstacles[0].id)
      {
        seen_at.push_back(obstacle.position.y());
      }
    }
  }
  ASSERT_EQ(seen_at.size(), 22U) << "it is remembered";
  EXPECT_NEAR(seen_at[13] - seen_at[0], 13 * 1.4 * STEP_S, 0.3) << "1.5 s, though it was followed for 0.9 s";
  EXPECT_DOUBLE_EQ(seen_at[21], seen_at[17]);
}

TEST(ObstacleTracker, LeavesOutStampsThatAreNotNewer)
{
  Drive drive;
  for (int i = 0; i < 4; ++i)
  {
    drive.step({makeMeasurement(6.0, 0.0)});
  }
  const auto obstacles = drive.at(drive.stamp_ns - STEP_NS, {makeMeasurement(3.0, 0.0)});
  ASSERT_EQ(obstacles.size(), 1U);
  EXPECT_NEAR(obstacles[0].distance_m, 6.0, 0.05);
  EXPECT_EQ(drive.at(drive.stamp_ns, {}).size(), 1U);
}

TEST(ObstacleTracker, BeginsAnewWhenTimeGoesBackAndUsesNoIdAgain)
{
  Drive drive;
  std::set<int64_t> before;
  for (int i = 0; i < 4; ++i)
  {
    for (const Obstacle& obstacle : drive.step({makeMeasurement(6.0, 0.0), makeMeasurement(6.0, 3.0)}))
    {
      before.insert(obstacle.id);
    }
  }
  ASSERT_EQ(before.size(), 2U);
  drive.stamp_ns -= 50 * SECOND_NS;
  EXPECT_TRUE(drive.step({makeMeasurement(6.0, 0.0)}).empty());
  drive.step({makeMeasurement(6.0, 0.0)});
  const auto obstacles = drive.step({makeMeasurement(6.0, 0.0)});
  ASSERT_EQ(obstacles.size(), 1U);
  EXPECT_EQ(before.count(obstacles[0].id), 0U);
}

TEST(ObstacleTracker, SortsByDistance)
{
  Drive drive;
  std::vector<Obstacle> obstacles;
  for (int i = 0; i < 4; ++i)
  {
    obstacles = drive.step({makeMeasurement(9.0, 1.0), makeMeasurement(4.0, -1.0), makeMeasurement(6.0, 2.0)});
  }
  ASSERT_EQ(obstacles.size(), 3U);
  EXPECT_LT(obstacles[0].distance_m, obstacles[1].distance_m);
  EXPECT_LT(obstacles[1].distance_m, obstacles[2].distance_m);
}

TEST(ObstacleTracker, RefusesOptionsOutOfRange)
{
  ObstacleTrackerOptions options;
  options.memory_s = -1.0;
  try
  {
    ObstacleTracker tracker(options);
    FAIL() << "memory_s = -1 was accepted";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(), "memory_s = -1, must be in [0, 600]");
  }
  options = ObstacleTrackerOptions();
  options.confirm_hits = 0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = ObstacleTrackerOptions();
  options.footprint.half_width = std::nan("");
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

TEST(TimeToCollision, FollowsFromTheGapAndTheSpeed)
{
  ObstacleTrackerOptions options;
  options.footprint.front = 1.0;
  options.footprint.rear = 0.5;
  options.footprint.half_width = 0.6;
  const Eigen::Vector2d half(0.5, 0.4);
  // From ahead: 10 - 1 - 0.5 m at 2 m/s.
  EXPECT_NEAR(timeToCollision({10.0, 0.0}, {-2.0, 0.0}, half, options), 4.25, 1e-9);
  // From behind: 10 - 0.5 - 0.5 m at 3 m/s.
  EXPECT_NEAR(timeToCollision({-10.0, 0.9}, {3.0, 0.0}, half, options), 3.0, 1e-9);
  // From the side: 5 - 0.6 - 0.4 m at 1 m/s.
  EXPECT_NEAR(timeToCollision({0.5, 5.0}, {0.0, -1.0}, half, options), 4.0, 1e-9);
}

TEST(TimeToCollision, IsInfiniteForWhatPassesOrLeaves)
{
  const ObstacleTrackerOptions options;
  const Eigen::Vector2d half(0.5, 0.4);
  EXPECT_TRUE(std::isinf(timeToCollision({10.0, 1.1}, {-2.0, 0.0}, half, options))) << "passes 0.1 m beside";
  EXPECT_TRUE(std::isinf(timeToCollision({10.0, 0.0}, {2.0, 0.0}, half, options))) << "leaves";
  EXPECT_TRUE(std::isinf(timeToCollision({10.0, 0.0}, {0.0, 0.0}, half, options))) << "stands";
  EXPECT_TRUE(std::isinf(timeToCollision({10.0, 5.0}, {-4.0, -0.5}, half, options))) << "crosses behind";
}

TEST(TimeToCollision, IsZeroInsideTheOutline)
{
  const ObstacleTrackerOptions options;
  EXPECT_EQ(timeToCollision({0.9, 0.3}, {0.0, 0.0}, {0.1, 0.1}, options), 0.0);
  EXPECT_EQ(timeToCollision({1.3, 0.0}, {5.0, 0.0}, {0.5, 0.1}, options), 0.0);
}

}  // namespace
}  // namespace pi_detect
