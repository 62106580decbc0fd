#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include "initialization/standstill_detector.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>

using namespace pi_slam;
using pi_node::test_support::messageOf;

namespace
{

constexpr int64_t START_NS = 1700000000000000000LL;

int64_t stampAt(double time_s)
{
  return START_NS + std::llround(1e9 * time_s);
}

FeatureObservation makeFeature(int64_t id, int camera, const Eigen::Vector2f& pixel)
{
  FeatureObservation feature;
  feature.id = id;
  for (const int side : {LEFT, RIGHT})
  {
    feature.seen[side] = side == camera;
    feature.pixel[side] = side == camera ? pixel : Eigen::Vector2f(0.0F, 0.0F);
    feature.bearing[side] = Eigen::Vector3d::UnitZ();
  }
  return feature;
}

/// 458 px of focal length.
const StereoCalibration& cameras()
{
  static const StereoCalibration calibration = StereoCalibration::makeForwardPair(916, 687, 0.12);
  return calibration;
}

/// Two cameras that look along x at points on a grid, 3 to 8 m away, and an IMU, each with its noise.
struct Scene
{
  double pair_rate_hz = 20.0;
  double pixel_noise = 0.1;
  double scale = 1.0;  ///< of the points' distances
  ImuModel model;
  StandstillOptions options;
  ImuBias bias{Eigen::Vector3d(0.01, -0.02, 0.08), Eigen::Vector3d(0.1, 0.0, -0.1)};
  std::function<Eigen::Vector3d(double)> position = [](double) { return Eigen::Vector3d::Zero().eval(); };
  std::function<Eigen::Vector3d(double)> picture = [](double)
  { return Eigen::Vector3d::Zero().eval(); };  ///< of it alone
  double crowd = 1.0;                          ///< part of it that moves so
  bool bonnet = false;                         ///< the rest of it is the vehicle itself
  std::function<double(double)> yaw = [](double) { return 0.0; };
  std::function<Eigen::Vector3d(double)> shake = [](double) { return Eigen::Vector3d::Zero().eval(); };  ///< [m/s^2]
  std::function<std::optional<bool>(double)> wheels = [](double) { return std::nullopt; };               ///< at rest
  std::function<bool(double)> lit = [](double) { return true; };

  /// Verdict at each pair.
  std::vector<bool> run(double duration_s)
  {
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    ImuBuffer imu(model);
    const double root_rate = std::sqrt(model.rate_hz);
    constexpr double H = 1e-3;
    for (double t = -1.0; t < duration_s + 0.1; t += 1.0 / model.rate_hz)
    {
      ImuSample sample;
      sample.stamp_ns = stampAt(t);
      const auto noise = [&] { return Eigen::Vector3d{normal(random), normal(random), normal(random)}; };
      sample.w = bias.gyro + root_rate * model.gyro_noise_density * noise();
      sample.w.z() += (yaw(t + H) - yaw(t - H)) / (2.0 * H);
      sample.f = bias.accel + Eigen::Vector3d(0.0, 0.0, 9.81) + shake(t) +
                 root_rate * model.accel_noise_density * noise() +
                 (position(t + H) - 2.0 * position(t) + position(t - H)) / (H * H);
      imu.add(sample);
    }
    StandstillDetector detector(cameras(), model, options);
    std::vector<bool> verdicts;
    for (int i = 0; i < duration_s * pair_rate_hz; ++i)
    {
      const double t = i / pair_rate_hz;
      FrameFeatures frame;
      frame.stamp_ns = stampAt(t);
      for (int k = 0; k < 100 && lit(t); ++k)
      {
        const double depth = scale * (3.0 + 5.0 * std::fmod(k * 0.618, 1.0));
        const Eigen::Vector3d point(depth, depth * (0.1 * (k % 10) - 0.45), depth * (0.06 * (k / 10) - 0.27));
        const bool passes = k % 20 < 20.0 * crowd;
        const Eigen::Vector3d moved = (passes || !bonnet ? 1.0 : 0.0) * position(t) + (passes ? 1.0 : 0.0) * picture(t);
        const Eigen::Vector3d seen = Eigen::AngleAxisd(-yaw(t), Eigen::Vector3d::UnitZ()) * (point - moved);
        FeatureObservation feature;
        feature.id = k;
        for (const int camera : {LEFT, RIGHT})
        {
          const MountedCamera& mounted = camera == LEFT ? cameras().left : cameras().right;
          const Eigen::Vector2d pixel = *mounted.model.project(mounted.T_body_camera.inverse() * seen) +
                                        pixel_noise * Eigen::Vector2d{normal(random), normal(random)};
          feature.seen[camera] = true;
          feature.pixel[camera] = pixel.cast<float>();
          feature.bearing[camera] = *mounted.model.unproject(pixel);
        }
        frame.features.push_back(feature);
      }
      const double speed = (position(t + H) - position(t - H)).norm() / (2.0 * H);
      verdicts.push_back(detector.update(frame, imu, bias, wheels(t), speed));
      picture_moves_from_s = !detector.pictureMoves() ? -1.0 : picture_moves_from_s < 0.0 ? t : picture_moves_from_s;
      since_ns = detector.sinceNs();
      flow_px = detector.flowPx();
    }
    return verdicts;
  }

  int64_t since_ns = 0;
  double picture_moves_from_s = -1.0;  ///< below 0: it does not
  double flow_px = 0.0;
};

int count(const std::vector<bool>& verdicts, size_t from = 0)
{
  return static_cast<int>(std::count(verdicts.begin() + static_cast<long>(from), verdicts.end(), true));
}

/// From rest: 0.05 m/s after a smooth start of half a second.
Eigen::Vector3d creep(double t, const Eigen::Vector3d& direction, double speed = 0.05)
{
  const double s = std::clamp(t, 0.0, 0.5);
  return speed * (s * s + std::max(0.0, t - 0.5)) * direction;
}

}  // namespace

TEST(StandstillDetector, SaysYesOnceAWindowHasPassedAtRest)
{
  for (const double rate_hz : {10.0, 20.0, 60.0})
  {
    SCOPED_TRACE(rate_hz);
    Scene scene;
    scene.pair_rate_hz = rate_hz;
    const auto verdicts = scene.run(5.0);
    const auto window = static_cast<size_t>(std::lround(0.4 * rate_hz));
    for (size_t i = 0; i < verdicts.size(); ++i)
    {
      // Pairs to compare with are kept every eighth of the window.
      EXPECT_EQ(verdicts[i], i >= window + (i < window + rate_hz * 0.06 && !verdicts[i] ? 5 : 0)) << i;
    }
    EXPECT_EQ(scene.since_ns, START_NS);
    EXPECT_GT(scene.flow_px, 0.0);
    EXPECT_LT(scene.flow_px, 0.35);
  }
}

TEST(StandstillDetector, IsNotMisledByARunningMotor)
{
  Scene scene;
  scene.shake = [](double t)
  { return Eigen::Vector3d(0.2 * std::sin(2.0 * M_PI * 28.0 * t), 0.0, 0.4 * std::sin(2.0 * M_PI * 33.0 * t)); };
  EXPECT_GE(count(scene.run(5.0)), 90);
}

TEST(StandstillDetector, SeesSlowMotion)
{
  for (const double rate_hz : {20.0, 60.0})
  {
    for (const Eigen::Vector3d& direction :
         {Eigen::Vector3d(Eigen::Vector3d::UnitX()), Eigen::Vector3d(Eigen::Vector3d::UnitY())})
    {
      Scene scene;
      scene.pair_rate_hz = rate_hz;
      // Under way before the first pair, at constant speed: the IMU sees nothing of it.
      scene.position = [=](double t) { return creep(t + 5.0, direction); };
      EXPECT_EQ(count(scene.run(5.0)), 0) << rate_hz << " " << direction.transpose();
    }
  }
}

TEST(StandstillDetector, NoticesThatItSetsOffSlowly)
{
  Scene scene;
  scene.position = [](double t) { return creep(t - 3.0, Eigen::Vector3d::UnitX()); };
  const auto verdicts = scene.run(6.0);
  EXPECT_EQ(count({verdicts.begin() + 10, verdicts.begin() + 60}), 50);
  // After one window at full speed at the latest.
  EXPECT_EQ(count(verdicts, 60 + 10 + 9), 0);
}

TEST(StandstillDetector, SeesCreepingByTheWaySinceTheRestBegan)
{
  for (const double speed : {0.01, 0.02, 0.04})
  {
    SCOPED_TRACE(speed);
    Scene scene;
    scene.scale = 4.0;  // 12 to 32 m away
    scene.position = [=](double t) { return creep(t - 3.0, Eigen::Vector3d::UnitX(), speed); };
    const auto verdicts = scene.run(20.0);
    EXPECT_EQ(count({verdicts.begin() + 10, verdicts.begin() + 60}), 50);
    // 1 cm may go by unseen, and as much by the noise of the pictures.
    const auto seen = static_cast<size_t>((3.25 + 0.02 / speed) * 20.0);
    EXPECT_LE(count(verdicts, seen), static_cast<int>(verdicts.size() - seen) / 20);
  }
}

TEST(StandstillDetector, BelievesWheelsThatStandWhateverThePictureShows)
{
  // A train passes that fills the picture.
  Scene scene;
  scene.wheels = [](double) { return true; };
  scene.picture = [](double t) { return Eigen::Vector3d(0.0, 0.5 * std::max(0.0, t - 2.0), 0.0); };
  const auto verdicts = scene.run(6.0);
  EXPECT_EQ(count(verdicts, 10), static_cast<int>(verdicts.size()) - 10);
  EXPECT_NEAR(scene.picture_moves_from_s, 2.2, 0.3);
  // Without wheels that is motion: it begins slowly, and nothing contradicts it.
  scene.wheels = [](double) { return std::nullopt; };
  EXPECT_EQ(count(scene.run(6.0), 60), 0);
}

TEST(StandstillDetector, RestsOnWhilePeopleFillMostOfThePicture)
{
  for (const double crowd : {0.65, 0.9})
  {
    SCOPED_TRACE(crowd);
    Scene scene;
    scene.crowd = crowd;
    scene.picture = [](double t) { return Eigen::Vector3d(0.0, std::max(0.0, 0.3 * (t - 4.0)), 0.0); };
    const auto verdicts = scene.run(16.0);
    EXPECT_GE(count(verdicts, 10), static_cast<int>(verdicts.size()) - 12);  // a pair or two when they set off
    EXPECT_NEAR(scene.picture_moves_from_s, 4.3, 0.4);
  }
}

TEST(StandstillDetector, SetsOffByTheImuWhilePeopleFillThePicture)
{
  Scene scene;
  scene.bonnet = true;  // so part of the picture never moves
  scene.crowd = 0.8;
  scene.picture = [](double t) { return Eigen::Vector3d(0.0, std::max(0.0, 0.3 * (t - 4.0)), 0.0); };
  // From 8 s on with 0.1 m/s^2 up to 0.5 m/s.
  scene.position = [](double t)
  {
    const double s = std::clamp(t - 8.0, 0.0, 5.0);
    return Eigen::Vector3d(0.05 * s * s + 0.5 * std::max(0.0, t - 13.0), 0.0, 0.0);
  };
  const auto verdicts = scene.run(16.0);
  EXPECT_GE(count({verdicts.begin() + 10, verdicts.begin() + 160}), 148);
  EXPECT_EQ(count(verdicts, 20 * 9), 0);
}

TEST(StandstillDetector, StopsBehindPeopleWhoFillThePicture)
{
  // At rest until 4 s, 1 m in 3 s, at rest again; people pass from 5 s on.
  Scene scene;
  scene.crowd = 0.65;
  scene.picture = [](double t) { return Eigen::Vector3d(0.0, std::max(0.0, 0.3 * (t - 5.0)), 0.0); };
  scene.position = [](double t)
  {
    const double s = std::clamp((t - 4.0) / 3.0, 0.0, 1.0);
    return Eigen::Vector3d(s * s * s * (10.0 - 15.0 * s + 6.0 * s * s), 0.0, 0.0);
  };
  const auto verdicts = scene.run(14.0);
  EXPECT_EQ(count({verdicts.begin() + 100, verdicts.begin() + 135}), 0);
  EXPECT_EQ(count(verdicts, 180), static_cast<int>(verdicts.size()) - 180);
}

TEST(StandstillDetector, SeesMotionByTheWheelsAtOnce)
{
  Scene scene;
  scene.wheels = [](double t) { return t < 3.0; };
  const auto verdicts = scene.run(6.0);
  EXPECT_EQ(count({verdicts.begin() + 10, verdicts.begin() + 60}), 50);
  EXPECT_EQ(count(verdicts, 60), 0);
}

TEST(StandstillDetector, DoesNotBelieveWheelsThatStandWhileTheImuMoves)
{
  Scene scene;
  scene.wheels = [](double) { return true; };
  scene.shake = [](double t) { return Eigen::Vector3d(0.5 * std::sin(2.0 * M_PI * 1.5 * t), 0.0, 0.0); };
  EXPECT_EQ(count(scene.run(4.0)), 0);
}

TEST(StandstillDetector, RestsForLong)
{
  Scene scene;
  scene.scale = 4.0;
  const auto verdicts = scene.run(120.0);
  EXPECT_GE(count(verdicts, 10), static_cast<int>(verdicts.size()) - 20);
}

TEST(StandstillDetector, SeesASlowTurn)
{
  Scene scene;
  scene.yaw = [](double t) { return 2.0 * M_PI / 180.0 * t; };
  EXPECT_EQ(count(scene.run(4.0)), 0);
  // Also where the estimated bias hides it from the gyro: pictures see it.
  scene.options.max_rate = 1.0;
  EXPECT_EQ(count(scene.run(4.0)), 0);
}

TEST(StandstillDetector, SeesMotionByTheImuAloneWherePicturesDoNot)
{
  // Everything in view moves with the body (a load on the vehicle).
  Scene scene;
  scene.shake = [](double t) { return Eigen::Vector3d(0.5 * std::sin(2.0 * M_PI * 1.5 * t), 0.0, 0.0); };
  EXPECT_EQ(count(scene.run(4.0)), 0);
}

TEST(StandstillDetector, SaysNoWithoutPictures)
{
  Scene scene;
  scene.lit = [](double t) { return t < 2.0 || t > 4.0; };
  const auto verdicts = scene.run(6.0);
  EXPECT_EQ(count({verdicts.begin() + 10, verdicts.begin() + 40}), 30);
  EXPECT_EQ(count({verdicts.begin() + 40, verdicts.begin() + 80}), 0);
  EXPECT_GE(count(verdicts, 100), 20);
}

TEST(StandstillDetector, SaysNoWithoutAnImu)
{
  StandstillDetector detector{cameras(), ImuModel(), StandstillOptions()};
  const ImuBuffer imu{ImuModel()};
  FrameFeatures frame;
  for (int k = 0; k < 50; ++k)
  {
    frame.features.push_back(makeFeature(k, RIGHT, Eigen::Vector2f(10.0F * static_cast<float>(k), 100.0F)));
  }
  for (int i = 0; i < 40; ++i)
  {
    frame.stamp_ns = stampAt(0.05 * i);
    EXPECT_FALSE(detector.update(frame, imu, ImuBias()));
  }
  EXPECT_EQ(detector.flowPx(), 0.0);  // by the right camera alone
}

TEST(StandstillDetector, DoesNotChatterAtItsBounds)
{
  // Noise at the bound: the median of the flow is 0.35 px, give or take.
  Scene scene;
  scene.pixel_noise = 0.21;
  const auto verdicts = scene.run(30.0);
  int changes = 0;
  for (size_t i = 1; i < verdicts.size(); ++i)
  {
    changes += verdicts[i] != verdicts[i - 1];
  }
  EXPECT_LE(changes, 3);
  EXPECT_GE(count(verdicts), 100);
}

TEST(StandstillDetector, BeginsAnewAfterAPauseOrAJumpBack)
{
  StandstillDetector detector{cameras(), ImuModel(), StandstillOptions()};
  ImuBuffer imu{ImuModel()};
  for (int i = 0; i <= 4000; ++i)
  {
    imu.add(ImuSample{stampAt(0.005 * i), Eigen::Vector3d::Zero(), Eigen::Vector3d(0.0, 0.0, 9.81)});
  }
  FrameFeatures frame;
  for (int k = 0; k < 50; ++k)
  {
    frame.features.push_back(makeFeature(k, LEFT, Eigen::Vector2f(10.0F * static_cast<float>(k), 100.0F)));
  }
  const auto verdictAt = [&](double time_s)
  {
    frame.stamp_ns = stampAt(time_s);
    return detector.update(frame, imu, ImuBias());
  };
  for (double t = 5.0; t < 7.0; t += 0.05)
  {
    EXPECT_EQ(verdictAt(t), t > 5.399) << t;
  }
  EXPECT_FALSE(verdictAt(9.0));
  for (double t = 9.05; t < 10.0; t += 0.05)
  {
    EXPECT_EQ(verdictAt(t), t > 9.399) << t;
  }
  EXPECT_FALSE(verdictAt(4.0));
  detector.reset();
  EXPECT_FALSE(verdictAt(4.5));
  EXPECT_LT(detector.flowPx(), 0.0);
}

TEST(StandstillDetector, CanBeTurnedOff)
{
  Scene scene;
  scene.options.enabled = false;
  EXPECT_EQ(count(scene.run(2.0)), 0);
}

TEST(StandstillDetector, RefusesOptionsOutOfRangeByName)
{
  const auto complaint = [](double StandstillOptions::*field, double value)
  {
    StandstillOptions options;
    options.*field = value;
    return messageOf<std::invalid_argument>([&] { StandstillDetector(cameras(), ImuModel(), options); });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(complaint(&StandstillOptions::window_s, 0.0), "standstill/window_s = 0, must be in [0.1, 5]");
  EXPECT_NE(complaint(&StandstillOptions::max_flow_px, nan).find("standstill/max_flow_px"), std::string::npos);
  EXPECT_NE(complaint(&StandstillOptions::max_gyro_deviation, 0.0).find("standstill/max_gyro_deviation"),
            std::string::npos);
  EXPECT_NE(complaint(&StandstillOptions::max_accel_deviation, -1.0).find("standstill/max_accel_deviation"),
            std::string::npos);
  EXPECT_NE(complaint(&StandstillOptions::max_rate, nan).find("standstill/max_rate"), std::string::npos);
}
