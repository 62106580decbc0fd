#include <pi_slam/imu_simulator.h>

#include "drives/vehicle_path.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cmath>

using namespace pi_simulation;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

namespace
{

pi_slam::SplineTrajectory makeDrive(double duration_s)
{
  VehiclePathOptions options;
  options.shape = PathShape::HALL_LOOP;
  options.duration_s = duration_s;
  return pi_slam::SplineTrajectory::fit(makeVehiclePath(options));
}

/// Strapdown integration with the mean of neighbouring samples.
Eigen::Isometry3d integrate(const pi_slam::SplineTrajectory& truth, const std::vector<pi_slam::ImuSample>& samples)
{
  const auto start = truth.at(samples.front().stamp_ns);
  Eigen::Quaterniond q(start.T_world_body.linear());
  Eigen::Vector3d p = start.T_world_body.translation();
  Eigen::Vector3d v = start.v_world;
  for (size_t i = 1; i < samples.size(); ++i)
  {
    const double dt = 1e-9 * static_cast<double>(samples[i].stamp_ns - samples[i - 1].stamp_ns);
    const Eigen::Vector3d before = q * samples[i - 1].f;
    q = (q * pi_slam::expSo3(0.5 * dt * (samples[i].w + samples[i - 1].w))).normalized();
    const Eigen::Vector3d a = 0.5 * (before + q * samples[i].f) + Eigen::Vector3d(0.0, 0.0, -9.81);
    p += dt * v + 0.5 * dt * dt * a;
    v += dt * a;
  }
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = q.toRotationMatrix();
  pose.translation() = p;
  return pose;
}

}  // namespace

TEST(ImuSimulator, IdealSamplesIntegrateBackToTheTrajectory)
{
  const pi_slam::SplineTrajectory drive = makeDrive(20.0);
  for (const double rate_hz : {200.0, 1000.0})
  {
    pi_slam::ImuSimulatorOptions options = pi_slam::ImuSimulatorOptions::makeIdeal();
    options.rate_hz = rate_hz;
    const auto samples = pi_slam::ImuSimulator(options).simulate(drive, drive.startNs(), drive.endNs());
    ASSERT_EQ(samples.size(), static_cast<size_t>(20.0 * rate_hz) + 1);
    const Eigen::Isometry3d truth = drive.at(samples.back().stamp_ns).T_world_body;
    const Eigen::Isometry3d pose = integrate(drive, samples);
    // Trapezoidal integration errs with the square of the interval: over 20 s, millimetres at 200 Hz.
    const double bound = 0.02 * (200.0 / rate_hz) * (200.0 / rate_hz) + 1e-4;
    EXPECT_LT((pose.translation() - truth.translation()).norm(), bound) << rate_hz;
    EXPECT_LT(pi_slam::logSo3(Eigen::Quaterniond(Eigen::Matrix3d(pose.linear().transpose() * truth.linear()))).norm(),
              1e-3)
        << rate_hz;
  }
}

TEST(ImuSimulator, AtRestItMeasuresGravityUpwards)
{
  const pi_slam::SplineTrajectory drive = makeDrive(20.0);
  const auto samples =
      pi_slam::ImuSimulator(pi_slam::ImuSimulatorOptions::makeIdeal()).simulate(drive, drive.startNs(), drive.endNs());
  EXPECT_LT(samples[100].w.norm(), 1e-4);
  EXPECT_NEAR(samples[100].f.norm(), 9.81, 1e-3);
  EXPECT_GT(samples[100].f.z(), 9.8);
}

TEST(ImuSimulator, NoiseHasTheStatedDensity)
{
  const pi_slam::SplineTrajectory drive = makeDrive(60.0);
  pi_slam::ImuSimulatorOptions options;
  options.gyro_random_walk = options.accel_random_walk = 0.0;
  const auto noisy = pi_slam::ImuSimulator(options).simulate(drive, drive.startNs(), drive.endNs());
  const auto ideal =
      pi_slam::ImuSimulator(pi_slam::ImuSimulatorOptions::makeIdeal()).simulate(drive, drive.startNs(), drive.endNs());
  double gyro = 0.0;
  double accel = 0.0;
  for (size_t i = 0; i < noisy.size(); ++i)
  {
    gyro += (noisy[i].w - ideal[i].w - options.gyro_bias).squaredNorm();
    accel += (noisy[i].f - ideal[i].f - options.accel_bias).squaredNorm();
  }
  // 36000 values: the standard deviation of the estimate is 0.4 %.
  const double count = 3.0 * static_cast<double>(noisy.size());
  EXPECT_NEAR(std::sqrt(gyro / count), 1.6968e-4 * std::sqrt(200.0), 0.02 * 1.6968e-4 * std::sqrt(200.0));
  EXPECT_NEAR(std::sqrt(accel / count), 2e-3 * std::sqrt(200.0), 0.02 * 2e-3 * std::sqrt(200.0));
}

TEST(ImuSimulator, BiasesWalkAndAreReported)
{
  const pi_slam::SplineTrajectory drive = makeDrive(30.0);
  pi_slam::ImuSimulatorOptions options;
  options.gyro_noise_density = options.accel_noise_density = 0.0;
  std::vector<pi_slam::ImuBias> biases;
  const auto samples = pi_slam::ImuSimulator(options).simulate(drive, drive.startNs(), drive.endNs(), &biases);
  const auto ideal =
      pi_slam::ImuSimulator(pi_slam::ImuSimulatorOptions::makeIdeal()).simulate(drive, drive.startNs(), drive.endNs());
  ASSERT_EQ(biases.size(), samples.size());
  EXPECT_EQ(biases.front().gyro, options.gyro_bias);
  EXPECT_NE(biases.back().gyro, options.gyro_bias);
  EXPECT_LT((samples.back().f - ideal.back().f - biases.back().accel).norm(), 1e-12);
  // After 30 s, sigma sqrt(30) per axis; five times that is out of the question.
  EXPECT_LT((biases.back().accel - options.accel_bias).cwiseAbs().maxCoeff(), 5.0 * 3e-3 * std::sqrt(30.0));
}

TEST(ImuSimulator, Saturates)
{
  const pi_slam::SplineTrajectory drive = makeDrive(10.0);
  pi_slam::ImuSimulatorOptions options = pi_slam::ImuSimulatorOptions::makeIdeal();
  options.accel_limit = 5.0;
  for (const pi_slam::ImuSample& sample :
       pi_slam::ImuSimulator(options).simulate(drive, drive.startNs(), drive.endNs()))
  {
    EXPECT_LE(sample.f.cwiseAbs().maxCoeff(), 5.0);
  }
}

TEST(ImuSimulator, RepeatsItselfWithTheSameSeed)
{
  const pi_slam::SplineTrajectory drive = makeDrive(10.0);
  pi_slam::ImuSimulatorOptions options;
  const auto first = pi_slam::ImuSimulator(options).simulate(drive, drive.startNs(), drive.endNs());
  const auto again = pi_slam::ImuSimulator(options).simulate(drive, drive.startNs(), drive.endNs());
  options.seed = 2;
  const auto other = pi_slam::ImuSimulator(options).simulate(drive, drive.startNs(), drive.endNs());
  EXPECT_EQ(first.back().w, again.back().w);
  EXPECT_NE(first.back().w, other.back().w);
}

TEST(ImuSimulator, RefusesOptionsOutOfRangeByName)
{
  pi_slam::ImuSimulatorOptions options;
  options.rate_hz = 1.0;
  EXPECT_EQ(messageOf<std::invalid_argument>([&] { pi_slam::ImuSimulator{options}; }),
            "imu: rate_hz = 1.000000, must be in [10, 4000]");
  options = pi_slam::ImuSimulatorOptions();
  options.gyro_noise_density = -1.0;
  EXPECT_NE(messageOf<std::invalid_argument>([&] { pi_slam::ImuSimulator{options}; }).find("gyro_noise_density"),
            std::string::npos);
}

TEST(ImuLog, KeepsLinesAsTheyAre)
{
  const TemporaryFolder folder;
  const pi_slam::ImuLog log =
      pi_slam::readImuLog(folder.file("imu.csv", "#header\n1000,1,2,3,4,5,6.50\r\n2000,1e-3,2,3,4,5,6\n"));
  EXPECT_EQ(log.header, "#header");
  ASSERT_EQ(log.lines.size(), 2u);
  EXPECT_EQ(log.lines[0], "1000,1,2,3,4,5,6.50");
  EXPECT_EQ(log.stamps_ns[1], 2000);
}

TEST(ImuLog, NamesTheLineThatIsWrong)
{
  const TemporaryFolder folder;
  const auto complaint = [&](const std::string& text)
  { return messageOf<pi_slam::RecordingError>([&] { pi_slam::readImuLog(folder.file("imu.csv", text)); }); };
  EXPECT_NE(complaint("1000,1,2,3,4,5\n").find("imu.csv:1: is not"), std::string::npos);
  EXPECT_NE(complaint("2,1,2,3,4,5,6\n1,1,2,3,4,5,6\n").find("imu.csv:2: time stamp"), std::string::npos);
  EXPECT_NE(complaint("2,1,2,3,4,nan,6\n").find("imu.csv:1"), std::string::npos);
  EXPECT_NE(complaint("#only a header\n").find("has no sample"), std::string::npos);
  EXPECT_NE(messageOf<pi_slam::RecordingError>([] { pi_slam::readImuLog("/nowhere/imu.csv"); }).find("missing"),
            std::string::npos);
}
