#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "front_end/motion_check.h"

using namespace pi_slam;
using namespace pi_slam::front_end;

namespace
{

using Vector3 = Eigen::Vector3d;

constexpr double TOLERANCE_PX = 1.0;
constexpr double ROTATION_SIGMA_RAD = 0.007;

const StereoGeometry& geometry()
{
  static const StereoGeometry geometry(StereoCalibration::makeForwardPair(640, 480, 0.12));
  return geometry;
}

struct Scene
{
  std::vector<MovedFeature> features;
  std::vector<uint8_t> moves;  ///< by itself
  BodyMotion truth;
};

/// Points 2 to 20 m in front of the left camera; the first `moving` of them go 0.1 to 0.3 m on their own, all alike.
Scene makeScene(int points, int moving, const Vector3& step, bool has_depth, double noise_px = 0.2)
{
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::normal_distribution<double> normal(0.0, noise_px / geometry().focal(LEFT));
  Scene scene;
  scene.truth.R_now_last = Eigen::AngleAxisd(0.03, Vector3(0.2, -0.3, 0.9).normalized()).toRotationMatrix();
  scene.truth.p_now_last = -step;
  const Eigen::Isometry3d& T_body_camera = geometry().T_body_camera(LEFT);
  for (int i = 0; i < points; ++i)
  {
    const double depth = 2.0 * std::pow(10.0, 0.5 * (1.0 + uniform(random)));
    const Vector3 p_camera{0.8 * uniform(random) * depth, 0.6 * uniform(random) * depth, depth};
    Vector3 p_body = T_body_camera * p_camera;
    MovedFeature feature;
    feature.bearing_last = p_camera.normalized();
    feature.has_depth = has_depth;
    feature.inverse_distance = 1.0 / p_camera.norm();
    if (i < moving)
    {
      p_body += Vector3(0.05, 0.2, 0.1) * depth / 4.0;
    }
    const Vector3 p_now = T_body_camera.inverse() * (scene.truth.R_now_last * p_body + scene.truth.p_now_last);
    feature.bearing_now = (p_now.normalized() + Vector3{normal(random), normal(random), 0.0}).normalized();
    scene.features.push_back(feature);
    scene.moves.push_back(i < moving ? 1 : 0);
  }
  return scene;
}

struct Verdict
{
  int moving_found = 0;
  int still_lost = 0;
};

Verdict judge(const Scene& scene, const std::vector<uint8_t>& consistent)
{
  Verdict verdict;
  for (size_t i = 0; i < scene.moves.size(); ++i)
  {
    verdict.moving_found += scene.moves[i] == 1 && consistent[i] == 0 ? 1 : 0;
    verdict.still_lost += scene.moves[i] == 0 && consistent[i] == 0 ? 1 : 0;
  }
  return verdict;
}

BodyMotion gyroOf(const Scene& scene, double error_rad = 0.0)
{
  BodyMotion motion;
  motion.R_now_last = Eigen::AngleAxisd(error_rad, Vector3(0.6, 0.0, -0.8)).toRotationMatrix() * scene.truth.R_now_last;
  return motion;
}

}  // namespace

TEST(MotionCheck, FindsMotionAndMovingThingsByDepth)
{
  MotionCheck check(geometry(), TOLERANCE_PX);
  std::vector<uint8_t> consistent;
  for (const int moving : {0, 20, 40})
  {
    for (const Vector3& step : {Vector3(0.0, 0.0, 0.0), Vector3(0.15, 0.02, -0.01), Vector3(0.6, 0.0, 0.0)})
    {
      const Scene scene = makeScene(100, moving, step, true);
      BodyMotion motion = gyroOf(scene, 0.004);
      ASSERT_TRUE(check.check(scene.features, ROTATION_SIGMA_RAD, &motion, &consistent));
      const Verdict verdict = judge(scene, consistent);
      EXPECT_GE(verdict.moving_found, moving * 9 / 10) << moving << " move, " << step.transpose();
      EXPECT_LE(verdict.still_lost, 2) << moving << " move, " << step.transpose();
      EXPECT_LT((motion.p_now_last - scene.truth.p_now_last).norm(), 0.01);
      EXPECT_LT(Eigen::AngleAxisd(motion.R_now_last * scene.truth.R_now_last.transpose()).angle(), 0.002);
    }
  }
}

TEST(MotionCheck, TakesTheExpectedMotionWherePeopleFillThePicture)
{
  MotionCheck check(geometry(), TOLERANCE_PX);
  std::vector<uint8_t> consistent;
  for (const int moving : {65, 85})
  {
    const Scene scene = makeScene(100, moving, Vector3(0.1, 0.0, 0.0), true);
    BodyMotion motion = gyroOf(scene, 0.004);
    ASSERT_TRUE(check.check(scene.features, ROTATION_SIGMA_RAD, &motion, &consistent, &scene.truth));
    EXPECT_TRUE(check.othersMove());
    const Verdict verdict = judge(scene, consistent);
    EXPECT_GE(verdict.moving_found, moving * 9 / 10);
    EXPECT_LE(verdict.still_lost, 2);
  }
}

TEST(MotionCheck, DoesNotBelieveAnExpectedMotionThatPicturesContradict)
{
  MotionCheck check(geometry(), TOLERANCE_PX);
  std::vector<uint8_t> consistent;
  for (const int moving : {0, 30})
  {
    const Scene scene = makeScene(100, moving, Vector3(0.4, 0.0, 0.0), true);
    BodyMotion wrong = scene.truth;
    wrong.p_now_last *= 0.5;
    BodyMotion motion = gyroOf(scene, 0.004);
    ASSERT_TRUE(check.check(scene.features, ROTATION_SIGMA_RAD, &motion, &consistent, &wrong));
    EXPECT_FALSE(check.othersMove()) << moving;
    EXPECT_LT((motion.p_now_last - scene.truth.p_now_last).norm(), 0.01);
  }
}

TEST(MotionCheck, FindsMovingThingsByDirectionsAlone)
{
  MotionCheck check(geometry(), TOLERANCE_PX);
  const Scene scene = makeScene(100, 20, Vector3(0.4, 0.0, 0.0), false);
  BodyMotion motion = gyroOf(scene);
  std::vector<uint8_t> consistent;
  EXPECT_FALSE(check.check(scene.features, ROTATION_SIGMA_RAD, &motion, &consistent));
  EXPECT_TRUE(motion.p_now_last.isZero());
  const Verdict verdict = judge(scene, consistent);
  EXPECT_GE(verdict.moving_found, 12);  // some happen to move along their epipolar lines
  EXPECT_LE(verdict.still_lost, 3);
}

TEST(MotionCheck, LeavesAllInPeaceWithoutParallax)
{
  MotionCheck check(geometry(), TOLERANCE_PX);
  const Scene scene = makeScene(100, 0, Vector3::Zero(), false);
  BodyMotion motion = gyroOf(scene);
  std::vector<uint8_t> consistent;
  check.check(scene.features, ROTATION_SIGMA_RAD, &motion, &consistent);
  EXPECT_EQ(judge(scene, consistent).still_lost, 0);
}

TEST(MotionCheck, NeverRejectsMostFeatures)
{
  MotionCheck check(geometry(), TOLERANCE_PX);
  Scene scene = makeScene(60, 0, Vector3(0.1, 0.0, 0.0), true);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-0.3, 0.3);
  for (MovedFeature& feature : scene.features)
  {
    feature.bearing_now = Vector3{uniform(random), uniform(random), 1.0}.normalized();
  }
  BodyMotion motion = gyroOf(scene);
  std::vector<uint8_t> consistent;
  EXPECT_FALSE(check.check(scene.features, ROTATION_SIGMA_RAD, &motion, &consistent));
  EXPECT_EQ(judge(scene, consistent).still_lost, 0);
  EXPECT_TRUE(motion.p_now_last.isZero());
  EXPECT_TRUE(motion.R_now_last.isApprox(scene.truth.R_now_last));
}

TEST(MotionCheck, AcceptsFewAndNoFeatures)
{
  MotionCheck check(geometry(), TOLERANCE_PX);
  std::vector<uint8_t> consistent{1, 2, 3};
  for (const int points : {0, 1, 5})
  {
    const Scene scene = makeScene(points, 0, Vector3(0.1, 0.0, 0.0), true);
    BodyMotion motion = gyroOf(scene);
    EXPECT_FALSE(check.check(scene.features, ROTATION_SIGMA_RAD, &motion, &consistent));
    EXPECT_EQ(consistent, std::vector<uint8_t>(static_cast<size_t>(points), 1));
  }
}

TEST(MotionCheck, PointsFarAwayHoldNoTranslationBack)
{
  MotionCheck check(geometry(), TOLERANCE_PX);
  Scene scene = makeScene(80, 0, Vector3::Zero(), true);
  for (MovedFeature& feature : scene.features)
  {
    feature.inverse_distance = 0.0;
    const Eigen::Matrix3d R_body_camera = geometry().T_body_camera(LEFT).linear();
    feature.bearing_now = R_body_camera.transpose() * scene.truth.R_now_last * R_body_camera * feature.bearing_last;
  }
  BodyMotion motion = gyroOf(scene, 0.003);
  std::vector<uint8_t> consistent;
  EXPECT_TRUE(check.check(scene.features, ROTATION_SIGMA_RAD, &motion, &consistent));
  EXPECT_TRUE(motion.p_now_last.allFinite());
  EXPECT_LT(motion.p_now_last.norm(), 0.01);
  EXPECT_EQ(judge(scene, consistent).still_lost, 0);
}
