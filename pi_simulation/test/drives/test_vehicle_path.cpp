#include "drives/vehicle_path.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_slam/spline_trajectory.h>

#include <cmath>

using namespace pi_simulation;
using pi_node::test_support::messageOf;

namespace
{

class Shapes : public testing::TestWithParam<PathShape>
{
};

TEST_P(Shapes, IsDrivenAsAVehicleWould)
{
  VehiclePathOptions options;
  options.shape = GetParam();
  options.duration_s = 60.0;
  options.end_standstill_s = 2.0;
  const pi_slam::SplineTrajectory drive = pi_slam::SplineTrajectory::fit(makeVehiclePath(options));
  EXPECT_NEAR(1e-9 * static_cast<double>(drive.endNs() - drive.startNs()), 60.0, 0.021);
  double fastest = 0.0;
  for (double t = 0.0; t < 59.9; t += 0.05)
  {
    const auto state = drive.atSeconds(t);
    const Eigen::Vector3d v_body = state.T_world_body.linear().transpose() * state.v_world;
    fastest = std::max(fastest, state.v_world.norm());
    EXPECT_GT(v_body.x(), -0.02) << t;
    EXPECT_LT(std::abs(v_body.y()), 0.12) << t;  // no skidding
    EXPECT_LT(state.a_world.norm(), 4.0) << t;   // bumps included
    EXPECT_LT(state.w_body.norm(), 1.5) << t;
    if (t < 1.7 || t > 58.4)
    {
      EXPECT_LT(state.v_world.norm(), 0.01) << t;
    }
  }
  EXPECT_NEAR(fastest, 3.0, 0.25);
}

INSTANTIATE_TEST_SUITE_P(VehiclePath, Shapes,
                         testing::Values(PathShape::CAMPUS_LOOP, PathShape::HALL_LOOP, PathShape::STRAIGHT,
                                         PathShape::FIGURE_EIGHT));

TEST(VehiclePath, StopsOnTheWay)
{
  VehiclePathOptions options;
  options.shape = PathShape::STRAIGHT;
  options.duration_s = 40.0;
  options.start_standstill_s = 0.0;
  options.stops = 2;
  const pi_slam::SplineTrajectory drive = pi_slam::SplineTrajectory::fit(makeVehiclePath(options));
  int standing = 0;
  for (double t = 1.0; t < 38.0; t += 0.1)
  {
    standing += drive.atSeconds(t).v_world.norm() < 0.01 ? 1 : 0;
  }
  EXPECT_NEAR(standing, 60, 12);  // two stops of 3 s; the last hand's breadth is slow
}

TEST(VehiclePath, ComesBackToTheSamePlaceEveryRound)
{
  const std::vector<Eigen::Vector2d> line = pathLine(PathShape::CAMPUS_LOOP, 0.0);
  EXPECT_LT((line.front() - line.back()).norm(), 0.5);
  for (size_t i = 1; i < line.size(); ++i)
  {
    EXPECT_NEAR((line[i] - line[i - 1]).norm(), 0.25, 0.01);
  }
}

TEST(VehiclePath, RoundsEndWhereTheyBeganAtRest)
{
  for (const PathShape shape : {PathShape::CAMPUS_LOOP, PathShape::HALL_LOOP, PathShape::FIGURE_EIGHT})
  {
    VehiclePathOptions options;
    options.shape = shape;
    options.rounds = 1;
    options.end_standstill_s = 1.0;
    const std::vector<pi_slam::StampedPose> one = makeVehiclePath(options);
    const Eigen::Isometry3d change = one.front().T_world_body.inverse() * one.back().T_world_body;
    EXPECT_LT(change.translation().norm(), 1e-3);
    EXPECT_LT(Eigen::AngleAxisd(change.linear()).angle(), 1e-3);
    const Eigen::Isometry3d& still = one[one.size() - 45].T_world_body;  // 0.9 s before the end
    EXPECT_LT((still.translation() - one.back().T_world_body.translation()).norm(), 1e-3);
    options.rounds = 2;
    EXPECT_GT(makeVehiclePath(options).size(), one.size() * 3 / 2);
  }
}

TEST(VehiclePath, RefusesOptionsOutOfRangeByName)
{
  VehiclePathOptions options;
  options.speed = 0.0;
  EXPECT_EQ(messageOf<std::invalid_argument>([&] { makeVehiclePath(options); }),
            "path: speed = 0.000000, must be in [0.1, 30] m/s");
  options = VehiclePathOptions();
  options.shape = PathShape::STRAIGHT;
  options.rounds = 1;
  EXPECT_EQ(messageOf<std::invalid_argument>([&] { makeVehiclePath(options); }),
            "path: rounds = 1.000000, must be 0 on a path that is not closed");
  options = VehiclePathOptions();
  options.stops = 100;
  EXPECT_NE(messageOf<std::invalid_argument>([&] { makeVehiclePath(options); }).find("duration_s"), std::string::npos);
  EXPECT_NE(messageOf<std::invalid_argument>([] { parsePathShape("moon"); }).find("known: campus_loop"),
            std::string::npos);
}

}  // namespace
