#include "decision/route.h"

#include "decision/path_follower.h"
#include "decision/speed_governor.h"

#include <gtest/gtest.h>
#include <pi_node/yaml_section.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

namespace
{

using namespace pi_vehicle;

double largestCut(const Path& path, const std::vector<Eigen::Vector2d>& waypoints)
{
  double largest = 0.0;
  for (const Eigen::Vector2d& p : waypoints)
  {
    largest = std::max(largest, (path.at(path.project({p.x(), p.y(), 0.0}).s).pose().position() - p).norm());
  }
  return largest;
}

const double LIMIT = 1.0 / RouteOptions().min_radius;

double largestCurvatureStep(const Path& path)
{
  double largest = 0.0;
  for (size_t i = 1; i < path.points().size(); ++i)
  {
    largest = std::max(largest, std::abs(path.points()[i].curvature - path.points()[i - 1].curvature));
  }
  return largest;
}

TEST(Route, RoundsCornersWithinTheCorridorWithLimitedCurvature)
{
  const RouteRequest request{{{0, 0}, {20, 0}, {20, 20}, {0, 30}}, {}, {}, false};
  const RouteResult result = planRoute(request);
  ASSERT_TRUE(result.path) << result.problem;
  EXPECT_LE(result.max_curvature, LIMIT);
  EXPECT_LE(largestCut(*result.path, request.points), RouteOptions().corridor);
  EXPECT_LT(largestCurvatureStep(*result.path), 0.06) << "an arc without transition would jump by 0.33";
  const auto& points = result.path->points();
  EXPECT_NEAR((points.front().pose().position() - Eigen::Vector2d(0, 0)).norm(), 0.0, 1e-9);
  EXPECT_NEAR((points.back().pose().position() - Eigen::Vector2d(0, 30)).norm(), 0.0, 1e-9);
}

TEST(Route, ReachesAGoalPoseFromAStartPose)
{
  for (const double start : {0.0, 2.0, -3.0})
  {
    for (const double goal : {0.0, 1.5, -1.5, 3.1})
    {
      for (const double distance : {1.0, 6.0, 30.0})
      {
        const RouteResult result = planRoute({{{0, 0}, {distance, 1.0}}, start, goal, false});
        ASSERT_TRUE(result.path) << result.problem << " " << start << " " << goal << " " << distance;
        EXPECT_LE(result.max_curvature, LIMIT);
        EXPECT_NEAR(wrapAngle(result.path->points().front().heading - start), 0.0, 0.05);
        EXPECT_NEAR(wrapAngle(result.path->points().back().heading - goal), 0.0, 0.05);
      }
    }
  }
}

TEST(Route, TurnsOutAndInOverWaypoints)
{
  const RouteResult result = planRoute({{{0, 0}, {20, 0}, {20, 20}}, M_PI, 0.0, false});
  ASSERT_TRUE(result.path) << result.problem;
  EXPECT_LE(result.max_curvature, LIMIT);
  EXPECT_NEAR(std::abs(result.path->points().front().heading), M_PI, 0.05);
  EXPECT_NEAR(result.path->points().back().heading, 0.0, 0.05);
}

TEST(Route, GoesRoundALoop)
{
  const RouteResult result = planRoute({{{0, 0}, {20, 0}, {20, 15}, {0, 15}, {0, 0}}, {}, {}, true});
  ASSERT_TRUE(result.path) << result.problem;
  EXPECT_TRUE(result.path->closed());
  EXPECT_LE(result.max_curvature, LIMIT);
  EXPECT_NEAR(result.path->length(), 70.0 - 8.0 * 3.0 + 2.0 * M_PI * 3.0, 0.3) << "four quarter circles of 3 m";
}

TEST(Route, SaysWhyThereIsNone)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(planRoute({{{0, 0}, {10, 0}, {0, 0.5}}, {}, {}, false}).problem.find("waypoint 1: a turn of 177 deg"), 0U);
  EXPECT_EQ(planRoute({{{0, 0}, {10, 0}, {10, 2}, {0, 2}}, {}, {}, false}).problem.find("waypoint 1: a turn of 90 deg"),
            0U);
  EXPECT_EQ(planRoute({{{0, 0}, {0, 0.01}}, {}, {}, false}).problem,
            "the route has 1 different points, must have 2 to 1000");
  EXPECT_FALSE(planRoute({{{0, 0}, {nan, 0}}, {}, {}, false}).path);
  EXPECT_FALSE(planRoute({{{0, 0}, {5, 0}}, nan, {}, false}).path);
  EXPECT_FALSE(planRoute({{{0, 0}, {9, 0}, {9, 9}}, 1.0, {}, true}).path);
  EXPECT_FALSE(planRoute({{}, {}, {}, false}).path);
}

TEST(Route, RandomRoutesKeepTheLimitsOrSayWhyNot)
{
  int planned = 0;
  for (unsigned seed = 1; seed <= 300; ++seed)
  {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> place(-30.0, 30.0);
    std::uniform_real_distribution<double> angle(-M_PI, M_PI);
    RouteRequest request;
    for (unsigned i = 0; i < 2 + seed % 3; ++i)
    {
      request.points.emplace_back(place(random), place(random));
    }
    request.start_heading = angle(random);
    request.goal_heading = angle(random);
    const RouteResult result = planRoute(request);
    ASSERT_NE(result.path.has_value(), !result.problem.empty());
    EXPECT_TRUE(result.path || result.problem.rfind("waypoint ", 0) == 0) << result.problem;
    if (result.path)
    {
      ++planned;
      EXPECT_LE(result.max_curvature, LIMIT);
      if (request.points.size() > 2)
      {
        EXPECT_LE(largestCut(*result.path, request.points), RouteOptions().corridor + 0.1) << seed;
      }
    }
  }
  EXPECT_GT(planned, 120) << "every third has no corner; most corners of random triangles are too sharp";
}

TEST(Route, RejoinsFromBesideAndFacingAway)
{
  const RouteResult route = planRoute({{{0, 0}, {40, 0}}, {}, {}, false});
  for (const Pose2& pose : {Pose2{5, 3, 0}, Pose2{5, -4, 2.0}, Pose2{5, 0.5, M_PI}})
  {
    const RouteResult result = rejoinRoute(*route.path, pose);
    ASSERT_TRUE(result.path) << result.problem;
    EXPECT_LE(result.max_curvature, LIMIT);
    EXPECT_NEAR((result.path->points().front().pose().position() - pose.position()).norm(), 0.0, 1e-6);
    EXPECT_NEAR(wrapAngle(result.path->points().front().heading - pose.heading), 0.0, 0.05);
    EXPECT_NEAR(result.path->points().back().x, 40.0, 1e-6);
  }
  EXPECT_FALSE(rejoinRoute(Path(), Pose2()).path);
}

TEST(Dubins, HasTheKnownLengths)
{
  EXPECT_NEAR(dubins({0, 0, 0}, {10, 0, 0}, 2.0, 0.1, nullptr), 10.0, 1e-6);
  EXPECT_NEAR(dubins({0, 0, 0}, {0, 4, M_PI}, 2.0, 0.1, nullptr), 2.0 * M_PI, 1e-6) << "half a circle";
  EXPECT_NEAR(dubins({0, 0, 0}, {4, 4, 0.5 * M_PI}, 2.0, 0.1, nullptr), 2.0 * std::sqrt(2.0) + M_PI, 1e-6);
}

template <typename Options>
void expectDefaults(pi_node::YamlSection section)
{
  Options file;
  visitFields(file, [](const char*, auto& value) { value = -1.0; });
  section.readFields(&file);
  const Options code;
  std::vector<double> left;
  visitFields(file, [&left](const char*, double value) { left.push_back(value); });
  std::vector<double> right;
  visitFields(code, [&right](const char*, double value) { right.push_back(value); });
  EXPECT_EQ(left, right);
}

TEST(NavigationYaml, FileAndCodeAreEqual)
{
  pi_node::YamlSection file = pi_node::YamlSection::load(CONFIG_DIR "/navigation.yaml");
  expectDefaults<RouteOptions>(file.section("route"));
  expectDefaults<PathFollowerOptions>(file.section("follower"));
  expectDefaults<SpeedGovernorOptions>(file.section("governor"));  // test_navigation_ros_options.cpp has the rest
  RouteOptions options;
  options.min_radius = -1.0;
  EXPECT_THROW(planRoute({}, options), std::invalid_argument);
}

}  // namespace
