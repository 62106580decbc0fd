#include "world/figure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

using namespace pi_simulation::synthetic;

namespace
{

Eigen::Vector3f sole(const Figure& figure, const Pose& pose, Bone foot)
{
  return pose[static_cast<size_t>(foot)] * Eigen::Vector3f(0.0f, 0.0f, static_cast<float>(-figure.ankle));
}

}  // namespace

TEST(Figure, AWalkerStandsOnOneFootAtLeast)
{
  const Figure figure;
  for (double speed = 0.0; speed <= 1.8; speed += 0.3)
  {
    for (double distance = 0.0; distance < 2.0; distance += 0.05)
    {
      const Pose pose = poseOf(figure, distance, speed);
      const float left = pose[static_cast<size_t>(Bone::LEFT_FOOT)].translation().z();
      const float right = pose[static_cast<size_t>(Bone::RIGHT_FOOT)].translation().z();
      EXPECT_NEAR(std::min(left, right), figure.ankle, 1e-4) << speed << " m/s, " << distance << " m";
    }
  }
}

TEST(Figure, StepsWithTheDistanceAndRunsWithHighKnees)
{
  const Figure figure;
  const auto reach = [&](double speed)
  {
    float longest = 0.0f;
    float highest = 0.0f;
    for (double distance = 0.0; distance < 2.0 * figure.step; distance += 0.02)
    {
      const Pose pose = poseOf(figure, distance, speed);
      longest = std::max(longest, sole(figure, pose, Bone::LEFT_FOOT).x() - sole(figure, pose, Bone::RIGHT_FOOT).x());
      highest = std::max(highest, pose[static_cast<size_t>(Bone::LEFT_FOOT)].translation().z());
    }
    return std::make_pair(longest, highest);
  };
  EXPECT_LT(reach(0.0).first, 0.01f);
  EXPECT_GT(reach(1.3).first, 0.45f);
  EXPECT_GT(reach(3.0).second, reach(1.3).second + 0.1f);
  const Pose one = poseOf(figure, 0.4, 1.3);
  const Pose later = poseOf(figure, 0.4 + 2.0 * figure.step, 1.3);
  EXPECT_TRUE(one[static_cast<size_t>(Bone::LEFT_SHIN)].isApprox(later[static_cast<size_t>(Bone::LEFT_SHIN)], 1e-4f));
}

TEST(Figure, ARidersFeetFollowThePedals)
{
  Figure figure;
  figure.rides = true;
  for (double distance = 0.0; distance < 6.0; distance += 0.1)
  {
    const Pose pose = poseOf(figure, distance, 4.0);
    const Eigen::Isometry3f& crank = pose[static_cast<size_t>(Bone::CRANK)];
    const Eigen::Vector3f pedals[] = {crank * Eigen::Vector3f(0.17f, 0.0f, 0.0f),
                                      crank * Eigen::Vector3f(-0.17f, 0.0f, 0.0f)};
    const Bone feet[] = {Bone::LEFT_FOOT, Bone::RIGHT_FOOT};
    for (const int side : {0, 1})
    {
      const Eigen::Vector3f ankle = pose[static_cast<size_t>(feet[side])].translation();
      const Eigen::Vector2f gap(ankle.x() - pedals[side].x(), ankle.z() - pedals[side].z());
      EXPECT_LT(gap.norm(), 0.14f) << "side " << side << ", " << distance << " m";
    }
  }
}
