#include <gtest/gtest.h>
#include <pi_slam/so3.h>
#include "inertial/imu_preintegration.h"
#include "inertial/imu_propagator.h"

#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "inertial/start_ns.h"

using namespace pi_slam;

namespace
{

/// A body that turns and is pushed about, never still; sample `i` of a stream.
ImuSample sampleAt(int i, double rate_hz)
{
  const double t = i / rate_hz;
  return ImuSample{START_NS + std::llround(1e9 * t),
                   Eigen::Vector3d(0.3 * std::sin(2.0 * t), 0.2 * std::cos(3.0 * t), 0.5),
                   Eigen::Vector3d(0.5 * std::sin(t), 0.3, 9.81 + 0.4 * std::cos(2.0 * t))};
}

ImuModel modelOf(double rate_hz)
{
  ImuModel model;
  model.rate_hz = rate_hz;
  return model;
}

NavState stateAt(int64_t offset_ns)
{
  NavState state;
  state.stamp_ns = START_NS + offset_ns;
  state.p = Eigen::Vector3d(1.0, 2.0, 3.0);
  state.q = expSo3(Eigen::Vector3d(0.1, -0.2, 0.7));
  state.v = Eigen::Vector3d(0.5, -0.5, 0.1);
  state.bias.gyro = Eigen::Vector3d(0.01, -0.02, 0.03);
  state.bias.accel = Eigen::Vector3d(0.05, 0.02, -0.04);
  return state;
}

Matrix15d someCovariance()
{
  Matrix15d root = Matrix15d::Identity();
  for (int i = 0; i < 15; ++i)
  {
    for (int j = 0; j < i; ++j)
    {
      root(i, j) = 0.3 * std::sin(i + 2.0 * j);
    }
  }
  return 1e-4 * root * root.transpose();
}

/// What the propagator should arrive at: the preintegration's prediction, by an independent path of code.
PropagatedState expected(const ImuModel& model, const NavState& state, const Matrix15d& covariance, int last,
                         double rate_hz)
{
  ImuBuffer buffer(model);
  for (int i = 0; i <= last; ++i)
  {
    buffer.add(sampleAt(i, rate_hz));
  }
  const ImuPreintegration integral = buffer.integrate(state.stamp_ns, buffer.lastNs(), state.bias, nullptr);
  Matrix15d F;
  Matrix15d Q;
  integral.transition(state, &F, &Q);
  PropagatedState result;
  result.state = integral.predict(state);
  result.covariance = F * covariance * F.transpose() + Q;
  return result;
}

void expectEqual(const PropagatedState& a, const PropagatedState& b)
{
  EXPECT_EQ(a.state.stamp_ns, b.state.stamp_ns);
  EXPECT_LT(a.state.boxMinus(b.state).norm(), 1e-9);
  // Positions grow to metres, their variance to m^2; rounding only.
  EXPECT_LT((a.covariance - b.covariance).norm(), 1e-9 * b.covariance.norm());
}

}  // namespace

TEST(ImuPropagator, GivesAPosePerSampleOnceItHasAState)
{
  ImuPropagator propagator(modelOf(200.0));
  EXPECT_FALSE(propagator.newest());
  for (int i = 0; i <= 10; ++i)
  {
    EXPECT_FALSE(propagator.add(sampleAt(i, 200.0)));
  }
  EXPECT_FALSE(propagator.newest());
  ASSERT_TRUE(propagator.rebase(stateAt(20000000), someCovariance()));
  ASSERT_TRUE(propagator.newest());
  EXPECT_EQ(propagator.newest()->state.stamp_ns, sampleAt(10, 200.0).stamp_ns);
  const auto pose = propagator.add(sampleAt(11, 200.0));
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->state.stamp_ns, sampleAt(11, 200.0).stamp_ns);
  EXPECT_LT((pose->w_body - (sampleAt(11, 200.0).w - stateAt(0).bias.gyro)).norm(), 1e-12);
  EXPECT_EQ(propagator.newest()->state.p, pose->state.p);
}

TEST(ImuPropagator, AgreesWithPreintegrationAtAnyRate)
{
  for (const double rate_hz : {100.0, 200.0, 1000.0})
  {
    const int last = static_cast<int>(rate_hz);
    ImuPropagator propagator(modelOf(rate_hz));
    for (int i = 0; i <= last; ++i)
    {
      propagator.add(sampleAt(i, rate_hz));
      if (i == last / 2)
      {
        // Between two samples, some of which are already past.
        ASSERT_TRUE(propagator.rebase(stateAt(123456789), someCovariance()));
      }
    }
    expectEqual(*propagator.newest(), expected(modelOf(rate_hz), stateAt(123456789), someCovariance(), last, rate_hz));
  }
}

TEST(ImuPropagator, GoesOnFromTheNewerOfTwoCorrections)
{
  ImuPropagator propagator(modelOf(200.0));
  for (int i = 0; i <= 100; ++i)
  {
    propagator.add(sampleAt(i, 200.0));
  }
  ASSERT_TRUE(propagator.rebase(stateAt(100000000), someCovariance()));
  NavState other = stateAt(300000000);
  other.p.x() = 50.0;
  ASSERT_TRUE(propagator.rebase(other, 2.0 * someCovariance()));
  expectEqual(*propagator.newest(), expected(modelOf(200.0), other, 2.0 * someCovariance(), 100, 200.0));
}

TEST(ImuPropagator, TakesAStateNewerThanItsSamples)
{
  ImuPropagator propagator(modelOf(200.0));
  for (int i = 0; i <= 10; ++i)
  {
    propagator.add(sampleAt(i, 200.0));
  }
  ASSERT_TRUE(propagator.rebase(stateAt(57000000), someCovariance()));
  EXPECT_EQ(propagator.newest()->state.stamp_ns, START_NS + 57000000);
  EXPECT_FALSE(propagator.add(sampleAt(11, 200.0)));  // 55 ms: before the state
  ASSERT_TRUE(propagator.add(sampleAt(12, 200.0)));
  ASSERT_TRUE(propagator.add(sampleAt(13, 200.0)));
  expectEqual(*propagator.newest(), expected(modelOf(200.0), stateAt(57000000), someCovariance(), 13, 200.0));
}

TEST(ImuPropagator, TakesAStateBeforeTheFirstSampleOfAll)
{
  ImuPropagator propagator(modelOf(200.0));
  NavState state = stateAt(-5000000);
  state.q.setIdentity();
  state.v.setZero();
  state.bias = ImuBias();
  ASSERT_TRUE(propagator.rebase(state, someCovariance()));
  const ImuSample rest{START_NS, Eigen::Vector3d::Zero(), Eigen::Vector3d(0.0, 0.0, 9.81)};
  const auto pose = propagator.add(rest);
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->state.stamp_ns, START_NS);
  EXPECT_LT((pose->state.p - state.p).norm(), 1e-12);
}

TEST(ImuPropagator, CovarianceGrowsWithoutCorrections)
{
  ImuPropagator propagator(modelOf(200.0));
  propagator.add(sampleAt(0, 200.0));
  ASSERT_TRUE(propagator.rebase(stateAt(0), someCovariance()));
  Vector15d last = someCovariance().diagonal();
  for (int i = 1; i <= 2000; ++i)
  {
    const auto pose = propagator.add(sampleAt(i, 200.0));
    ASSERT_TRUE(pose);
    if (i % 200 == 0)
    {
      const Vector15d now = pose->covariance.diagonal();
      // Every second: positions, velocities and biases; angles turn among each other and grow in sum.
      for (const int row : {0, 1, 2, 6, 7, 8, 9, 10, 11, 12, 13, 14})
      {
        EXPECT_GT(now[row], last[row]) << i << " row " << row;
      }
      EXPECT_GT(now.segment<3>(3).sum(), last.segment<3>(3).sum());
      EXPECT_LT((pose->covariance - pose->covariance.transpose()).norm(), 1e-9 * pose->covariance.norm());
      last = now;
    }
  }
}

TEST(ImuPropagator, PosesAreContinuousBetweenCorrections)
{
  ImuPropagator propagator(modelOf(200.0));
  propagator.add(sampleAt(0, 200.0));
  ASSERT_TRUE(propagator.rebase(stateAt(0), someCovariance()));
  NavState last = propagator.newest()->state;
  for (int i = 1; i <= 400; ++i)
  {
    const NavState now = propagator.add(sampleAt(i, 200.0))->state;
    // The way of 5 ms at the mean of both speeds, and a turn of at most 0.7 rad/s.
    EXPECT_LT((now.p - last.p - 0.0025 * (now.v + last.v)).norm(), 1e-5) << i;
    EXPECT_LT(logSo3(last.q.conjugate() * now.q).norm(), 0.7 * 0.005) << i;
    last = now;
  }
}

TEST(ImuPropagator, BridgesAGapWithAFasterGrowthOfTheCovariance)
{
  ImuPropagator whole(modelOf(200.0));
  ImuPropagator gapped(modelOf(200.0));
  for (int i = 0; i <= 400; ++i)
  {
    whole.add(sampleAt(i, 200.0));
    if (i <= 100 || i >= 300)
    {
      gapped.add(sampleAt(i, 200.0));
    }
    if (i == 0)
    {
      ASSERT_TRUE(whole.rebase(stateAt(0), Matrix15d::Identity() * 1e-8));
      ASSERT_TRUE(gapped.rebase(stateAt(0), Matrix15d::Identity() * 1e-8));
    }
  }
  const PropagatedState a = *whole.newest();
  const PropagatedState b = *gapped.newest();
  EXPECT_EQ(a.state.stamp_ns, b.state.stamp_ns);
  EXPECT_TRUE(b.state.isFinite());
  // Half of the time with standard deviations of at least 10 times those of the sensor: 50 times the variance and more.
  EXPECT_GT(b.covariance(3, 3), 20.0 * a.covariance(3, 3));
  EXPECT_GT(b.covariance(6, 6), 5.0 * a.covariance(6, 6));
  // A second of straight lines between samples that differ by 1 rad/s at most.
  EXPECT_LT((a.state.p - b.state.p).norm(), 3.0);
  // A correction after the gap makes up for it.
  ASSERT_TRUE(whole.rebase(stateAt(1800000000), someCovariance()));
  ASSERT_TRUE(gapped.rebase(stateAt(1800000000), someCovariance()));
  expectEqual(*gapped.newest(), *whole.newest());
}

TEST(ImuPropagator, IgnoresSamplesThatAreOutOfOrderOrNotFinite)
{
  ImuPropagator propagator(modelOf(200.0));
  propagator.add(sampleAt(0, 200.0));
  ASSERT_TRUE(propagator.rebase(stateAt(0), someCovariance()));
  ASSERT_TRUE(propagator.add(sampleAt(1, 200.0)));
  EXPECT_FALSE(propagator.add(sampleAt(1, 200.0)));
  EXPECT_FALSE(propagator.add(sampleAt(0, 200.0)));
  ImuSample bad = sampleAt(2, 200.0);
  bad.f.x() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(propagator.add(bad));
  bad.f.x() = 1e100;
  EXPECT_FALSE(propagator.add(bad));
  ASSERT_TRUE(propagator.add(sampleAt(2, 200.0)));
  expectEqual(*propagator.newest(), expected(modelOf(200.0), stateAt(0), someCovariance(), 2, 200.0));
}

TEST(ImuPropagator, RefusesStatesThatAreTooOldOrNotFinite)
{
  ImuPropagator propagator(modelOf(200.0));
  for (int i = 0; i <= 2000; ++i)
  {
    propagator.add(sampleAt(i, 200.0));
  }
  EXPECT_FALSE(propagator.rebase(stateAt(0), someCovariance()));
  EXPECT_FALSE(propagator.rebase(stateAt(4900000000LL), someCovariance()));
  EXPECT_FALSE(propagator.newest());
  NavState bad = stateAt(8000000000LL);
  bad.v.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(propagator.rebase(bad, someCovariance()));
  bad = stateAt(8000000000LL);
  bad.q.coeffs().setZero();
  EXPECT_FALSE(propagator.rebase(bad, someCovariance()));
  Matrix15d covariance = someCovariance();
  covariance(3, 4) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(propagator.rebase(stateAt(8000000000LL), covariance));
  EXPECT_FALSE(propagator.rebase(stateAt(8000000000LL), -someCovariance()));
  EXPECT_FALSE(propagator.newest());
  // 5 s back is still kept.
  EXPECT_TRUE(propagator.rebase(stateAt(5000000000LL), someCovariance()));
  const PropagatedState before = *propagator.newest();
  EXPECT_FALSE(propagator.rebase(bad, someCovariance()));
  EXPECT_EQ(propagator.newest()->state.p, before.state.p);
}

TEST(ImuPropagator, KeepsTheSpeedByWheelsWithoutCorrections)
{
  // Straight on at 2 m/s, with an accelerometer that is off by 0.1 m/s^2.
  const auto drive = [](bool with_wheels)
  {
    ImuPropagator propagator{ImuModel()};
    NavState state;
    state.stamp_ns = START_NS;
    state.v.x() = 2.0;
    Matrix15d covariance = 1e-6 * Matrix15d::Identity();
    covariance.diagonal().tail<3>().setConstant(0.01);
    propagator.setWheels(WheelOptions(), with_wheels ? std::optional(WheelScale{0.98, 0.002}) : std::nullopt);
    propagator.rebase(state, covariance);
    for (int i = 0; i <= 2000; ++i)
    {
      propagator.add({START_NS + 5000000LL * i, Eigen::Vector3d::Zero(), Eigen::Vector3d(0.1, 0.0, 9.81), false});
      if (i % 4 == 0)
      {
        propagator.addWheels({START_NS + 5000000LL * i, Eigen::Vector2d(2.0 / 0.98, 0.0), 0.0});
      }
    }
    return std::abs(propagator.newest()->state.p.x() - 20.0);
  };
  EXPECT_LT(drive(true), 0.05);
  EXPECT_GT(drive(false), 4.0);
}

TEST(ImuPropagator, StopsUntilTheNextCorrection)
{
  ImuPropagator propagator(modelOf(200.0));
  propagator.add(sampleAt(0, 200.0));
  ASSERT_TRUE(propagator.rebase(stateAt(0), someCovariance()));
  ASSERT_TRUE(propagator.add(sampleAt(1, 200.0)));
  propagator.reset();
  EXPECT_FALSE(propagator.newest());
  EXPECT_FALSE(propagator.add(sampleAt(2, 200.0)));
  // Samples were kept.
  ASSERT_TRUE(propagator.rebase(stateAt(2000000), someCovariance()));
  expectEqual(*propagator.newest(), expected(modelOf(200.0), stateAt(2000000), someCovariance(), 2, 200.0));
}

TEST(ImuPropagator, CorrectionsFromAnotherThreadDoNotDisturbTheStream)
{
  for (const double rate_hz : {200.0, 1000.0})
  {
    const int last = static_cast<int>(4.0 * rate_hz);
    ImuPropagator propagator(modelOf(rate_hz));
    propagator.add(sampleAt(0, rate_hz));
    ASSERT_TRUE(propagator.rebase(stateAt(0), someCovariance()));
    std::atomic<int> done{0};
    std::atomic<int> rebased{0};
    std::thread corrector(
        [&]
        {
          // Corrections that lag a tenth of a second behind the stream, as fast as they go.
          for (int now = done; now < last; now = done)
          {
            const int64_t offset_ns = std::max<int64_t>(0, std::llround(1e9 * now / rate_hz) - 100000000LL);
            rebased += propagator.rebase(stateAt(offset_ns), someCovariance());
          }
        });
    int64_t stamp_ns = START_NS;
    int poses = 0;
    for (int i = 1; i <= last; ++i)
    {
      const auto pose = propagator.add(sampleAt(i, rate_hz));
      poses += pose.has_value();
      if (pose)
      {
        EXPECT_GT(pose->state.stamp_ns, stamp_ns);
        EXPECT_TRUE(pose->state.isFinite());
        stamp_ns = pose->state.stamp_ns;
      }
      // The other thread has its turn a few times in the course of it.
      if (i % (last / 8) == 0)
      {
        const int seen = rebased;
        done = i < last ? i : i - 1;
        const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10);
        while (rebased == seen && std::chrono::steady_clock::now() < deadline)
        {
          std::this_thread::yield();
        }
      }
    }
    done = last;
    corrector.join();
    EXPECT_EQ(poses, last);
    EXPECT_GE(rebased.load(), 8);
    // However they met: from the last correction on, the result is that of a fresh integration.
    const NavState state = stateAt(std::llround(1e9 * (last - 20) / rate_hz) + 1234);
    ASSERT_TRUE(propagator.rebase(state, someCovariance()));
    expectEqual(*propagator.newest(), expected(modelOf(rate_hz), state, someCovariance(), last, rate_hz));
  }
}
