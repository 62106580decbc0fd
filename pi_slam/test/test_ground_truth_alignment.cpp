#include <gtest/gtest.h>
#include "ros/ground_truth_alignment.h"
#include <pi_slam/so3.h>

#include <cmath>

namespace pi_slam
{
namespace
{

Eigen::Isometry3d makePose(const Eigen::Vector3d& position, const Eigen::Vector3d& rotation)
{
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = expSo3(rotation).toRotationMatrix();
  T.translation() = position;
  return T;
}

TEST(HeadingAlignment, IsIdentityBeforeTheFirstPair)
{
  EXPECT_TRUE(HeadingAlignment().T_a_b().isApprox(Eigen::Isometry3d::Identity()));
}

TEST(HeadingAlignment, FindsTurnAndShiftFromPosesOfATiltedVehicle)
{
  for (const double heading : {-3.1, -0.5, 0.0, 2.0, 3.14159})
  {
    const Eigen::Isometry3d T_a_b = makePose(Eigen::Vector3d(4.7, -1.8, 0.8), Eigen::Vector3d(0.0, 0.0, heading));
    HeadingAlignment alignment;
    for (int i = 0; i < 50; ++i)
    {
      const Eigen::Isometry3d T_b_base = makePose(Eigen::Vector3d(std::sin(0.1 * i), 0.02 * i, 0.3),
                                                  Eigen::Vector3d(0.3 * std::cos(0.2 * i), -1.4, 0.05 * i));
      alignment.add(T_a_b * T_b_base, T_b_base);
    }
    EXPECT_EQ(50u, alignment.count());
    EXPECT_TRUE(alignment.T_a_b().isApprox(T_a_b, 1e-9)) << heading;
  }
}

TEST(HeadingAlignment, StaysLevelWhenOneSideIsTiltedByMistake)
{
  HeadingAlignment alignment;
  alignment.add(makePose(Eigen::Vector3d::Zero(), Eigen::Vector3d(0.05, -0.03, 1.0)),
                makePose(Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()));
  EXPECT_NEAR(1.0, alignment.T_a_b().linear()(2, 2), 1e-12);
  EXPECT_NEAR(1.0, logSo3(Eigen::Quaterniond(alignment.T_a_b().linear())).z(), 0.01);
}

}  // namespace
}  // namespace pi_slam
