#include <gtest/gtest.h>
#include <pi_vehicle/decision/pose2.h>

namespace pi_vehicle
{
namespace
{

TEST(Pose2, MovesInTheClosedFormOfACircleAndALine)
{
  const Pose2 quarter = Pose2().moved(0.5 * M_PI * 4.0, 0.25);  // radius 4 m to the left
  EXPECT_NEAR(4.0, quarter.x, 1e-12);
  EXPECT_NEAR(4.0, quarter.y, 1e-12);
  EXPECT_NEAR(0.5 * M_PI, quarter.heading, 1e-12);
  const Pose2 line = Pose2{1.0, 2.0, 0.5 * M_PI}.moved(-3.0, 0.0);
  EXPECT_NEAR(1.0, line.x, 1e-12);
  EXPECT_NEAR(-1.0, line.y, 1e-12);
  EXPECT_NEAR(Pose2().moved(1.0, 0.0).x, Pose2().moved(1.0, 1e-9).x, 1e-12);
}

}  // namespace
}  // namespace pi_vehicle
