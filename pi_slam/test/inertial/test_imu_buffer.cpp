#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_slam/so3.h>
#include "inertial/imu_preintegration.h"

#include <cmath>
#include <limits>

#include "inertial/start_ns.h"

using namespace pi_slam;
using pi_node::test_support::messageOf;

namespace
{

constexpr int64_t PERIOD_NS = 5000000LL;

/// Rate and force grow linearly with time, so that interpolation is exact.
ImuSample sampleAt(int64_t offset_ns)
{
  const double t = 1e-9 * static_cast<double>(offset_ns);
  return ImuSample{START_NS + offset_ns, Eigen::Vector3d(0.1 * t, 0.2, -0.3 * t),
                   Eigen::Vector3d(t, 0.5 - t, 9.81 + 2.0 * t)};
}

ImuBuffer makeBuffer(int from, int to)
{
  ImuBuffer buffer{ImuModel()};
  for (int i = from; i <= to; ++i)
  {
    buffer.add(sampleAt(i * PERIOD_NS));
  }
  return buffer;
}

}  // namespace

TEST(ImuBuffer, TakesSamplesInOrderAndSaysWhatIsWrongWithOthers)
{
  ImuBuffer buffer{ImuModel()};
  EXPECT_TRUE(buffer.empty());
  EXPECT_EQ(buffer.add(sampleAt(0)), ImuBuffer::Added::OK);
  EXPECT_EQ(buffer.add(sampleAt(0)), ImuBuffer::Added::OUT_OF_ORDER);
  EXPECT_EQ(buffer.add(sampleAt(-PERIOD_NS)), ImuBuffer::Added::OUT_OF_ORDER);
  ImuSample sample = sampleAt(PERIOD_NS);
  sample.w.y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(buffer.add(sample), ImuBuffer::Added::NOT_FINITE);
  sample.w.y() = 1e200;
  EXPECT_EQ(buffer.add(sample), ImuBuffer::Added::NOT_FINITE);
  sample.w.y() = -17.0;
  EXPECT_EQ(buffer.add(sample), ImuBuffer::Added::SATURATED);
  EXPECT_EQ(buffer.lastNs(), START_NS + PERIOD_NS);
  // 25 ms is no gap yet at 200 Hz.
  EXPECT_EQ(buffer.add(sampleAt(6 * PERIOD_NS)), ImuBuffer::Added::OK);
  EXPECT_EQ(buffer.add(sampleAt(12 * PERIOD_NS)), ImuBuffer::Added::GAP);
  EXPECT_EQ(buffer.lastNs(), START_NS + 12 * PERIOD_NS);
  EXPECT_EQ(buffer.firstNs(), START_NS);
}

TEST(ImuBuffer, GapsAreFivePeriodsButAtLeast25Milliseconds)
{
  ImuModel model;
  model.rate_hz = 1000.0;
  EXPECT_DOUBLE_EQ(ImuBuffer(model).longestInterval(), 0.025);
  model.rate_hz = 50.0;
  EXPECT_DOUBLE_EQ(ImuBuffer(model).longestInterval(), 0.1);
}

TEST(ImuBuffer, IntegratesBetweenAnyTwoTimes)
{
  const ImuBuffer buffer = makeBuffer(0, 100);
  // Expected: the samples within, and interpolated ones at the ends.
  const int64_t from_ns = START_NS + 3 * PERIOD_NS + 1234567;
  const int64_t to_ns = START_NS + 60 * PERIOD_NS + 4000000;
  ImuPreintegration expected{ImuModel(), ImuBias()};
  ImuSample last = sampleAt(from_ns - START_NS);
  for (int i = 4; i <= 60; ++i)
  {
    expected.append(last, sampleAt(i * PERIOD_NS));
    last = sampleAt(i * PERIOD_NS);
  }
  expected.append(last, sampleAt(to_ns - START_NS));
  ImuBuffer::Quality quality;
  const ImuPreintegration integral = buffer.integrate(from_ns, to_ns, ImuBias(), &quality);
  EXPECT_TRUE(quality.complete);
  EXPECT_EQ(quality.gap_s, 0.0);
  EXPECT_FALSE(quality.saturated);
  EXPECT_EQ(integral.startNs(), from_ns);
  EXPECT_EQ(integral.endNs(), to_ns);
  EXPECT_LT((integral.deltaP() - expected.deltaP()).norm(), 1e-12);
  EXPECT_LT((integral.deltaV() - expected.deltaV()).norm(), 1e-12);
  EXPECT_LT((integral.deltaR().coeffs() - expected.deltaR().coeffs()).norm(), 1e-12);
  EXPECT_LT((integral.covariance() - expected.covariance()).norm(), 1e-9 * expected.covariance().norm());
}

TEST(ImuBuffer, IntegratesFromSampleToSampleAndWithinOneInterval)
{
  const ImuBuffer buffer = makeBuffer(0, 20);
  const ImuPreintegration whole = buffer.integrate(START_NS, START_NS + 20 * PERIOD_NS, ImuBias(), nullptr);
  EXPECT_NEAR(whole.duration(), 0.1, 1e-12);
  const ImuPreintegration inner = buffer.integrate(START_NS + 1000000, START_NS + 3000000, ImuBias(), nullptr);
  EXPECT_NEAR(inner.duration(), 0.002, 1e-15);
  // Mean force of sampleAt at 2 ms; the turn of 0.4 mrad is left out.
  EXPECT_LT((inner.deltaV() - 0.002 * sampleAt(2000000).f).norm(), 1e-5);
}

TEST(ImuBuffer, PartsOfAnIntegralJoin)
{
  const ImuBuffer buffer = makeBuffer(0, 100);
  const int64_t middle_ns = START_NS + 41 * PERIOD_NS + 777777;
  ImuPreintegration parts = buffer.integrate(START_NS + 11, middle_ns, ImuBias(), nullptr);
  parts.append(buffer.integrate(middle_ns, START_NS + 99 * PERIOD_NS + 3, ImuBias(), nullptr));
  const ImuPreintegration whole = buffer.integrate(START_NS + 11, START_NS + 99 * PERIOD_NS + 3, ImuBias(), nullptr);
  // Cutting an interval changes the midpoint rule's error of that interval only.
  EXPECT_LT((parts.deltaP() - whole.deltaP()).norm(), 1e-6);
  EXPECT_LT(logSo3(parts.deltaR().conjugate() * whole.deltaR()).norm(), 1e-8);
}

TEST(ImuBuffer, IsIncompleteWhereSamplesDoNotReach)
{
  const ImuBuffer buffer = makeBuffer(10, 20);
  ImuBuffer::Quality quality;
  EXPECT_TRUE(buffer.integrate(START_NS + 9 * PERIOD_NS, START_NS + 15 * PERIOD_NS, ImuBias(), &quality).empty());
  EXPECT_FALSE(quality.complete);
  EXPECT_TRUE(buffer.integrate(START_NS + 15 * PERIOD_NS, START_NS + 20 * PERIOD_NS + 1, ImuBias(), &quality).empty());
  EXPECT_FALSE(quality.complete);
  EXPECT_FALSE(buffer.integrate(START_NS + 10 * PERIOD_NS, START_NS + 20 * PERIOD_NS, ImuBias(), &quality).empty());
  EXPECT_TRUE(quality.complete);
  EXPECT_TRUE(ImuBuffer(ImuModel()).integrate(START_NS, START_NS + 1, ImuBias(), &quality).empty());
  EXPECT_FALSE(quality.complete);
  EXPECT_NE(messageOf<std::invalid_argument>([&] { buffer.integrate(5, 5, ImuBias(), &quality); }), "");
}

TEST(ImuBuffer, BridgesGapsWithMoreNoise)
{
  ImuBuffer buffer{ImuModel()};
  ImuBuffer whole{ImuModel()};
  for (int i = 0; i <= 100; ++i)
  {
    whole.add(sampleAt(i * PERIOD_NS));
    if (i <= 30 || i >= 70)
    {
      buffer.add(sampleAt(i * PERIOD_NS));
    }
  }
  ImuBuffer::Quality quality;
  const ImuPreintegration bridged = buffer.integrate(START_NS, START_NS + 100 * PERIOD_NS, ImuBias(), &quality);
  const ImuPreintegration full = whole.integrate(START_NS, START_NS + 100 * PERIOD_NS, ImuBias(), nullptr);
  EXPECT_TRUE(quality.complete);
  EXPECT_NEAR(quality.gap_s, 0.2, 1e-9);
  // Force and rate are linear: what is left is the rule's error over 0.2 s, dt^2 / 12 of the force's change of slope.
  EXPECT_LT((bridged.deltaP() - full.deltaP()).norm(), 0.01);
  // The speed is as uncertain as after 0.6 m/s^2, what a jerk of 3 m/s^3 leads to, for 0.2 s.
  EXPECT_NEAR(std::sqrt(bridged.covariance()(6, 6)), 0.12, 0.02);
  EXPECT_LT(std::sqrt(full.covariance()(6, 6)), 0.01);
  EXPECT_TRUE(bridged.covariance().allFinite());
  buffer.integrate(START_NS, START_NS + 30 * PERIOD_NS, ImuBias(), &quality);
  EXPECT_EQ(quality.gap_s, 0.0);
  // Times within the gap see it too.
  buffer.integrate(START_NS + 40 * PERIOD_NS, START_NS + 50 * PERIOD_NS, ImuBias(), &quality);
  EXPECT_NEAR(quality.gap_s, 0.2, 1e-9);
}

TEST(ImuBuffer, ReportsSaturationOnlyWhereItWas)
{
  ImuBuffer buffer{ImuModel()};
  for (int i = 0; i <= 50; ++i)
  {
    ImuSample sample = sampleAt(i * PERIOD_NS);
    sample.f.z() = i == 25 ? 150.0 : sample.f.z();
    EXPECT_EQ(buffer.add(sample), i == 25 ? ImuBuffer::Added::SATURATED : ImuBuffer::Added::OK);
  }
  ImuBuffer::Quality quality;
  buffer.integrate(START_NS, START_NS + 24 * PERIOD_NS, ImuBias(), &quality);
  EXPECT_FALSE(quality.saturated);
  buffer.integrate(START_NS + 20 * PERIOD_NS, START_NS + 30 * PERIOD_NS, ImuBias(), &quality);
  EXPECT_TRUE(quality.saturated);
  buffer.integrate(START_NS + 26 * PERIOD_NS, START_NS + 50 * PERIOD_NS, ImuBias(), &quality);
  EXPECT_FALSE(quality.saturated);
}

TEST(ImuBuffer, GivesMeansAndDeviations)
{
  ImuBuffer buffer{ImuModel()};
  for (int i = 0; i < 5; ++i)
  {
    // x of the rate: 1 2 3 4 5
    buffer.add(ImuSample{START_NS + i * PERIOD_NS, Eigen::Vector3d(i + 1.0, 0.5, 0.0), Eigen::Vector3d(0, 0, 9.81)});
  }
  Eigen::Vector3d w_mean = Eigen::Vector3d::Constant(-1.0);
  Eigen::Vector3d f_mean, w_deviation, f_deviation;
  EXPECT_FALSE(buffer.statistics(START_NS, START_NS + PERIOD_NS, &w_mean, &f_mean, &w_deviation, &f_deviation));
  EXPECT_EQ(w_mean.x(), -1.0);
  ASSERT_TRUE(buffer.statistics(START_NS, START_NS + 4 * PERIOD_NS, &w_mean, &f_mean, &w_deviation, &f_deviation));
  EXPECT_NEAR(w_mean.x(), 3.0, 1e-12);
  EXPECT_NEAR(w_deviation.x(), std::sqrt(2.5), 1e-12);
  EXPECT_NEAR(w_deviation.y(), 0.0, 1e-12);
  EXPECT_NEAR(f_mean.z(), 9.81, 1e-12);
  ASSERT_TRUE(buffer.statistics(START_NS + 1, START_NS + 3 * PERIOD_NS, &w_mean, &f_mean, &w_deviation, &f_deviation));
  EXPECT_NEAR(w_mean.x(), 3.0, 1e-12);  // 2, 3, 4
}

TEST(ImuBuffer, ForgetsWhatIsNoLongerNeeded)
{
  ImuBuffer buffer = makeBuffer(0, 100);
  buffer.forgetBefore(START_NS + 50 * PERIOD_NS + 1);
  EXPECT_EQ(buffer.firstNs(), START_NS + 50 * PERIOD_NS);  // still needed to interpolate at that time
  buffer.forgetBefore(START_NS);
  EXPECT_EQ(buffer.firstNs(), START_NS + 50 * PERIOD_NS);
  ImuBuffer::Quality quality;
  buffer.integrate(START_NS + 50 * PERIOD_NS + 1, START_NS + 60 * PERIOD_NS, ImuBias(), &quality);
  EXPECT_TRUE(quality.complete);
  buffer.forgetBefore(START_NS + 1000 * PERIOD_NS);
  EXPECT_EQ(buffer.firstNs(), buffer.lastNs());
  ImuBuffer nothing{ImuModel()};
  nothing.forgetBefore(START_NS);
  EXPECT_TRUE(nothing.empty());
}

TEST(ImuBuffer, RefusesAModelOutOfRange)
{
  ImuModel model;
  model.rate_hz = 0.0;
  EXPECT_EQ(messageOf<std::invalid_argument>([&] { ImuBuffer{model}; }), "imu/rate_hz = 0, must be in [20, 4000]");
}
