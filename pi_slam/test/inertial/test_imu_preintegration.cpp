#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_slam/imu_simulator.h>
#include <pi_slam/so3.h>
#include "inertial/imu_preintegration.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <random>

#include "inertial/start_ns.h"

using namespace pi_slam;
using pi_node::test_support::messageOf;

namespace
{

constexpr double GRAVITY = 9.81;

/// A lively motion: up to 3 rad/s and 5 m/s^2.
SplineTrajectory makeMotion(double duration_s)
{
  std::vector<StampedPose> poses;
  for (int i = 0; i * 0.02 <= duration_s + 1e-9; ++i)
  {
    const double t = i * 0.02;
    StampedPose pose;
    pose.stamp_ns = START_NS + i * 20000000LL;
    pose.T_world_body.translation() =
        Eigen::Vector3d(1.2 * std::sin(1.9 * t), 0.8 * std::cos(2.3 * t), 0.4 * std::sin(3.1 * t) + 0.3 * t);
    pose.T_world_body.linear() = (Eigen::AngleAxisd(1.6 * t, Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(0.7 * std::sin(2.7 * t), Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(0.5 * std::cos(1.8 * t), Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    poses.push_back(pose);
  }
  return SplineTrajectory::fit(poses);
}

NavState stateAt(const SplineTrajectory& motion, int64_t stamp_ns)
{
  const SplineTrajectory::State truth = motion.at(stamp_ns);
  NavState state;
  state.stamp_ns = stamp_ns;
  state.p = truth.T_world_body.translation();
  state.q = Eigen::Quaterniond(truth.T_world_body.linear());
  state.v = truth.v_world;
  return state;
}

std::vector<ImuSample> idealSamples(const SplineTrajectory& motion, double rate_hz, int64_t from_ns, int64_t to_ns)
{
  ImuSimulatorOptions options = ImuSimulatorOptions::makeIdeal();
  options.rate_hz = rate_hz;
  return ImuSimulator(options).simulate(motion, from_ns, to_ns);
}

ImuPreintegration integrate(const std::vector<ImuSample>& samples, const ImuBias& bias,
                            const ImuModel& model = ImuModel())
{
  ImuPreintegration integral(model, bias);
  for (size_t i = 1; i < samples.size(); ++i)
  {
    integral.append(samples[i - 1], samples[i]);
  }
  return integral;
}

/// Errors [p, theta, v] of the deltas, truth minus estimate.
Eigen::Matrix<double, 9, 1> difference(const ImuPreintegration& truth, const ImuPreintegration& estimate)
{
  Eigen::Matrix<double, 9, 1> error;
  error << truth.deltaP() - estimate.deltaP(), logSo3(estimate.deltaR().conjugate() * truth.deltaR()),
      truth.deltaV() - estimate.deltaV();
  return error;
}

ImuBias someBias()
{
  return ImuBias{Eigen::Vector3d(0.02, -0.05, 0.08), Eigen::Vector3d(0.1, -0.2, 0.15)};
}

ImuBias moved(const ImuBias& bias, const Eigen::Matrix<double, 6, 1>& delta)
{
  return ImuBias{bias.gyro + delta.head<3>(), bias.accel + delta.tail<3>()};
}

}  // namespace

TEST(ImuPreintegration, PredictsTheTrueMotionFromIdealSamples)
{
  const SplineTrajectory motion = makeMotion(4.0);
  for (const double rate_hz : {100.0, 200.0, 1000.0})
  {
    for (const double duration_s : {0.05, 0.5, 2.0})
    {
      const int64_t from_ns = START_NS + 500000000LL;
      const auto samples =
          idealSamples(motion, rate_hz, from_ns, from_ns + static_cast<int64_t>(std::llround(duration_s * 1e9)));
      const ImuPreintegration integral = integrate(samples, ImuBias());
      const NavState end = integral.predict(stateAt(motion, from_ns));
      const Vector15d error = stateAt(motion, integral.endNs()).boxMinus(end);
      // The rule errs by dt^2 / 12 of the change of the derivatives of force (here up to 60 m/s^3) and rate (10
      // rad/s^2; the mean rate also misses dt^2 / 12 of w x w'), and the tilt that comes from it turns gravity.
      const double dt = 1.0 / rate_hz;
      const double bound = dt * dt / 12.0;
      EXPECT_LT(error.segment<3>(3).norm(), bound * (20.0 + 30.0 * duration_s)) << rate_hz << " " << duration_s;
      EXPECT_LT(error.segment<3>(6).norm(), bound * (120.0 + 300.0 * duration_s)) << rate_hz << " " << duration_s;
      EXPECT_LT(error.segment<3>(0).norm(), bound * (120.0 + 300.0 * duration_s) * duration_s)
          << rate_hz << " " << duration_s;
      EXPECT_EQ(end.stamp_ns, samples.back().stamp_ns);
      EXPECT_NEAR(integral.duration(), duration_s, 1e-9);
    }
  }
}

TEST(ImuPreintegration, ErrsWithTheSquareOfTheInterval)
{
  const SplineTrajectory motion = makeMotion(3.0);
  double last = 0.0;
  for (const double rate_hz : {100.0, 200.0, 400.0})
  {
    const ImuPreintegration integral =
        integrate(idealSamples(motion, rate_hz, START_NS + 500000000LL, START_NS + 2500000000LL), ImuBias());
    const NavState end = integral.predict(stateAt(motion, integral.startNs()));
    const double error = (end.p - stateAt(motion, integral.endNs()).p).norm();
    if (last > 0.0)
    {
      EXPECT_NEAR(last / error, 4.0, 0.5) << rate_hz;
    }
    last = error;
  }
}

TEST(ImuPreintegration, BiasJacobianAgreesWithDifferences)
{
  const SplineTrajectory motion = makeMotion(2.0);
  const auto samples = idealSamples(motion, 200.0, START_NS, START_NS + 800000000LL);
  const ImuPreintegration integral = integrate(samples, someBias());
  constexpr double H = 1e-5;
  for (int i = 0; i < 6; ++i)
  {
    const Eigen::Matrix<double, 6, 1> d = H * Eigen::Matrix<double, 6, 1>::Unit(i);
    const Eigen::Matrix<double, 9, 1> numeric = (difference(integrate(samples, moved(someBias(), d)), integral) -
                                                 difference(integrate(samples, moved(someBias(), -d)), integral)) /
                                                (2.0 * H);
    // Central differences err by H^2 of third derivatives, which are near 1; the step's own derivative is exact.
    EXPECT_LT((numeric - integral.biasJacobian().col(i)).norm(), 1e-8) << i;
  }
}

TEST(ImuPreintegration, CorrectsItsDeltasToFirstOrderForOtherBiases)
{
  const SplineTrajectory motion = makeMotion(2.0);
  const auto samples = idealSamples(motion, 200.0, START_NS, START_NS + 500000000LL);
  const ImuPreintegration integral = integrate(samples, someBias());
  Eigen::Matrix<double, 6, 1> d;
  d << 0.004, -0.003, 0.002, 0.03, 0.02, -0.05;
  double last = 0.0;
  for (const double scale : {1.0, 0.5})
  {
    const ImuBias bias = moved(someBias(), scale * d);
    const ImuPreintegration again = integrate(samples, bias);
    const double before = difference(again, integral).norm();
    Eigen::Matrix<double, 9, 1> left;
    left << again.deltaP() - integral.correctedP(bias), logSo3(integral.correctedR(bias).conjugate() * again.deltaR()),
        again.deltaV() - integral.correctedV(bias);
    EXPECT_LT(left.norm(), 1e-2 * before);
    if (last > 0.0)
    {
      EXPECT_NEAR(last / left.norm(), 4.0, 0.2);  // of second order
    }
    last = left.norm();
  }
}

TEST(ImuPreintegration, ReintegratesForOtherBiases)
{
  const SplineTrajectory motion = makeMotion(2.0);
  const auto samples = idealSamples(motion, 200.0, START_NS, START_NS + 500000000LL);
  ImuPreintegration integral = integrate(samples, ImuBias());
  integral.reintegrate(someBias());
  const ImuPreintegration fresh = integrate(samples, someBias());
  EXPECT_EQ(integral.deltaP(), fresh.deltaP());
  EXPECT_EQ(integral.deltaV(), fresh.deltaV());
  EXPECT_EQ(integral.deltaR().coeffs(), fresh.deltaR().coeffs());
  EXPECT_EQ(integral.covariance(), fresh.covariance());
  EXPECT_EQ(integral.biasJacobian(), fresh.biasJacobian());
  EXPECT_EQ(integral.duration(), fresh.duration());
  EXPECT_EQ(integral.bias().gyro, someBias().gyro);
}

TEST(ImuPreintegration, AppendedIntegralsEqualOneLongOne)
{
  const SplineTrajectory motion = makeMotion(2.0);
  const auto samples = idealSamples(motion, 200.0, START_NS, START_NS + 500000000LL);
  const ImuPreintegration whole = integrate(samples, someBias());
  ImuPreintegration parts = integrate({samples.begin(), samples.begin() + 41}, someBias());
  // The second part's own biases do not matter.
  parts.append(integrate({samples.begin() + 40, samples.end()}, ImuBias()));
  parts.append(ImuPreintegration(ImuModel(), ImuBias()));
  EXPECT_EQ(parts.deltaP(), whole.deltaP());
  EXPECT_EQ(parts.deltaV(), whole.deltaV());
  EXPECT_EQ(parts.deltaR().coeffs(), whole.deltaR().coeffs());
  EXPECT_EQ(parts.covariance(), whole.covariance());
  EXPECT_EQ(parts.startNs(), whole.startNs());
  EXPECT_EQ(parts.endNs(), whole.endNs());
}

TEST(ImuPreintegration, CovarianceIsThatOfSimulatedNoise)
{
  const SplineTrajectory motion = makeMotion(2.0);
  ImuModel model;
  // Walks strong enough to matter within the interval.
  model.gyro_noise_density = 1e-3;
  model.gyro_random_walk = 2e-3;
  model.accel_noise_density = 1e-2;
  model.accel_random_walk = 5e-2;
  const auto samples = idealSamples(motion, 200.0, START_NS, START_NS + 1000000000LL);
  const ImuPreintegration truth = integrate(samples, ImuBias(), model);
  const double root_dt = std::sqrt(0.005);
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  const auto vector = [&] { return Eigen::Vector3d{normal(random), normal(random), normal(random)}; };
  constexpr int TRIALS = 3000;
  Matrix15d sum = Matrix15d::Zero();
  for (int trial = 0; trial < TRIALS; ++trial)
  {
    std::vector<ImuSample> noisy = samples;
    ImuBias bias;
    for (ImuSample& sample : noisy)
    {
      sample.w += bias.gyro + model.gyro_noise_density / root_dt * vector();
      sample.f += bias.accel + model.accel_noise_density / root_dt * vector();
      bias.gyro += model.gyro_random_walk * root_dt * vector();
      bias.accel += model.accel_random_walk * root_dt * vector();
    }
    Vector15d error;
    error << difference(truth, integrate(noisy, ImuBias(), model)), bias.gyro, bias.accel;
    sum += error * error.transpose();
  }
  // In the coordinates in which the covariance should be the identity. An element has a standard deviation of
  // 1 / sqrt(3000) = 0.018, on the diagonal sqrt(2) times that; the samples at the ends count half: up to 1 / 200.
  const Eigen::LLT<Matrix15d> root(truth.covariance());
  ASSERT_EQ(root.info(), Eigen::Success);
  const Matrix15d left = root.matrixL().solve(sum / TRIALS);
  const Matrix15d whitened = root.matrixL().solve(left.transpose());
  EXPECT_LT((whitened - Matrix15d::Identity()).cwiseAbs().maxCoeff(), 0.14);
  EXPECT_NEAR(whitened.trace() / 15.0, 1.0, 0.04);
}

TEST(ImuPreintegration, CovarianceIsSymmetricAndPositiveDefiniteFromTheFirstInterval)
{
  const SplineTrajectory motion = makeMotion(2.0);
  const auto samples = idealSamples(motion, 1000.0, START_NS, START_NS + 500000000LL);
  ImuPreintegration integral{ImuModel(), ImuBias()};
  EXPECT_EQ(integral.covariance(), Matrix15d::Zero());
  for (size_t i = 1; i < samples.size(); ++i)
  {
    integral.append(samples[i - 1], samples[i]);
    if (i <= 3 || i % 100 == 0)
    {
      const Matrix15d& P = integral.covariance();
      EXPECT_LT((P - P.transpose()).norm(), 1e-12 * P.norm()) << i;
      // Scaled to a unit diagonal, since entries differ by ten orders of magnitude.
      const Vector15d scale = P.diagonal().cwiseSqrt().cwiseInverse();
      const Matrix15d correlation = scale.asDiagonal() * P * scale.asDiagonal();
      const Matrix15d lowered = correlation - 1e-6 * Matrix15d::Identity();
      EXPECT_EQ(Eigen::LLT<Matrix15d>(lowered).info(), Eigen::Success) << i;
    }
  }
}

TEST(ImuPreintegration, NoiseFactorRaisesTheCovarianceByItsSquareButNotTheWalkOfTheBiases)
{
  const SplineTrajectory motion = makeMotion(1.0);
  const auto samples = idealSamples(motion, 200.0, START_NS, START_NS + 5000000LL);
  ImuPreintegration plain{ImuModel(), ImuBias()};
  ImuPreintegration raised{ImuModel(), ImuBias()};
  plain.append(samples[0], samples[1]);
  raised.append(samples[0], samples[1], 10.0);
  const auto expectRaised = [&]
  {
    Matrix15d expected = plain.covariance();
    expected.topLeftCorner<9, 9>() *= 100.0;
    EXPECT_LT((raised.covariance() - expected).norm(), 1e-12 * expected.norm());
  };
  expectRaised();
  raised.reintegrate(ImuBias());
  expectRaised();
  EXPECT_EQ(raised.deltaV(), plain.deltaV());
}

TEST(ImuPreintegration, TransitionAgreesWithDifferencesOfThePrediction)
{
  const SplineTrajectory motion = makeMotion(2.0);
  const auto samples = idealSamples(motion, 200.0, START_NS, START_NS + 500000000LL);
  const ImuPreintegration integral = integrate(samples, someBias());
  NavState begin = stateAt(motion, START_NS);
  // Not the biases of the integral: the first-order correction is differentiated too.
  begin.bias = someBias();
  begin.bias.gyro += Eigen::Vector3d(0.01, 0.02, -0.015);
  begin.bias.accel += Eigen::Vector3d(0.05, 0.0, -0.03);
  Matrix15d F;
  Matrix15d Q;
  integral.transition(begin, &F, &Q);
  const NavState end = integral.predict(begin);
  constexpr double H = 1e-5;
  for (int i = 0; i < 15; ++i)
  {
    NavState up = begin;
    NavState down = begin;
    up.boxPlus(H * Vector15d::Unit(i));
    down.boxPlus(-H * Vector15d::Unit(i));
    const Vector15d numeric = (integral.predict(up).boxMinus(end) - integral.predict(down).boxMinus(end)) / (2.0 * H);
    EXPECT_LT((numeric - F.col(i)).norm(), 1e-8) << i;
  }
  // Noise is rotated into odom: what it says about the body's axes stays.
  Matrix15d turn = Matrix15d::Identity();
  turn.block<3, 3>(0, 0) = turn.block<3, 3>(6, 6) = begin.q.toRotationMatrix();
  EXPECT_LT((Q - turn * integral.covariance() * turn.transpose()).norm(), 1e-15);
}

TEST(ImuPreintegration, EmptyIntegralPredictsNoMotion)
{
  const ImuPreintegration integral{ImuModel(), ImuBias()};
  NavState begin;
  begin.stamp_ns = 5;
  begin.v = Eigen::Vector3d(1.0, 2.0, 3.0);
  EXPECT_TRUE(integral.empty());
  EXPECT_EQ(integral.duration(), 0.0);
  EXPECT_EQ(integral.predict(begin).boxMinus(begin), Vector15d::Zero());
  EXPECT_EQ(integral.predict(begin).stamp_ns, 5);
}

TEST(ImuPreintegration, RefusesWhatIsNoInterval)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ImuPreintegration integral{ImuModel(), ImuBias()};
  const ImuSample a{1000000, Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ()};
  const ImuSample b{6000000, Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ()};
  ImuSample c{11000000, Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ()};
  const auto complaint = [&](const ImuSample& from, const ImuSample& to, double factor = 1.0)
  { return messageOf<std::invalid_argument>([&] { integral.append(from, to, factor); }); };
  EXPECT_EQ(complaint(b, a), "imu: interval ends at 1000000 ns, must be after 6000000 ns, where it begins");
  EXPECT_NE(complaint(a, a), "");
  EXPECT_NE(complaint(a, b, nan).find("noise_factor"), std::string::npos);
  EXPECT_NE(complaint(a, b, 0.5).find("noise_factor"), std::string::npos);
  EXPECT_TRUE(integral.empty());
  integral.append(a, b);
  const Matrix15d before = integral.covariance();
  EXPECT_EQ(complaint(a, b), "imu: interval begins at 1000000 ns, must begin at 6000000 ns, where the integral ends");
  c.f.x() = nan;
  EXPECT_NE(complaint(b, c).find("not finite"), std::string::npos);
  c.f.x() = 1e300;
  EXPECT_NE(complaint(b, c).find("not finite"), std::string::npos);
  EXPECT_THROW(integral.append(integral), std::invalid_argument);
  EXPECT_THROW(integral.reintegrate(ImuBias{Eigen::Vector3d(nan, 0.0, 0.0), Eigen::Vector3d::Zero()}),
               std::invalid_argument);
  EXPECT_THROW(ImuPreintegration(ImuModel(), ImuBias{Eigen::Vector3d::Zero(), Eigen::Vector3d(0.0, nan, 0.0)}),
               std::invalid_argument);
  EXPECT_EQ(integral.covariance(), before);
  EXPECT_EQ(integral.endNs(), 6000000);
}
