#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "policies/residence.h"

namespace
{

using namespace pi_offload;

constexpr double TOLERANCE_S = 1e-4;
constexpr double NEVER = std::numeric_limits<double>::infinity();
constexpr double SPEED = 3.0;
constexpr double RANGE = 100.0;
const Point NODE{0.0, 0.0};

double radians(double degrees)
{
  return degrees * M_PI / 180.0;
}

Residence straight(double x, double y, double degrees, double speed = SPEED)
{
  return straightResidence({x, y}, radians(degrees), speed, NODE, RANGE);
}

Residence along(const Point& vehicle, const std::vector<Point>& route, double speed = SPEED)
{
  return routeResidence(vehicle, route, speed, NODE, RANGE);
}

struct Inside
{
  double x, y, degrees, seconds;
};

TEST(StraightResidence, InsideItLastsUntilTheVehicleLeaves)  // vectors 1 to 4, 9, 10
{
  for (const Inside& example :
       {Inside{0.0, 0.0, 0.0, 33.3333}, Inside{60.0, 0.0, 90.0, 13.3333}, Inside{60.0, 0.0, -90.0, 53.3333},
        Inside{30.0, 40.0, 30.0, 16.7267}, Inside{100.0, 0.0, 90.0, 0.0}, Inside{100.0, 0.0, -90.0, 66.6667}})
  {
    const Residence residence = straight(example.x, example.y, example.degrees);
    EXPECT_NEAR(residence.now_s, example.seconds, TOLERANCE_S) << example.x << ", " << example.y;
    EXPECT_EQ(residence.enters_s, 0.0);
    EXPECT_EQ(residence.leaves_s, residence.now_s);
    EXPECT_NEAR(residence.window_s(), example.seconds, TOLERANCE_S);
    EXPECT_NEAR(printedResidence({example.x, example.y}, radians(example.degrees), SPEED, NODE, RANGE), example.seconds,
                TOLERANCE_S);
  }
}

TEST(StraightResidence, HeadingIsFromTheYAxisClockwise)  // vector 4, with the axes mixed up
{
  EXPECT_NEAR(straight(30.0, 40.0, 90.0 - 30.0).now_s, 17.3571, TOLERANCE_S);
  EXPECT_NEAR(straightResidence({30.0, 40.0}, headingOfYaw(radians(60.0)), SPEED, NODE, RANGE).now_s, 16.7267,
              TOLERANCE_S);
  EXPECT_NEAR(headingOfYaw(0.0), radians(90.0), 1e-12) << "+X is east";
  EXPECT_NEAR(headingOfYaw(radians(90.0)), 0.0, 1e-12) << "+Y is north";
}

TEST(StraightResidence, ANodeAheadIsUsableLater)  // vector 5
{
  const Residence residence = straight(-150.0, 60.0, 90.0);
  EXPECT_EQ(residence.now_s, 0.0);
  EXPECT_NEAR(residence.enters_s, 23.3333, TOLERANCE_S);
  EXPECT_NEAR(residence.leaves_s, 76.6667, TOLERANCE_S);
  EXPECT_NEAR(residence.window_s(), 53.3333, TOLERANCE_S);
  EXPECT_NEAR(printedResidence({-150.0, 60.0}, radians(90.0), SPEED, NODE, RANGE), 76.6667, TOLERANCE_S)
      << "equation 8 as printed takes it for the best node of all";
}

TEST(StraightResidence, BehindMissedAndTouchedNodesHaveNoWindow)  // vectors 6 to 8
{
  for (const Point& vehicle : {Point{150.0, 0.0}, Point{-150.0, 120.0}, Point{-150.0, 100.0}})
  {
    const Residence residence = straight(vehicle.x, vehicle.y, 90.0);
    EXPECT_EQ(residence.now_s, 0.0) << vehicle.x << ", " << vehicle.y;
    EXPECT_EQ(residence.enters_s, NEVER);
    EXPECT_EQ(residence.leaves_s, 0.0);
    EXPECT_EQ(residence.window_s(), 0.0);
    EXPECT_EQ(printedResidence(vehicle, radians(90.0), SPEED, NODE, RANGE), 0.0);
  }
}

TEST(StraightResidence, AStandingVehicleStaysWhereItIs)  // vectors 11 and 12
{
  const Residence inside = straight(10.0, 0.0, 0.0, 0.0);
  EXPECT_EQ(inside.now_s, NEVER);
  EXPECT_EQ(inside.enters_s, 0.0);
  EXPECT_EQ(inside.leaves_s, NEVER);
  const Residence outside = straight(200.0, 0.0, 0.0, 0.0);
  EXPECT_EQ(outside.now_s, 0.0);
  EXPECT_EQ(outside.enters_s, NEVER);
  EXPECT_EQ(outside.window_s(), 0.0);
  EXPECT_EQ(printedResidence({10.0, 0.0}, 0.0, 0.0, NODE, RANGE), 0.0) << "equation 8 has no solution";
}

TEST(StraightResidence, IsExactFarFromTheOriginAndAtTheEdge)
{
  // c = |d|^2 - R^2 would have no digits left here.
  const Point node{4e6, 5e6};
  const Residence residence = straightResidence({4e6 + 100.0 - 1e-6, 5e6}, radians(90.0), 1.0, node, RANGE);
  EXPECT_NEAR(residence.now_s, 1e-6, 1e-8);
}

TEST(StraightResidence, ANodeOfInfiniteRangeIsAlwaysUsable)
{
  const Residence residence = straightResidence({1e5, 0.0}, 0.0, SPEED, NODE, NEVER);
  EXPECT_EQ(residence.now_s, NEVER);
  EXPECT_EQ(residence.enters_s, 0.0);
  EXPECT_EQ(routeResidence({1e5, 0.0}, {{0.0, 0.0}}, SPEED, NODE, NEVER).now_s, NEVER);
  EXPECT_EQ(printedResidence({1e5, 0.0}, 0.0, SPEED, NODE, NEVER), NEVER);
}

TEST(StraightResidence, ANodeWithoutRangeIsNeverUsable)
{
  EXPECT_EQ(straightResidence({-3.0, 0.0}, radians(90.0), SPEED, NODE, 0.0).window_s(), 0.0);
}

TEST(StraightResidence, RefusesWhatIsNotANumber)
{
  EXPECT_THROW(straightResidence({std::nan(""), 0.0}, 0.0, SPEED, NODE, RANGE), std::invalid_argument);
  EXPECT_THROW(straightResidence({0.0, 0.0}, 0.0, SPEED, {0.0, NEVER}, RANGE), std::invalid_argument);
  EXPECT_THROW(straightResidence({0.0, 0.0}, NEVER, SPEED, NODE, RANGE), std::invalid_argument);
  EXPECT_THROW(straightResidence({0.0, 0.0}, 0.0, -1.0, NODE, RANGE), std::invalid_argument);
  EXPECT_THROW(straightResidence({0.0, 0.0}, 0.0, NEVER, NODE, RANGE), std::invalid_argument);
  EXPECT_THROW(straightResidence({0.0, 0.0}, 0.0, SPEED, NODE, -1.0), std::invalid_argument);
  EXPECT_THROW(straightResidence({0.0, 0.0}, 0.0, SPEED, NODE, std::nan("")), std::invalid_argument);
  EXPECT_THROW(printedResidence({0.0, 0.0}, std::nan(""), SPEED, NODE, RANGE), std::invalid_argument);
}

TEST(RouteResidence, IsThatOfAStraightLineOnAStraightRoute)
{
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-200.0, 200.0);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  for (int i = 0; i < 1000; ++i)
  {
    const Point vehicle{place(random), place(random)};
    const double heading = angle(random);
    const Point far{vehicle.x + 2000.0 * std::sin(heading), vehicle.y + 2000.0 * std::cos(heading)};
    const Residence expected = straightResidence(vehicle, heading, SPEED, NODE, RANGE);
    const Residence found = along(vehicle, {vehicle, far});
    EXPECT_NEAR(found.now_s, expected.now_s, 1e-6);
    EXPECT_NEAR(found.leaves_s, expected.leaves_s, 1e-6);
    if (std::isinf(expected.enters_s))
    {
      EXPECT_EQ(found.enters_s, NEVER);
    }
    else
    {
      EXPECT_NEAR(found.enters_s, expected.enters_s, 1e-6);
    }
  }
}

TEST(RouteResidence, FollowsACorner)
{
  // 50 m east, then north: leaves at (50, 86.6025).
  const Residence residence = along({0.0, 0.0}, {{0.0, 0.0}, {50.0, 0.0}, {50.0, 300.0}});
  EXPECT_NEAR(residence.now_s, (50.0 + 86.6025) / SPEED, TOLERANCE_S);
  EXPECT_NEAR(straight(0.0, 0.0, 90.0).now_s, 33.3333, TOLERANCE_S) << "the straight line leaves earlier";
}

TEST(RouteResidence, TurnsIntoARangeThatTheStraightLineMisses)
{
  const std::vector<Point> route{{-150.0, 120.0}, {0.0, 120.0}, {0.0, -120.0}};
  EXPECT_EQ(straight(-150.0, 120.0, 90.0).window_s(), 0.0);
  const Residence residence = along(route.front(), route);
  EXPECT_EQ(residence.now_s, 0.0);
  EXPECT_NEAR(residence.enters_s, 170.0 / SPEED, TOLERANCE_S);
  EXPECT_NEAR(residence.leaves_s, 370.0 / SPEED, TOLERANCE_S);
}

TEST(RouteResidence, FirstOfSeveralWindowsIsGiven)
{
  // Through the range at y = 60, away, and back at y = 0.
  const std::vector<Point> route{{-200.0, 60.0}, {200.0, 60.0}, {200.0, 0.0}, {-200.0, 0.0}};
  const Residence first = along(route.front(), route);
  EXPECT_NEAR(first.enters_s, 120.0 / SPEED, TOLERANCE_S);
  EXPECT_NEAR(first.leaves_s, 280.0 / SPEED, TOLERANCE_S);
  const Residence second = along({150.0, 60.0}, route);
  EXPECT_NEAR(second.enters_s, (50.0 + 60.0 + 100.0) / SPEED, TOLERANCE_S);
  EXPECT_NEAR(second.window_s(), 200.0 / SPEED, TOLERANCE_S);
  const Residence leaving = along({0.0, 60.0}, route);
  EXPECT_NEAR(leaving.now_s, 80.0 / SPEED, TOLERANCE_S) << "what it has now, not the window after it";
}

TEST(RouteResidence, ATouchIsNoWindow)
{
  const std::vector<Point> route{{-200.0, 100.0}, {200.0, 100.0}, {200.0, 0.0}, {0.0, 0.0}};
  const Residence residence = along(route.front(), route);
  EXPECT_NEAR(residence.enters_s, (400.0 + 100.0 + 100.0) / SPEED, TOLERANCE_S);
  // A corner that touches the edge from outside.
  const std::vector<Point> corner{{-100.0, 100.0}, {-100.0, 0.0}, {-200.0, 0.0}};
  EXPECT_EQ(along({-100.0, 100.0}, corner).window_s(), 0.0);
}

TEST(RouteResidence, ACornerOnTheEdgeDoesNotSplitAWindow)
{
  // Goes in, turns exactly on the edge, comes back in.
  const std::vector<Point> route{{0.0, 0.0}, {60.0, 80.0}, {0.0, 0.0}, {-300.0, 0.0}};
  const Residence residence = along(route.front(), route);
  EXPECT_NEAR(residence.now_s, 300.0 / SPEED, TOLERANCE_S);
}

TEST(RouteResidence, AVehicleBesideTheRouteGoesThereFirst)
{
  const Residence residence = along({0.0, 30.0}, {{-100.0, 0.0}, {300.0, 0.0}});
  EXPECT_NEAR(residence.now_s, 130.0 / SPEED, TOLERANCE_S);
  const Residence before = along({-150.0, 0.0}, {{-120.0, 0.0}, {300.0, 0.0}});
  EXPECT_NEAR(before.enters_s, 50.0 / SPEED, TOLERANCE_S);
}

TEST(RouteResidence, TheVehicleStandsAtTheEnd)
{
  const Residence stays = along({0.0, 0.0}, {{0.0, 0.0}, {50.0, 0.0}});
  EXPECT_EQ(stays.now_s, NEVER);
  EXPECT_EQ(stays.leaves_s, NEVER);
  const Residence arrives = along({-160.0, 0.0}, {{-160.0, 0.0}, {0.0, 0.0}});
  EXPECT_EQ(arrives.now_s, 0.0);
  EXPECT_NEAR(arrives.enters_s, 60.0 / SPEED, TOLERANCE_S);
  EXPECT_EQ(arrives.leaves_s, NEVER);
  const Residence edge = along({-160.0, 0.0}, {{-160.0, 0.0}, {-100.0, 0.0}});
  EXPECT_NEAR(edge.enters_s, 60.0 / SPEED, TOLERANCE_S) << "stands on the edge, which is inside";
  EXPECT_EQ(edge.leaves_s, NEVER);
  const Residence falls_short = along({-160.0, 0.0}, {{-160.0, 0.0}, {-110.0, 0.0}});
  EXPECT_EQ(falls_short.enters_s, NEVER);
  EXPECT_EQ(falls_short.window_s(), 0.0);
  EXPECT_EQ(along({0.0, 0.0}, {{0.0, 0.0}}).now_s, NEVER) << "a route of one point";
  EXPECT_EQ(along({300.0, 0.0}, {{0.0, 0.0}}).leaves_s, NEVER);
}

TEST(RouteResidence, AStandingVehicleStaysWhereItIs)
{
  const std::vector<Point> route{{0.0, 0.0}, {500.0, 0.0}};
  EXPECT_EQ(along({0.0, 0.0}, route, 0.0).now_s, NEVER);
  EXPECT_EQ(along({200.0, 0.0}, route, 0.0).enters_s, NEVER);
}

TEST(RouteResidence, LeavesAtOnceFromTheEdge)
{
  const Residence residence = along({100.0, 0.0}, {{100.0, 0.0}, {300.0, 0.0}, {300.0, 1.0}});
  EXPECT_EQ(residence.now_s, 0.0);
  EXPECT_EQ(residence.leaves_s, 0.0);
}

TEST(RouteResidence, PointsThatRepeatDoNotMatter)
{
  const std::vector<Point> route{{0.0, 0.0}, {0.0, 0.0}, {50.0, 0.0}, {50.0, 0.0}, {50.0, 300.0}};
  EXPECT_NEAR(along({0.0, 0.0}, route).now_s, (50.0 + 86.6025) / SPEED, TOLERANCE_S);
}

TEST(RouteResidence, AgreesWithDrivingTheRouteInSmallSteps)
{
  std::mt19937 random(11);
  std::uniform_real_distribution<double> place(-250.0, 250.0);
  constexpr double STEP = 0.05;
  int windows = 0;
  for (int example = 0; example < 200; ++example)
  {
    std::vector<Point> route(7);
    for (Point& point : route)
    {
      point = {place(random), place(random)};
    }
    // Drives until the end of the first window.
    const bool inside_at_start = std::hypot(route[0].x, route[0].y) <= RANGE;
    double travelled = 0.0;
    double entered = inside_at_start ? 0.0 : NEVER;
    double left = NEVER;
    for (size_t i = 0; i + 1 < route.size() && std::isinf(left); ++i)
    {
      const double length = std::hypot(route[i + 1].x - route[i].x, route[i + 1].y - route[i].y);
      for (double s = 0.0; s < length && std::isinf(left); s += STEP)
      {
        const double x = route[i].x + (route[i + 1].x - route[i].x) * s / length;
        const double y = route[i].y + (route[i + 1].y - route[i].y) * s / length;
        const bool inside = std::hypot(x, y) <= RANGE;
        if (inside && std::isinf(entered))
        {
          entered = travelled + s;
        }
        if (!inside && !std::isinf(entered))
        {
          left = travelled + s;
        }
      }
      travelled += length;
    }
    const Residence residence = along(route[0], route);
    if (std::isinf(entered))
    {
      // The steps may have jumped over a short chord, of less than two steps.
      EXPECT_LT(residence.window_s(), 2.0 * STEP) << example;
      continue;
    }
    ++windows;
    EXPECT_NEAR(residence.enters_s * SPEED, entered, 2.0 * STEP) << example;
    if (std::isinf(left))
    {
      EXPECT_EQ(residence.leaves_s, NEVER) << example;
    }
    else
    {
      EXPECT_NEAR(residence.leaves_s * SPEED, left, 2.0 * STEP) << example;
    }
    EXPECT_EQ(residence.now_s > 0.0, inside_at_start) << example;
  }
  EXPECT_GT(windows, 100);
}

TEST(RouteResidence, RefusesWhatItCannotFollow)
{
  const std::vector<Point> route{{0.0, 0.0}, {1.0, 0.0}, {2.0, 0.0}};
  EXPECT_THROW(along({0.0, 0.0}, {}), std::invalid_argument);
  EXPECT_THROW(along({0.0, 0.0}, {{0.0, 0.0}, {std::nan(""), 0.0}}), std::invalid_argument);
  EXPECT_THROW(along({0.0, 0.0}, route, -1.0), std::invalid_argument);
  EXPECT_THROW(routeResidence({0.0, 0.0}, route, SPEED, NODE, -1.0), std::invalid_argument);
}

}  // namespace
