#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_slam/imu_simulator.h>
#include <pi_slam/so3.h>
#include "drives/vehicle_path.h"
#include "front_end/stereo_tracker.h"
#include "initialization/initializer.h"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "estimator/simulated_features.h"

using namespace pi_simulation;
using namespace pi_slam;
using pi_node::test_support::messageOf;

namespace
{

constexpr int64_t START_NS = 1700000000000000000LL;
constexpr double DEGREE = M_PI / 180.0;
using Outcome = Initializer::Outcome;

SplineTrajectory makeTrajectory(double duration_s, const std::function<Eigen::Vector3d(double)>& position,
                                const std::function<Eigen::Vector3d(double)>& rpy)
{
  std::vector<StampedPose> poses;
  for (int i = 0; i * 0.02 <= duration_s + 1e-9; ++i)
  {
    const double t = i * 0.02;
    StampedPose pose;
    pose.stamp_ns = START_NS + i * 20000000LL;
    pose.T_world_body.translation() = position(t);
    const Eigen::Vector3d angles = rpy(t);
    pose.T_world_body.linear() = (Eigen::AngleAxisd(angles.z(), Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(angles.y(), Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(angles.x(), Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    poses.push_back(pose);
  }
  return SplineTrajectory::fit(poses);
}

/// Swung about by hand; the phase gives another part of the motion at the start.
SplineTrajectory handHeld(double phase)
{
  return makeTrajectory(
      5.0,
      [=](double t)
      {
        t += phase;
        return Eigen::Vector3d(0.4 * std::sin(2.1 * t), 0.3 * std::cos(1.7 * t), 0.2 * std::sin(2.9 * t));
      },
      [=](double t)
      {
        t += phase;
        return Eigen::Vector3d(0.3 * std::sin(1.9 * t), 0.25 * std::cos(2.3 * t), 0.5 * std::sin(1.1 * t) + phase);
      });
}

SplineTrajectory atRest(double roll, double pitch)
{
  return makeTrajectory(
      5.0, [](double) { return Eigen::Vector3d(1.0, 2.0, 1.0); },
      [=](double) { return Eigen::Vector3d(roll, pitch, 0.8); });
}

SplineTrajectory straight(double speed)
{
  return makeTrajectory(
      5.0, [=](double t) { return Eigen::Vector3d(speed * std::cos(0.3) * t, speed * std::sin(0.3) * t, 1.0); },
      [](double) { return Eigen::Vector3d(0.02, -0.05, 0.3); });
}

SplineTrajectory vehicle(PathShape shape, double bumps)
{
  VehiclePathOptions options;
  options.shape = shape;
  options.duration_s = 8.0;
  options.start_standstill_s = 0.0;
  options.bumps = bumps;
  options.start_ns = START_NS - 3000000000LL;
  return SplineTrajectory::fit(makeVehiclePath(options));
}

struct World
{
  explicit World(const SplineTrajectory& motion)
    : trajectory(motion), first_ns(std::max(motion.startNs(), START_NS) + 200000000LL)
  {
    imu.gyro_bias = Eigen::Vector3d(-0.002, 0.021, 0.077);
    imu.accel_bias = Eigen::Vector3d(-0.03, 0.06, 0.05);
    features.pixel_noise = 0.5;
    options.max_window_s = 3.0;
  }

  SplineTrajectory trajectory;
  int64_t first_ns;
  StereoCalibration calibration = StereoCalibration::makeForwardPair(752, 480, 0.11);
  ImuSimulatorOptions imu;
  SimulatedFeaturesOptions features;
  InitializerOptions options;
  std::function<void(FrameFeatures*, int)> change = [](FrameFeatures*, int) {};  ///< of each pair
  std::function<bool(const ImuSample&)> keep = [](const ImuSample&) { return true; };

  // Results.
  Outcome outcome = Outcome::COLLECTING;  ///< DONE, or the last one that was not COLLECTING
  std::map<Outcome, int> counts;
  std::string message;
  InitialSolution solution;

  void run(double duration_s = 4.0)
  {
    ImuModel model;
    ImuBuffer buffer(model);
    for (const ImuSample& sample : ImuSimulator(imu).simulate(trajectory, trajectory.startNs(), trajectory.endNs()))
    {
      if (keep(sample))
      {
        buffer.add(sample);
      }
    }
    SimulatedFeatures front_end(trajectory, calibration, features);
    Initializer initializer(calibration, model, options);
    const int pairs = static_cast<int>(std::lround(20.0 * duration_s));
    for (int i = 0; i < pairs && outcome != Outcome::DONE; ++i)
    {
      FrameFeatures frame = front_end.at(first_ns + i * 50000000LL);
      change(&frame, i);
      const Outcome now = initializer.add(frame, buffer, &solution);
      ++counts[now];
      outcome = now == Outcome::COLLECTING ? outcome : now;
    }
    message = initializer.message();
  }

  double lastTime() const { return 1e-9 * static_cast<double>(solution.states.back().stamp_ns - first_ns); }

  Eigen::Vector3d velocityOff(const NavState& state) const
  {
    const SplineTrajectory::State truth = trajectory.at(state.stamp_ns);
    return state.q.conjugate() * state.v - truth.T_world_body.linear().transpose() * truth.v_world;
  }

  Eigen::Vector3d wayOff(const NavState& state) const
  {
    const Eigen::Isometry3d T_world_body = trajectory.at(state.stamp_ns).T_world_body;
    const Eigen::Vector3d start = trajectory.at(solution.states.front().stamp_ns).T_world_body.translation();
    return state.q.conjugate() * state.p - T_world_body.linear().transpose() * (T_world_body.translation() - start);
  }

  /// Of every state: direction of gravity, velocity in the body frame, way since the first in the last one's frame.
  void expectTrue(double max_tilt, double max_velocity, double max_gyro_bias, double max_way) const
  {
    ASSERT_EQ(outcome, Outcome::DONE) << message;
    ASSERT_EQ(solution.states.size(), solution.frames.size());
    ASSERT_GE(solution.states.size(), 4u);
    const NavState& first = solution.states.front();
    EXPECT_EQ(first.p, Eigen::Vector3d::Zero());
    const Eigen::Vector3d view = first.q * Eigen::Vector3d::UnitX();
    EXPECT_NEAR(std::atan2(view.y(), view.x()), 0.0, 1e-6);
    for (size_t k = 0; k < solution.states.size(); ++k)
    {
      const NavState& state = solution.states[k];
      EXPECT_EQ(state.stamp_ns, solution.frames[k].stamp_ns);
      ASSERT_TRUE(state.isFinite());
      const Eigen::Matrix3d R_body_world = trajectory.at(state.stamp_ns).T_world_body.linear().transpose();
      const Eigen::Vector3d up = state.q.conjugate() * Eigen::Vector3d::UnitZ();
      EXPECT_LT(up.cross(R_body_world * Eigen::Vector3d::UnitZ()).norm(), max_tilt) << "state " << k;
      EXPECT_GT(up.dot(R_body_world * Eigen::Vector3d::UnitZ()), 0.0);
      EXPECT_LT(velocityOff(state).norm(), max_velocity) << "state " << k;
      EXPECT_LT((state.bias.gyro - imu.gyro_bias).norm(), max_gyro_bias);
      EXPECT_LT(wayOff(state).norm(), max_way) << "state " << k;
    }
  }
};

}  // namespace

TEST(Initializer, StartsAtRest)
{
  for (const double roll : {0.0, 0.4, -2.8})
  {
    World world(atRest(roll, 0.3));
    world.run();
    // The accelerometer's bias across gravity, 0.08 m/s^2, is 0.5 degrees.
    world.expectTrue(0.6 * DEGREE, 1e-9, 1e-3, 1e-9);
    EXPECT_TRUE(world.solution.still);
    EXPECT_NEAR(world.lastTime(), world.options.still_window_s, 0.11);
  }
}

TEST(Initializer, AtRestFindsTheAccelerometersBiasAlongGravity)
{
  World world(atRest(0.0, 0.0));
  world.imu.accel_bias = Eigen::Vector3d(0.0, 0.0, 0.3);
  world.run();
  ASSERT_EQ(world.outcome, Outcome::DONE) << world.message;
  // Noise of 100 samples: 2e-3 * sqrt(200 / 100).
  EXPECT_LT((world.solution.states.back().bias.accel - world.imu.accel_bias).norm(), 0.02);
}

TEST(Initializer, StartsWhileSwungAboutByHand)
{
  for (const double phase : {0.0, 0.7, 1.9, 3.3})
  {
    SCOPED_TRACE(phase);
    World world(handHeld(phase));
    world.imu.seed = world.features.seed = static_cast<uint64_t>(10.0 * phase) + 1;
    world.run();
    world.expectTrue(1.0 * DEGREE, 0.05, 0.005, 0.03);
    EXPECT_FALSE(world.solution.still);
    EXPECT_LT(world.lastTime(), 1.2);
  }
}

TEST(Initializer, StartsWithLargeBiasesOfTheGyro)
{
  for (const Eigen::Vector3d& bias : {Eigen::Vector3d(0.1, 0.0, 0.0), Eigen::Vector3d(-0.2, 0.25, 0.3)})
  {
    SCOPED_TRACE(bias.transpose());
    World world(handHeld(0.3));
    world.imu.gyro_bias = bias;
    world.run();
    world.expectTrue(1.0 * DEGREE, 0.05, 0.005, 0.03);
  }
}

TEST(Initializer, StartsWithNoisyPictures)
{
  for (const double noise : {0.1, 1.0})
  {
    SCOPED_TRACE(noise);
    World world(handHeld(1.1));
    world.features.pixel_noise = noise;
    world.run();
    world.expectTrue(1.0 * DEGREE, 0.04 + 0.04 * noise, 0.002 + 0.008 * noise, 0.02 + 0.03 * noise);
  }
}

TEST(Initializer, StartsInAVehicleAtConstantSpeed)
{
  for (const double speed : {0.3, 3.0, 10.0})
  {
    SCOPED_TRACE(speed);
    constexpr int RUNS = 20;  // one is up to 2.5 times as far off as all are on the average
    double velocity_off = 0.0;
    double way_off = 0.0;
    for (uint64_t seed = 1; seed <= RUNS; ++seed)
    {
      World world(straight(speed));
      world.features.landmarks = 4000;
      world.features.max_range = 25.0;
      world.imu.seed = world.features.seed = seed;
      world.run();
      world.expectTrue(1.5 * DEGREE, 0.02 + 0.03 * speed, 0.01, 0.2);
      EXPECT_FALSE(world.solution.still);
      velocity_off += world.velocityOff(world.solution.states.back()).squaredNorm() / RUNS;
      way_off += world.wayOff(world.solution.states.back()).squaredNorm() / RUNS;
    }
    EXPECT_LT(std::sqrt(velocity_off), 0.02 + 0.012 * speed);
    EXPECT_LT(std::sqrt(way_off), 0.1);
  }
}

TEST(Initializer, StartsInAVehicleOnAnUnevenRoad)
{
  for (const PathShape shape : {PathShape::CAMPUS_LOOP, PathShape::FIGURE_EIGHT})
  {
    World world(vehicle(shape, 1.0));
    world.features.landmarks = 2500;
    world.features.max_range = 20.0;
    world.run();
    world.expectTrue(1.5 * DEGREE, 0.1, 0.01, 0.1);
  }
}

TEST(Initializer, StartsWithAFifthOfTheFeaturesWrong)
{
  for (const uint64_t seed : {1, 2, 3})
  {
    World world(handHeld(0.4 * static_cast<double>(seed)));
    world.features.outlier_ratio = 0.2;
    world.features.seed = seed;
    world.run();
    world.expectTrue(1.0 * DEGREE, 0.06, 0.006, 0.04);
  }
}

TEST(Initializer, StartsAtRestThoughOthersMove)
{
  World world(atRest(0.1, -0.1));
  world.features.outlier_ratio = 0.3;
  world.run();
  world.expectTrue(0.6 * DEGREE, 1e-9, 1e-3, 1e-9);
  EXPECT_TRUE(world.solution.still);
}

TEST(Initializer, StartsWhenTheMotionEnds)
{
  // Too few pairs for a start in motion before the body comes to rest after 0.6 s.
  World world(makeTrajectory(
      5.0,
      [](double t)
      {
        const double left = std::max(0.0, 0.8 - t);
        return Eigen::Vector3d(2.0 * left * left * left, 0.0, 1.0);
      },
      [](double) { return Eigen::Vector3d::Zero(); }));
  world.run();
  world.expectTrue(1.0 * DEGREE, 0.05, 0.005, 0.03);
}

TEST(Initializer, TellsSlowMotionFromRest)
{
  // Pictures go 1 px or less in half a second.
  World world(straight(0.06));
  world.features.min_range = 8.0;
  world.features.max_range = 20.0;
  world.features.landmarks = 3000;
  world.run();
  world.expectTrue(1.5 * DEGREE, 0.07, 0.01, 0.1);
}

TEST(Initializer, ATurnTableIsNotAtRest)
{
  World world(makeTrajectory(
      5.0, [](double) { return Eigen::Vector3d(0.0, 0.0, 1.0); },
      [](double t) { return Eigen::Vector3d(0.0, 0.0, 2.0 * DEGREE * t); }));
  world.run();
  world.expectTrue(1.0 * DEGREE, 0.05, 0.005, 0.03);
  EXPECT_FALSE(world.solution.still);
}

TEST(Initializer, HeadingFollowsTheViewWhereverTheBodysAxesPoint)
{
  // The IMU is mounted with its x axis up, as in EuRoC's sensor.
  World world(handHeld(0.2));
  Eigen::Isometry3d T_new_old = Eigen::Isometry3d::Identity();
  T_new_old.linear() = Eigen::AngleAxisd(0.5 * M_PI, Eigen::Vector3d::UnitY()).toRotationMatrix();
  std::vector<StampedPose> poses;
  for (int i = 0; i <= 250; ++i)
  {
    const int64_t stamp_ns = START_NS + i * 20000000LL;
    poses.push_back({stamp_ns, world.trajectory.at(stamp_ns).T_world_body * T_new_old.inverse()});
  }
  world.trajectory = SplineTrajectory::fit(poses);
  world.calibration.left.T_body_camera = T_new_old * world.calibration.left.T_body_camera;
  world.calibration.right.T_body_camera = T_new_old * world.calibration.right.T_body_camera;
  world.run();
  ASSERT_EQ(world.outcome, Outcome::DONE) << world.message;
  const NavState& first = world.solution.states.front();
  const Eigen::Vector3d view = first.q * world.calibration.left.T_body_camera.linear().col(2);
  EXPECT_NEAR(view.y(), 0.0, 1e-6);
  EXPECT_GT(view.x(), 0.5);
  const Eigen::Vector3d up = world.trajectory.at(first.stamp_ns).T_world_body.linear().row(2).transpose();
  EXPECT_LT((first.q.conjugate() * Eigen::Vector3d::UnitZ() - up).norm(), 1.0 * DEGREE);
}

TEST(Initializer, SaysThatFeaturesAreFew)
{
  World world(handHeld(0.0));
  world.features.max_features = 15;
  world.run();
  EXPECT_EQ(world.outcome, Outcome::FEW_FEATURES);
  EXPECT_EQ(world.counts[Outcome::FEW_FEATURES], 80);
  EXPECT_NE(world.message.find("must be 20"), std::string::npos) << world.message;

  World blank(handHeld(0.0));
  blank.change = [](FrameFeatures* frame, int) { frame->features.clear(); };
  blank.run();
  EXPECT_EQ(blank.outcome, Outcome::FEW_FEATURES);
}

TEST(Initializer, GoesOnAfterAFewBadPairs)
{
  World world(handHeld(0.5));
  world.change = [](FrameFeatures* frame, int i)
  {
    if (i >= 8 && i < 12)
    {
      frame->features.clear();
    }
  };
  world.run();
  world.expectTrue(1.0 * DEGREE, 0.05, 0.005, 0.03);
}

TEST(Initializer, SaysThatTheImuIsMissing)
{
  World world(handHeld(0.0));
  world.keep = [](const ImuSample&) { return false; };
  world.run(1.0);
  EXPECT_EQ(world.outcome, Outcome::NO_IMU);
  EXPECT_NE(world.message.find("no samples"), std::string::npos) << world.message;

  World late(handHeld(0.0));
  late.keep = [](const ImuSample& sample) { return sample.stamp_ns < START_NS + 400000000LL; };
  late.run(1.5);
  EXPECT_EQ(late.outcome, Outcome::NO_IMU);
  EXPECT_NE(late.message.find("must reach over it"), std::string::npos) << late.message;
}

TEST(Initializer, WaitsUntilAGapOfTheImuIsPast)
{
  World world(handHeld(0.0));
  world.keep = [](const ImuSample& sample)
  { return sample.stamp_ns < START_NS + 600000000LL || sample.stamp_ns > START_NS + 900000000LL; };
  world.run();
  EXPECT_GT(world.counts[Outcome::NO_IMU], 0);
  world.expectTrue(1.0 * DEGREE, 0.05, 0.005, 0.03);
  EXPECT_GT(world.solution.states.front().stamp_ns, START_NS + 800000000LL);
}

TEST(Initializer, StartsWithPairsAfterTheFirstSampleOfTheImu)
{
  World world(handHeld(0.0));
  world.keep = [](const ImuSample& sample) { return sample.stamp_ns > START_NS + 700000000LL; };
  world.run();
  world.expectTrue(1.0 * DEGREE, 0.05, 0.005, 0.03);
}

TEST(Initializer, IsNeverDoneWithTheCamerasSwapped)
{
  for (const bool rest : {true, false})
  {
    World world(rest ? atRest(0.0, 0.0) : handHeld(0.0));
    world.change = [](FrameFeatures* frame, int)
    {
      for (FeatureObservation& feature : frame->features)
      {
        std::swap(feature.seen[LEFT], feature.seen[RIGHT]);
        std::swap(feature.pixel[LEFT], feature.pixel[RIGHT]);
        std::swap(feature.bearing[LEFT], feature.bearing[RIGHT]);
      }
    };
    world.run();
    EXPECT_TRUE(world.outcome == Outcome::FEW_FEATURES || world.outcome == Outcome::NOT_CONSISTENT);
    EXPECT_EQ(world.counts[Outcome::DONE], 0);
    EXPECT_NE(world.message, "");
  }
}

TEST(Initializer, IsNeverDoneWithAxesOfTheGyroSwapped)
{
  // The gyro's x and y are swapped.
  World world(handHeld(0.0));
  ImuModel model;
  ImuBuffer buffer(model);
  for (ImuSample sample : ImuSimulator(world.imu).simulate(world.trajectory, START_NS, START_NS + 4500000000LL))
  {
    sample.w = Eigen::Vector3d(sample.w.y(), sample.w.x(), sample.w.z());
    buffer.add(sample);
  }
  SimulatedFeatures front_end(world.trajectory, world.calibration, world.features);
  Initializer initializer(world.calibration, model, world.options);
  int inconsistent = 0;
  for (int i = 0; i < 80; ++i)
  {
    const Outcome outcome = initializer.add(front_end.at(world.first_ns + i * 50000000LL), buffer, &world.solution);
    ASSERT_NE(outcome, Outcome::DONE) << i;
    inconsistent += outcome == Outcome::NOT_CONSISTENT;
  }
  EXPECT_GT(inconsistent, 10);
  EXPECT_NE(initializer.message(), "");
}

TEST(Initializer, RefusesAForceThatIsNotGravityAtRest)
{
  World world(atRest(0.0, 0.0));
  world.imu.gravity = 0.981;  // g, not m/s^2, give or take
  world.run();
  EXPECT_EQ(world.outcome, Outcome::NOT_CONSISTENT);
  EXPECT_NE(world.message.find("mean force at rest is 1.0"), std::string::npos) << world.message;
}

TEST(Initializer, BeginsAnewWhenTheClockJumpsBack)
{
  World world(handHeld(0.0));
  ImuModel model;
  ImuBuffer buffer(model);
  for (const ImuSample& sample : ImuSimulator(world.imu).simulate(world.trajectory, START_NS, START_NS + 4500000000LL))
  {
    buffer.add(sample);
  }
  Initializer initializer(world.calibration, model, world.options);
  SimulatedFeatures later(world.trajectory, world.calibration, world.features);
  for (int i = 0; i < 10; ++i)
  {
    EXPECT_EQ(initializer.add(later.at(world.first_ns + 2000000000LL + i * 50000000LL), buffer, &world.solution),
              Outcome::COLLECTING);
  }
  SimulatedFeatures front_end(world.trajectory, world.calibration, world.features);
  for (int i = 0; i < 80 && world.outcome != Outcome::DONE; ++i)
  {
    world.outcome = initializer.add(front_end.at(world.first_ns + i * 50000000LL), buffer, &world.solution);
  }
  world.expectTrue(1.0 * DEGREE, 0.05, 0.005, 0.03);
  EXPECT_EQ(world.solution.states.front().stamp_ns, world.first_ns);
}

TEST(Initializer, IsDeterministic)
{
  World first(handHeld(0.9));
  World again(handHeld(0.9));
  first.run();
  again.run();
  ASSERT_EQ(first.outcome, Outcome::DONE);
  ASSERT_EQ(again.outcome, Outcome::DONE);
  EXPECT_EQ(first.solution.states.back().boxMinus(again.solution.states.back()), Vector15d::Zero());
}

TEST(Initializer, SurvivesBearingsThatAreNotFinite)
{
  World world(handHeld(0.0));
  world.change = [](FrameFeatures* frame, int i)
  {
    for (size_t k = 0; k < frame->features.size(); k += 5)
    {
      const double bad = i % 2 == 0 ? std::numeric_limits<double>::quiet_NaN() : 1e300;
      frame->features[k].bearing[k % 2].setConstant(bad);
      frame->features[k].pixel[k % 2].setConstant(static_cast<float>(bad));
    }
  };
  world.run();
  world.expectTrue(1.0 * DEGREE, 0.06, 0.006, 0.04);
}

TEST(Initializer, StartsOnARealClipFromItsFirstPairs)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  const std::string clip = data == nullptr ? "" : std::string(data) + "/slam/mh01_first10s";
  if (!std::filesystem::exists(clip + "/mav0/cam0/data.csv"))
  {
    GTEST_SKIP() << "PI_EDGE_DATA has no slam/mh01_first10s";
  }
  const std::string mav = clip + "/mav0/";
  const StereoCalibration calibration =
      StereoCalibration::loadEuroc(mav + "cam0/sensor.yaml", mav + "cam1/sensor.yaml");
  const ImuModel model = ImuModel::loadYaml(mav + "imu0/sensor.yaml");
  ImuBuffer imu(model);
  for (const std::string& line : readImuLog(mav + "imu0/data.csv").lines)
  {
    ImuSample sample;
    char comma = ',';
    std::istringstream cells(line);
    cells >> sample.stamp_ns >> comma >> sample.w.x() >> comma >> sample.w.y() >> comma >> sample.w.z() >> comma >>
        sample.f.x() >> comma >> sample.f.y() >> comma >> sample.f.z();
    imu.add(sample);
  }
  const SplineTrajectory truth = SplineTrajectory::fit(readTrajectory(clip + "/groundtruth_tum.txt"));

  StereoTracker tracker(calibration, StereoTrackerOptions());
  Initializer initializer(calibration, model, InitializerOptions());
  InitialSolution solution;
  Outcome outcome = Outcome::COLLECTING;
  std::ifstream list(mav + "cam0/data.csv");
  int64_t last_ns = 0;
  int pairs = 0;
  for (std::string line; outcome != Outcome::DONE && pairs < 31 && std::getline(list, line);)
  {
    if (line.front() == '#')
    {
      continue;
    }
    const int64_t stamp_ns = std::stoll(line);
    const std::string name = std::to_string(stamp_ns) + ".png";
    const cv::Mat left = cv::imread(mav + "cam0/data/" + name, cv::IMREAD_GRAYSCALE);
    const cv::Mat right = cv::imread(mav + "cam1/data/" + name, cv::IMREAD_GRAYSCALE);
    TrackerPrediction prediction;
    if (pairs > 0)
    {
      prediction.R_last_now = imu.integrate(last_ns, stamp_ns, ImuBias(), nullptr).deltaR();
    }
    TrackerReport report;
    outcome = initializer.add(
        tracker.process(stamp_ns, left, right, prediction, StereoTrackerOptions().max_features, &report), imu,
        &solution);
    last_ns = stamp_ns;
    ++pairs;
  }
  ASSERT_EQ(outcome, Outcome::DONE) << initializer.message();
  EXPECT_FALSE(solution.still);
  // 1.5 s of a clip that moves from its first picture on; the accelerometer's bias tilts gravity by half a degree.
  const NavState& state = solution.states.back();
  const SplineTrajectory::State expected = truth.at(state.stamp_ns);
  const Eigen::Matrix3d R_body_world = expected.T_world_body.linear().transpose();
  EXPECT_LT((state.q.conjugate() * Eigen::Vector3d::UnitZ()).cross(R_body_world * Eigen::Vector3d::UnitZ()).norm(),
            1.5 * DEGREE);
  EXPECT_LT((state.q.conjugate() * state.v - R_body_world * expected.v_world).norm(), 0.1);
  EXPECT_LT((state.bias.gyro - Eigen::Vector3d(-0.002, 0.021, 0.077)).norm(), 0.01);
}

TEST(Initializer, RefusesOptionsOutOfRangeByName)
{
  const auto complaint = [](const std::function<void(InitializerOptions*)>& change)
  {
    InitializerOptions options;
    change(&options);
    return messageOf<std::invalid_argument>(
        [&] { Initializer(StereoCalibration::makeForwardPair(), ImuModel(), options); });
  };
  EXPECT_EQ(complaint([](InitializerOptions*) {}), "");
  EXPECT_EQ(complaint([](InitializerOptions* o) { o->interval_s = 0.0; }),
            "initializer/interval_s = 0, must be in [0.02, 1]");
  EXPECT_NE(complaint([](InitializerOptions* o) { o->max_window_s = 0.8; }).find("max_window_s"), std::string::npos);
  EXPECT_NE(complaint([](InitializerOptions* o) { o->min_features = 3; }).find("min_features"), std::string::npos);
  EXPECT_NE(complaint([](InitializerOptions* o) { o->still_window_s = 9.0; }).find("still_window_s"),
            std::string::npos);
  EXPECT_NE(complaint([](InitializerOptions* o) { o->moving_window_s = 0.1; }).find("moving_window_s"),
            std::string::npos);
  EXPECT_NE(complaint([](InitializerOptions* o) { o->gravity_tolerance = 0.0; }).find("gravity_tolerance"),
            std::string::npos);
  EXPECT_NE(complaint([](InitializerOptions* o) { o->max_accel_bias = -1.0; }).find("max_accel_bias"),
            std::string::npos);
  EXPECT_NE(complaint([](InitializerOptions* o) { o->max_gyro_bias = 0.0; }).find("max_gyro_bias"), std::string::npos);
}
