#include <gtest/gtest.h>
#include "odometry/pose_history.h"

#include <cmath>

namespace
{

using pi_slam::PoseHistory;

Eigen::Isometry3d pose(double x, double heading)
{
  return Eigen::Translation3d(x, 0.0, 0.0) * Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ());
}

TEST(PoseHistory, GivesPosesBetweenThoseKept)
{
  PoseHistory history(1000, 0);
  EXPECT_FALSE(history.newest());
  EXPECT_FALSE(history.at(0));
  history.add(100, pose(1.0, 0.2));
  EXPECT_TRUE(history.at(100));
  EXPECT_FALSE(history.at(99));
  EXPECT_FALSE(history.at(101));
  history.add(200, pose(2.0, 0.6));
  EXPECT_TRUE(history.at(125)->isApprox(pose(1.25, 0.3), 1e-12));
  EXPECT_TRUE(history.at(200)->isApprox(pose(2.0, 0.6), 1e-12));
  EXPECT_EQ(200, history.newest()->first);
  history.add(200, pose(9.0, 0.0));
  history.add(150, pose(9.0, 0.0));
  EXPECT_TRUE(history.at(150)->isApprox(pose(1.5, 0.4), 1e-12));
  history.clear();
  EXPECT_FALSE(history.at(150));
}

TEST(PoseHistory, ForgetsWhatIsOldAndThinsOut)
{
  PoseHistory history(1000, 10);
  for (int64_t stamp = 0; stamp <= 3000; ++stamp)
  {
    history.add(stamp, pose(0.001 * static_cast<double>(stamp), 0.0));
  }
  EXPECT_FALSE(history.at(1990));
  EXPECT_NEAR(2.015, history.at(2015)->translation().x(), 1e-9);
  EXPECT_NEAR(3.0, history.at(3000)->translation().x(), 1e-12);
}

}  // namespace
