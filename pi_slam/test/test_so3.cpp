#include <gtest/gtest.h>
#include "inertial/nav_state.h"
#include <pi_slam/so3.h>

#include <cmath>
#include <limits>

using namespace pi_slam;

namespace
{

const Eigen::Vector3d AXIS = Eigen::Vector3d(1.0, -2.0, 0.5).normalized();

/// d log(exp(phi)^-1 exp(phi + d)) / d d by central differences.
Eigen::Matrix3d numericRightJacobian(const Eigen::Vector3d& phi)
{
  constexpr double H = 1e-5;
  Eigen::Matrix3d jacobian;
  for (int i = 0; i < 3; ++i)
  {
    const Eigen::Vector3d d = H * Eigen::Vector3d::Unit(i);
    jacobian.col(i) =
        (logSo3(expSo3(phi).conjugate() * expSo3(phi + d)) - logSo3(expSo3(phi).conjugate() * expSo3(phi - d))) /
        (2.0 * H);
  }
  return jacobian;
}

}  // namespace

TEST(So3, ExpAndLogUndoEachOther)
{
  // 0.0316 is where the series end.
  for (const double angle : {0.0, 1e-300, 1e-12, 1e-7, 1e-3, 0.03162, 0.03163, 1.0, 3.1, M_PI - 1e-9})
  {
    const Eigen::Vector3d phi = angle * AXIS;
    EXPECT_LT((logSo3(expSo3(phi)) - phi).norm(), 1e-14 + 1e-14 * angle) << angle;
  }
}

TEST(So3, ExpIsTheRotationAboutTheAxis)
{
  for (const double angle : {1e-9, 0.01, 0.0316, 0.0317, 0.7, 3.0, 6.0, 50.0})
  {
    const Eigen::Quaterniond expected(Eigen::AngleAxisd(angle, AXIS));
    EXPECT_LT((expSo3(angle * AXIS).coeffs() - expected.coeffs()).norm(), 1e-15 + 1e-16 * angle) << angle;
    EXPECT_NEAR(expSo3(angle * AXIS).norm(), 1.0, 1e-15) << angle;
  }
}

TEST(So3, LogAtPiIsPiLong)
{
  for (const double angle : {M_PI, -M_PI, 3.0 * M_PI})
  {
    const Eigen::Vector3d phi = logSo3(expSo3(angle * AXIS));
    EXPECT_NEAR(phi.norm(), M_PI, 1e-12) << angle;
    EXPECT_NEAR(std::abs(phi.dot(AXIS)), M_PI, 1e-12) << angle;
  }
  EXPECT_EQ(logSo3(Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0)), Eigen::Vector3d(M_PI, 0.0, 0.0));
}

TEST(So3, LogTakesBothSignsAndAnyLength)
{
  for (const double angle : {1e-12, 1e-4, 1.0, 3.0})
  {
    const Eigen::Quaterniond q = expSo3(angle * AXIS);
    for (const double scale : {-1.0, 1e-3, -5.0})
    {
      const Eigen::Quaterniond scaled(scale * q.w(), scale * q.x(), scale * q.y(), scale * q.z());
      EXPECT_LT((logSo3(scaled) - angle * AXIS).norm(), 1e-14 + 1e-14 * angle) << angle << " * " << scale;
    }
  }
}

TEST(So3, HatIsTheCrossProduct)
{
  const Eigen::Vector3d a(1.0, 2.0, -3.0);
  const Eigen::Vector3d b(-0.5, 4.0, 0.7);
  EXPECT_LT((hat(a) * b - a.cross(b)).norm(), 1e-15);
}

TEST(So3, RightJacobianAgreesWithDifferences)
{
  for (const double angle : {0.0, 1e-8, 1e-3, 0.0316, 0.0317, 0.5, 2.0, 3.1, M_PI, 5.0})
  {
    // A central difference errs by H^2 = 1e-10 and by rounding, 1e-16 / H.
    EXPECT_LT((rightJacobian(angle * AXIS) - numericRightJacobian(angle * AXIS)).norm(), 1e-9) << angle;
  }
}

TEST(So3, RightJacobianAndItsInverseUndoEachOther)
{
  for (const double angle : {0.0, 1e-8, 1e-3, 0.0316, 0.0317, 0.5, 3.0, M_PI, 5.0, 6.2})
  {
    const Eigen::Matrix3d product = rightJacobian(angle * AXIS) * rightJacobianInverse(angle * AXIS);
    EXPECT_LT((product - Eigen::Matrix3d::Identity()).norm(), 1e-11) << angle;
  }
}

TEST(So3, SeriesJoinTheClosedFormsWithoutAStep)
{
  const double edge = std::sqrt(1e-3);
  const double below = edge * (1.0 - 1e-13);
  const double above = edge * (1.0 + 1e-13);
  EXPECT_LT((expSo3(below * AXIS).coeffs() - expSo3(above * AXIS).coeffs()).norm(), 1e-14);
  // The closed forms subtract nearly equal numbers here.
  EXPECT_LT((rightJacobian(below * AXIS) - rightJacobian(above * AXIS)).norm(), 1e-12);
  EXPECT_LT((rightJacobianInverse(below * AXIS) - rightJacobianInverse(above * AXIS)).norm(), 1e-12);
}

TEST(NavState, BoxPlusAndBoxMinusUndoEachOther)
{
  NavState state;
  state.p = Eigen::Vector3d(1.0, -2.0, 3.0);
  state.q = expSo3(Eigen::Vector3d(0.4, -1.0, 2.0));
  state.v = Eigen::Vector3d(0.1, 0.2, 0.3);
  state.bias.gyro = Eigen::Vector3d(0.01, 0.02, 0.03);
  state.bias.accel = Eigen::Vector3d(-0.1, 0.2, 0.0);
  Vector15d delta;
  for (int i = 0; i < 15; ++i)
  {
    delta[i] = 0.1 * std::sin(1.0 + i);
  }
  NavState moved = state;
  moved.boxPlus(delta);
  EXPECT_LT((moved.boxMinus(state) - delta).norm(), 1e-14);
  // The rotation error is one in the body frame.
  EXPECT_LT(((state.q * expSo3(delta.segment<3>(3))).coeffs() - moved.q.coeffs()).norm(), 1e-14);
  EXPECT_NEAR(moved.p.x() - state.p.x(), delta[0], 1e-15);
}

TEST(NavState, KnowsNumbersThatAreNotFinite)
{
  NavState state;
  EXPECT_TRUE(state.isFinite());
  for (double* value : {&state.p.x(), &state.q.coeffs()[3], &state.v.z(), &state.bias.gyro.y(), &state.bias.accel.x()})
  {
    const double before = *value;
    *value = std::numeric_limits<double>::quiet_NaN();
    EXPECT_FALSE(state.isFinite());
    *value = std::numeric_limits<double>::infinity();
    EXPECT_FALSE(state.isFinite());
    *value = before;
  }
}
