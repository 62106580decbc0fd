#include <gtest/gtest.h>
#include <pi_detect/stereo_obstacles.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>
#include <random>

#include "obstacles/stereo_on_mast.h"

namespace pi_detect
{
namespace
{

/// A block whose front is at x; base_link, as if the ground were level.
struct Block
{
  double x;
  double y_low;
  double y_high;
  double z_low;
  double z_high;
};

/// Depth of a plane with a slope along x, and of fronts of blocks.
struct Scene
{
  StereoGeometry geometry = makeGeometry();
  double slope = 0.0;   ///< dz / dx of the ground
  double step_m = 0.0;  ///< its height at base_link
  std::vector<Block> blocks;

  /// Along the optical axis; 0: nothing.
  double depth(double u, double v) const
  {
    const double side = -(u - geometry.cx) / geometry.fx;  // y and z per metre of x
    const double rise = -(v - geometry.cy) / geometry.fy;
    double nearest = std::numeric_limits<double>::infinity();
    for (const Block& block : blocks)
    {
      const double y = side * block.x;
      const double z = CAMERA_HEIGHT_M + rise * block.x;
      if (y >= block.y_low && y <= block.y_high && z >= block.z_low && z <= block.z_high)
      {
        nearest = std::min(nearest, block.x);
      }
    }
    const double x = (CAMERA_HEIGHT_M - step_m) / (slope - rise);
    if (x > 0.0)
    {
      nearest = std::min(nearest, x);
    }
    return nearest < 60.0 ? nearest : 0.0;
  }

  cv::Mat disparity() const
  {
    cv::Mat picture(geometry.height, geometry.width, CV_32FC1, cv::Scalar(-1.0));
    for (int v = 0; v < picture.rows; ++v)
    {
      for (int u = 0; u < picture.cols; ++u)
      {
        const double z = depth(u, v);
        if (z > 0.0)
        {
          picture.at<float>(v, u) = static_cast<float>(geometry.fx * geometry.baseline_m / z);
        }
      }
    }
    return picture;
  }
};

/// Smooth random texture, the same for the same point of the left picture.
cv::Mat makeTexture(int width, int height)
{
  cv::Mat texture(height, width, CV_8UC1);
  std::mt19937 random(5);
  std::uniform_int_distribution<int> level(0, 255);
  for (int v = 0; v < height; ++v)
  {
    for (int u = 0; u < width; ++u)
    {
      texture.at<uint8_t>(v, u) = static_cast<uint8_t>(level(random));
    }
  }
  cv::Mat smooth = texture.clone();
  for (int v = 1; v + 1 < height; ++v)
  {
    for (int u = 1; u + 1 < width; ++u)
    {
      int sum = 0;
      for (int i = 0; i < 9; ++i)
      {
        sum += texture.at<uint8_t>(v - 1 + i / 3, u - 1 + i % 3);
      }
      smooth.at<uint8_t>(v, u) = static_cast<uint8_t>(sum / 9);
    }
  }
  return smooth;
}

struct Pair
{
  cv::Mat left;
  cv::Mat right;
};

/// Each pixel of the right picture takes the level of the nearest point of the left one that is seen there.
Pair makePair(const Scene& scene)
{
  Pair pair;
  const cv::Mat disparity = scene.disparity();
  pair.right = makeTexture(disparity.cols, disparity.rows);
  pair.left = cv::Mat(disparity.rows, disparity.cols, CV_8UC1);
  for (int v = 0; v < disparity.rows; ++v)
  {
    const auto* from = pair.right.ptr<uint8_t>(v);
    for (int u = 0; u < disparity.cols; ++u)
    {
      const double x = u - std::max(0.0F, disparity.at<float>(v, u));
      const int column = std::clamp(static_cast<int>(std::floor(x)), 0, disparity.cols - 2);
      const double part = std::clamp(x - column, 0.0, 1.0);
      pair.left.at<uint8_t>(v, u) =
          static_cast<uint8_t>(std::lround((1.0 - part) * from[column] + part * from[column + 1]));
    }
  }
  return pair;
}

StereoObstacles makeDetector(const StereoObstacleOptions& options = StereoObstacleOptions())
{
  return StereoObstacles(makeGeometry(), makeMounting(), options);
}

TEST(StereoObstacles, FindsABlockInADisparityPicture)
{
  Scene scene;
  scene.blocks = {{6.0, -0.4, 0.4, 0.0, 1.2}};
  StereoObstacles detector = makeDetector();
  const auto result = detector.detect(scene.disparity());
  ASSERT_EQ(result.obstacles.size(), 1U);
  const ObstacleMeasurement& obstacle = result.obstacles[0];
  EXPECT_NEAR(obstacle.nearest.x(), 6.0, 0.05);
  EXPECT_NEAR(obstacle.min.y(), -0.4, 0.1);
  EXPECT_NEAR(obstacle.max.y(), 0.4, 0.1);
  EXPECT_NEAR(obstacle.max.z(), 1.2, 0.1);
  // 320 / 6 px per metre.
  EXPECT_NEAR(obstacle.box.x1, 319.5 - 0.4 * 320.0 / 6.0, 5.0);
  EXPECT_NEAR(obstacle.box.x2, 319.5 + 0.4 * 320.0 / 6.0, 5.0);
  EXPECT_NEAR(obstacle.box.y1, 239.5 - 0.2 * 320.0 / 6.0, 5.0);
  EXPECT_FALSE(obstacle.cut_left);
  EXPECT_FALSE(obstacle.cut_right);
  EXPECT_GT(obstacle.points, 1000);
  EXPECT_FALSE(result.points.empty());
  EXPECT_TRUE(result.ground.measured);
  EXPECT_EQ(result.disparity_s, 0.0);
}

/// Of the beam that looks in this direction.
const GroundBeam& beamAt(const GroundView& view, double bearing)
{
  return *std::min_element(view.beams.begin(), view.beams.end(),
                           [bearing](const GroundBeam& a, const GroundBeam& b)
                           { return std::abs(a.bearing - bearing) < std::abs(b.bearing - bearing); });
}

TEST(StereoObstacles, TellsHowFarTheGroundIsFreeAndWhatStandsOnIt)
{
  Scene scene;
  scene.blocks = {{6.0, -0.4, 0.4, 0.0, 0.6}, {9.0, -3.0, 3.0, 0.0, 2.0}};
  StereoObstacles detector = makeDetector();
  const GroundView view = detector.detect(scene.disparity()).view;
  const GroundBeam& ahead = beamAt(view, 0.0);
  EXPECT_NEAR(ahead.free_from, 1.4, 0.15);
  EXPECT_NEAR(ahead.free_to, 6.0, 0.4);
  EXPECT_LE(ahead.free_to, 6.0);
  ASSERT_EQ(2u, ahead.hit_count) << "the wall is seen above the block";
  EXPECT_NEAR(ahead.hits[0].distance, 6.0, 0.1);
  EXPECT_NEAR(ahead.hits[1].distance, 9.0, 0.2);
  EXPECT_GT(ahead.hits[1].sigma, ahead.hits[0].sigma);
  const GroundBeam& beside = beamAt(view, 0.2);
  ASSERT_EQ(1u, beside.hit_count);
  EXPECT_NEAR(beside.hits[0].distance, 9.0 / std::cos(0.2), 0.2);
  EXPECT_GT(beside.free_to, 7.5);
  const GroundBeam& far = beamAt(view, 0.6);
  EXPECT_EQ(0u, far.hit_count);
  EXPECT_GT(far.free_to, 12.0);
  EXPECT_NEAR(view.beams.front().bearing, M_PI_4, 0.02);
  EXPECT_NEAR(view.beams.back().bearing, -M_PI_4, 0.02);
}

TEST(StereoObstacles, GroundThatIsNotMeasuredIsNotFree)
{
  Scene scene;
  cv::Mat disparity = scene.disparity();
  disparity.rowRange(320, 480).colRange(280, 360).setTo(-1.0F);
  disparity.rowRange(260, 300).colRange(280, 360).setTo(-1.0F);
  StereoObstacles detector = makeDetector();
  const GroundView view = detector.detect(disparity).view;
  const GroundBeam& ahead = beamAt(view, 0.0);
  EXPECT_GE(ahead.free_from, 3.5);
  EXPECT_LE(ahead.free_to, 5.7);
}

TEST(StereoObstacles, TheGroundMayLieBelowTheOriginOfBaseLink)
{
  Scene scene;
  scene.blocks = {{6.0, -0.4, 0.4, 0.0, 1.2}};
  const auto expected = makeDetector().detect(scene.disparity());
  StereoObstacleOptions options;
  options.ground_z_m = -0.6;
  Eigen::Isometry3d T_base_left = makeMounting();
  T_base_left.translation().z() -= 0.6;
  const auto result = StereoObstacles(makeGeometry(), T_base_left, options).detect(scene.disparity());
  ASSERT_EQ(expected.obstacles.size(), result.obstacles.size());
  EXPECT_NEAR(expected.obstacles[0].max.z() - 0.6, result.obstacles[0].max.z(), 1e-6);
  EXPECT_NEAR(expected.obstacles[0].nearest.x(), result.obstacles[0].nearest.x(), 1e-6);
  EXPECT_NEAR(expected.ground.offset_m - 0.6 * result.ground.normal.z(), result.ground.offset_m, 1e-6);
  ASSERT_EQ(expected.points.size(), result.points.size());
  EXPECT_NEAR(expected.points[0].z() - 0.6F, result.points[0].z(), 1e-5F);
}

TEST(StereoObstacles, FindsBlocksInAPairNearestFirst)
{
  Scene scene;
  scene.blocks = {{9.0, 1.0, 2.0, 0.0, 1.5}, {4.0, -1.5, -0.8, 0.0, 0.8}};
  const Pair pair = makePair(scene);
  StereoObstacles detector = makeDetector();
  const auto result = detector.detect(pair.left, pair.right);
  ASSERT_EQ(result.obstacles.size(), 2U);
  EXPECT_NEAR(result.obstacles[0].nearest.x(), 4.0, 0.2);
  EXPECT_NEAR(result.obstacles[1].nearest.x(), 9.0, 0.45);
  EXPECT_GT(result.obstacles[0].covariance.trace(), 0.0);
  EXPECT_LT(result.obstacles[0].covariance(0, 0), result.obstacles[1].covariance(0, 0))
      << "far things are less certain";
  EXPECT_EQ(detector.disparity().type(), CV_32FC1);
  EXPECT_EQ(detector.disparity().size(), pair.left.size());
  EXPECT_GT(result.disparity_s, 0.0);
}

TEST(StereoObstacles, MatchesAWideBaselineAtHalfSize)
{
  Scene scene;
  scene.geometry.baseline_m = 0.6;  // 192 px m: 10 px at 18 m
  scene.blocks = {{5.0, -0.5, 0.5, 0.0, 1.2}};
  const Pair pair = makePair(scene);
  StereoObstacles detector(scene.geometry, makeMounting(), StereoObstacleOptions());
  const auto result = detector.detect(pair.left, pair.right);
  ASSERT_EQ(result.obstacles.size(), 1U);
  EXPECT_NEAR(result.obstacles[0].nearest.x(), 5.0, 0.1);
  EXPECT_NEAR(result.obstacles[0].box.x1, 319.5 - 0.5 * 64.0, 10.0) << "in pixels of the whole picture";
  ASSERT_EQ(detector.disparity().size(), pair.left.size());
  EXPECT_NEAR(detector.disparity().at<float>(250, 320), 192.0 / 5.0, 0.5);
}

TEST(StereoObstacles, SubtractsWhatThePrincipalPointsDifferBy)
{
  Scene scene;
  scene.blocks = {{4.0, -0.5, 0.5, 0.0, 1.2}};
  Pair pair = makePair(scene);
  constexpr int SHIFT_PX = 4;
  cv::Mat shifted;
  cv::copyMakeBorder(pair.right, shifted, 0, 0, 0, SHIFT_PX, cv::BORDER_REPLICATE);
  pair.right = shifted.colRange(SHIFT_PX, SHIFT_PX + pair.left.cols).clone();
  StereoGeometry geometry = makeGeometry();
  geometry.cx_difference = SHIFT_PX;
  StereoObstacles detector(geometry, makeMounting(), StereoObstacleOptions());
  const auto result = detector.detect(pair.left, pair.right);
  ASSERT_EQ(result.obstacles.size(), 1U);
  EXPECT_NEAR(result.obstacles[0].nearest.x(), 4.0, 0.2);
  EXPECT_NEAR(detector.disparity().at<float>(250, 320), 320.0 * 0.12 / 4.0, 0.5);
}

TEST(StereoObstacles, MeasuresFromTheWantedDistanceBeforeTheVehicleOn)
{
  Eigen::Isometry3d T_base_left = makeMounting();
  T_base_left.translation().x() = 0.7;
  StereoObstacleOptions options;
  options.nearest_distance_m = 0.8;
  options.footprint.front = 0.9;
  const double wanted_m = 0.8 + 0.9 - 0.7;
  for (const double baseline_m : {0.05, 0.12, 0.3})
  {
    StereoGeometry geometry = makeGeometry();
    geometry.baseline_m = baseline_m;
    const double min_depth_m = StereoObstacles(geometry, T_base_left, options).minDepth();
    EXPECT_LE(min_depth_m, wanted_m) << baseline_m;
    // The search has a multiple of 32 px of the whole picture, at least 64.
    EXPECT_LE(geometry.fx * baseline_m / min_depth_m, std::max(64.0, geometry.fx * baseline_m / wanted_m + 32.0))
        << baseline_m;
  }
  StereoGeometry wide = makeGeometry();
  wide.baseline_m = 2.0;
  EXPECT_NEAR(StereoObstacles(wide, T_base_left, options).minDepth(), 2.0, 1e-9)
      << "half of the picture's width: 320 px";
}

TEST(StereoObstacles, FindsWhatStandsAtTheWantedDistance)
{
  Scene scene;
  scene.blocks = {{2.0, -0.4, 0.4, 0.0, 1.2}};  // 1 m before the vehicle's front
  const Pair pair = makePair(scene);
  const auto result = makeDetector().detect(pair.left, pair.right);
  ASSERT_EQ(result.obstacles.size(), 1U);
  EXPECT_NEAR(result.obstacles[0].nearest.x(), 2.0, 0.05);
}

TEST(StereoObstacles, FillsSurfacesWithoutTexture)
{
  Scene scene;
  scene.blocks = {{3.0, -1.0, 1.0, 0.0, 1.6}};
  Pair pair = makePair(scene);
  // A car door: inside of its edges all is even. The disparity is 12.8 px.
  const cv::Rect door(250, 250, 120, 60);
  pair.left(door).setTo(120);
  pair.right(door - cv::Point(13, 0)).setTo(120);
  StereoObstacles detector = makeDetector();
  detector.detect(pair.left, pair.right);
  EXPECT_GT(cv::countNonZero(cv::abs(detector.disparity()(door) - 12.8F) < 1.0F), 0.9 * door.area());
}

TEST(StereoObstacles, FindsNothingOnAnEmptyRoad)
{
  const Scene scene;
  const Pair pair = makePair(scene);
  StereoObstacles detector = makeDetector();
  EXPECT_TRUE(detector.detect(scene.disparity()).obstacles.empty());
  EXPECT_TRUE(detector.detect(pair.left, pair.right).obstacles.empty());
}

TEST(StereoObstacles, FollowsASlopeWithinTheLimits)
{
  Scene scene;
  scene.slope = 0.08;
  scene.step_m = 0.05;
  StereoObstacles detector = makeDetector();
  StereoObstacles::Result result;
  for (int i = 0; i < 10; ++i)
  {
    result = detector.detect(scene.disparity());
  }
  EXPECT_TRUE(result.ground.measured);
  EXPECT_TRUE(result.obstacles.empty());
  EXPECT_NEAR(std::atan2(-result.ground.normal.x(), result.ground.normal.z()), std::atan(0.08), 0.01);
  EXPECT_NEAR(result.ground.offset_m, 0.05, 0.02);
}

TEST(StereoObstacles, TakesATooSteepSlopeForAnObstacle)
{
  Scene scene;
  scene.slope = 0.35;
  StereoObstacles detector = makeDetector();
  const auto result = detector.detect(scene.disparity());
  EXPECT_FALSE(result.obstacles.empty());
  EXPECT_LE(std::acos(result.ground.normal.z()), StereoObstacleOptions().max_ground_tilt + 1e-9);
}

TEST(StereoObstacles, TakesAWallThatFillsTheViewForAnObstacle)
{
  Scene scene;
  scene.blocks = {{1.2, -20.0, 20.0, -5.0, 20.0}};
  StereoObstacles detector = makeDetector();
  const auto result = detector.detect(scene.disparity());
  EXPECT_FALSE(result.ground.measured);
  ASSERT_FALSE(result.obstacles.empty());
  EXPECT_NEAR(result.obstacles[0].nearest.x(), 1.2, 0.05);
  EXPECT_TRUE(result.obstacles[0].cut_left);
  EXPECT_TRUE(result.obstacles[0].cut_right);
}

TEST(StereoObstacles, KeepsTheGroundOfTheLastPairWhileNoneIsSeen)
{
  Scene road;
  road.slope = 0.05;
  Scene wall;
  wall.blocks = {{1.2, -20.0, 20.0, -5.0, 20.0}};
  StereoObstacles detector = makeDetector();
  GroundPlane seen;
  for (int i = 0; i < 5; ++i)
  {
    seen = detector.detect(road.disparity()).ground;
  }
  GroundPlane kept = detector.detect(wall.disparity()).ground;
  EXPECT_FALSE(kept.measured);
  EXPECT_TRUE(kept.normal.isApprox(seen.normal));
  for (int i = 0; i < 30; ++i)
  {
    kept = detector.detect(wall.disparity()).ground;
  }
  EXPECT_TRUE(kept.normal.isApprox(Eigen::Vector3d::UnitZ())) << "after a while, the mounting counts";
}

TEST(StereoObstacles, MovesTheGroundWithTheVehicleWhileNoneIsSeen)
{
  Scene road;
  Scene wall;
  wall.blocks = {{1.2, -20.0, 20.0, -5.0, 20.0}};
  StereoObstacles detector = makeDetector();
  Eigen::Isometry3d T_odom_base = Eigen::Isometry3d::Identity();
  const auto pose = [&T_odom_base] { return std::make_optional(T_odom_base); };
  for (int i = 0; i < 5; ++i)
  {
    detector.detect(road.disparity(), pose);
  }
  // The vehicle brakes before the wall and pitches forward.
  T_odom_base.linear() = Eigen::AngleAxisd(0.04, Eigen::Vector3d::UnitY()).toRotationMatrix();
  T_odom_base.translation() = Eigen::Vector3d(0.3, 0.0, -0.02);
  const GroundPlane moved = detector.detect(wall.disparity(), pose).ground;
  EXPECT_FALSE(moved.measured);
  EXPECT_NEAR(std::atan2(-moved.normal.x(), moved.normal.z()), 0.04, 0.005);
  EXPECT_NEAR(moved.offset_m, 0.02, 0.01);
  // Odometry that jumps is not followed.
  T_odom_base.translation().z() = 5.0;
  const GroundPlane kept = detector.detect(wall.disparity(), pose).ground;
  EXPECT_TRUE(kept.normal.isApprox(moved.normal));
}

TEST(StereoObstacles, AllowsForTheMountingWhileNoGroundIsSeen)
{
  // Only a strip 10 m ahead is seen, of a road that rises by 1.5 degrees: 0.26 m at this distance.
  Scene scene;
  scene.slope = 0.026;
  cv::Mat disparity = scene.disparity();
  disparity.rowRange(0, 260).setTo(-1.0F);
  disparity.rowRange(264, disparity.rows).setTo(-1.0F);
  const auto result = makeDetector().detect(disparity);
  EXPECT_FALSE(result.ground.measured);
  EXPECT_TRUE(result.obstacles.empty());
}

TEST(StereoObstacles, LetsThingsHangAboveTheVehicle)
{
  Scene scene;
  scene.blocks = {{6.0, -1.0, 1.0, 2.4, 3.0}};
  StereoObstacles detector = makeDetector();
  EXPECT_TRUE(detector.detect(scene.disparity()).obstacles.empty());
  scene.blocks = {{6.0, -1.0, 1.0, 1.5, 3.0}};
  EXPECT_EQ(detector.detect(scene.disparity()).obstacles.size(), 1U) << "reaches into the way";
}

TEST(StereoObstacles, LeavesOutWhatIsLowSmallOrFar)
{
  Scene scene;
  scene.blocks = {{5.0, -1.5, -0.5, 0.0, 0.08}, {5.0, 0.5, 0.6, 0.2, 0.3}, {25.0, -1.0, 1.0, 0.0, 2.0}};
  StereoObstacles detector = makeDetector();
  EXPECT_TRUE(detector.detect(scene.disparity()).obstacles.empty());
}

TEST(StereoObstacles, IsNotMisledByNoise)
{
  const Scene scene;
  cv::Mat disparity = scene.disparity();
  std::mt19937 random(7);
  std::normal_distribution<float> noise(0.0F, 0.25F);
  std::uniform_real_distribution<float> anything(1.0F, 60.0F);
  for (int v = 0; v < disparity.rows; ++v)
  {
    for (int u = 0; u < disparity.cols; ++u)
    {
      float& d = disparity.at<float>(v, u);
      const bool wrong = random() % 50 == 0;
      d = wrong ? anything(random) : d > 0.0F ? d + noise(random) : d;
    }
  }
  StereoObstacles detector = makeDetector();
  const auto result = detector.detect(disparity);
  EXPECT_TRUE(result.ground.measured);
  EXPECT_NEAR(result.ground.offset_m, 0.0, 0.02);
  EXPECT_TRUE(result.obstacles.empty());
}

TEST(StereoObstacles, IsNotMisledByAPothole)
{
  const Scene scene;
  cv::Mat disparity = scene.disparity();
  // 0.3 m deep: what is seen there is further away than the road.
  for (int v = 330; v < 350; ++v)
  {
    for (int u = 300; u < 360; ++u)
    {
      disparity.at<float>(v, u) /= 1.3F;
    }
  }
  StereoObstacles detector = makeDetector();
  EXPECT_TRUE(detector.detect(disparity).obstacles.empty());
}

TEST(StereoObstacles, SeesNothingInDarkPictures)
{
  const cv::Mat dark(480, 640, CV_8UC1, cv::Scalar(3));
  StereoObstacles detector = makeDetector();
  const auto result = detector.detect(dark, dark);
  EXPECT_TRUE(result.obstacles.empty());
  EXPECT_LT(result.coverage, 0.02);
  EXPECT_FALSE(result.ground.measured);
}

TEST(StereoObstacles, SeesNothingInNoise)
{
  // Covered lenses: only the noise of both sensors.
  cv::Mat pictures[2];
  cv::RNG random(3);
  for (cv::Mat& picture : pictures)
  {
    picture = cv::Mat(480, 640, CV_8UC1);
    random.fill(picture, cv::RNG::NORMAL, 20, 6);
  }
  EXPECT_LT(makeDetector().detect(pictures[0], pictures[1]).coverage, 0.1);
}

TEST(StereoObstacles, TakesUnknownDisparitiesInEveryForm)
{
  Scene scene;
  scene.blocks = {{6.0, -0.4, 0.4, 0.0, 1.2}};
  cv::Mat disparity = scene.disparity();
  for (int v = 0; v < disparity.rows; v += 5)
  {
    disparity.at<float>(v, 320) = std::numeric_limits<float>::quiet_NaN();
    disparity.at<float>(v, 100) = std::numeric_limits<float>::infinity();
    disparity.at<float>(v, 400) = 0.0F;
  }
  StereoObstacles detector = makeDetector();
  const auto result = detector.detect(disparity);
  ASSERT_EQ(result.obstacles.size(), 1U);
  EXPECT_NEAR(result.obstacles[0].nearest.x(), 6.0, 0.05);
  EXPECT_EQ(detector.disparity().at<float>(5, 320), -1.0F);
}

TEST(StereoObstacles, RefusesPicturesOfOtherSizeOrType)
{
  StereoObstacles detector = makeDetector();
  const cv::Mat good(480, 640, CV_8UC1, cv::Scalar(0));
  const cv::Mat small(240, 320, CV_8UC1, cv::Scalar(0));
  const cv::Mat color(480, 640, CV_8UC3, cv::Scalar(0));
  EXPECT_THROW(detector.detect(good, small), std::invalid_argument);
  EXPECT_THROW(detector.detect(color, good), std::invalid_argument);
  EXPECT_THROW(detector.detect(good), std::invalid_argument) << "a grey picture is no disparity";
  EXPECT_THROW(detector.detect(cv::Mat()), std::invalid_argument);
  try
  {
    detector.detect(small, good);
    FAIL() << "a small picture was accepted";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(), "left picture: 320x240, the camera's calibration says 640x480");
  }
}

void expectRefused(const std::function<void(StereoObstacleOptions*)>& change, const std::string& message)
{
  StereoObstacleOptions options;
  change(&options);
  try
  {
    options.validate();
    ADD_FAILURE() << "accepted, expected: " << message;
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_EQ(error.what(), message);
  }
}

TEST(StereoObstacles, RefusesOptionsOutOfRange)
{
  expectRefused([](StereoObstacleOptions* options) { options->nearest_distance_m = -1.0; },
                "nearest_distance_m = -1, must be in [0, 20]");
  expectRefused([](StereoObstacleOptions* options) { options->max_range_m = std::nan(""); },
                "max_range_m = nan, must be in [1, 200]");
  expectRefused([](StereoObstacleOptions* options) { options->min_height_m = 1.9, options->max_height_m = 1.0; },
                "min_height_m = 1.900000, must be below max_height_m = 1.000000");
}

TEST(StereoObstacles, RefusesAGeometryOrMountingThatCannotBe)
{
  StereoGeometry geometry = makeGeometry();
  geometry.baseline_m = -0.12;
  EXPECT_THROW(StereoObstacles(geometry, makeMounting(), StereoObstacleOptions()), std::invalid_argument);
  Eigen::Isometry3d looks_up = makeMounting();
  looks_up.linear() = Eigen::Matrix3d::Identity();
  EXPECT_THROW(StereoObstacles(makeGeometry(), looks_up, StereoObstacleOptions()), std::invalid_argument);
  Eigen::Isometry3d on_the_ground = makeMounting();
  on_the_ground.translation().z() = 0.0;
  EXPECT_THROW(StereoObstacles(makeGeometry(), on_the_ground, StereoObstacleOptions()), std::invalid_argument);
}

}  // namespace
}  // namespace pi_detect
