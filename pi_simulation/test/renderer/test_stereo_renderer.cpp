#include "renderer/stereo_renderer.h"

#include "drives/vehicle_path.h"
#include "drives/visible_obstacles.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>

#include <cmath>
#include <opencv2/core.hpp>

using namespace pi_simulation;
using pi_node::test_support::messageOf;

namespace
{

constexpr int WIDTH = 320;
constexpr int HEIGHT = 240;

struct Drive
{
  std::vector<pi_slam::StampedPose> poses;
  pi_slam::SplineTrajectory trajectory;
  std::shared_ptr<const SyntheticWorld> world;
};

Drive makeDrive(WorldKind kind)
{
  VehiclePathOptions path;
  path.shape = kind == WorldKind::CAMPUS ? PathShape::CAMPUS_LOOP : PathShape::HALL_LOOP;
  path.duration_s = 30.0;
  path.start_standstill_s = 0.0;
  std::vector<pi_slam::StampedPose> poses = makeVehiclePath(path);
  pi_slam::SplineTrajectory trajectory = pi_slam::SplineTrajectory::fit(poses);
  SyntheticWorldOptions options;
  options.kind = kind;
  auto world = SyntheticWorld::build(options, poses);
  return {std::move(poses), std::move(trajectory), std::move(world)};
}

const Drive& drive(WorldKind kind)
{
  static const Drive campus = makeDrive(WorldKind::CAMPUS);
  static const Drive hall = makeDrive(WorldKind::HALL);
  return kind == WorldKind::CAMPUS ? campus : hall;
}

int64_t stampAt(const Drive& drive, double time_s)
{
  return drive.trajectory.startNs() + std::llround(time_s * 1e9);
}

pi_slam::StereoCalibration makeCalibration(pi_slam::Distortion distortion)
{
  pi_slam::StereoCalibration calibration = pi_slam::StereoCalibration::makeForwardPair(WIDTH, HEIGHT, 0.12);
  for (pi_slam::CameraModel* camera : {&calibration.left.model, &calibration.right.model})
  {
    camera->distortion = distortion;
    camera->coefficients = {-0.20, 0.04, 0.0005, -0.0004};
  }
  calibration.right.model.fx *= 1.02;  // cameras of a pair differ
  return calibration;
}

bool equal(const cv::Mat& a, const cv::Mat& b)
{
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0.0;
}

/// Grey value between pixels.
double interpolate(const cv::Mat& picture, const Eigen::Vector2d& pixel)
{
  const int x = static_cast<int>(pixel.x());
  const int y = static_cast<int>(pixel.y());
  const double fx = pixel.x() - x;
  const double fy = pixel.y() - y;
  return (1 - fy) * ((1 - fx) * picture.at<uint8_t>(y, x) + fx * picture.at<uint8_t>(y, x + 1)) +
         fy * ((1 - fx) * picture.at<uint8_t>(y + 1, x) + fx * picture.at<uint8_t>(y + 1, x + 1));
}

class Renderings : public testing::TestWithParam<std::tuple<WorldKind, pi_slam::Distortion>>
{
};

TEST_P(Renderings, AWorldPointIsEquallyBrightInBothPictures)
{
  const Drive& d = drive(std::get<0>(GetParam()));
  const pi_slam::StereoCalibration calibration = makeCalibration(std::get<1>(GetParam()));
  pi_slam::StereoCalibration exchanged = calibration;
  std::swap(exchanged.left, exchanged.right);
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  options.truth = true;
  options.supersampling = Supersampling::FULL;
  const int64_t stamp_ns = stampAt(d, 7.0);
  const StereoFrame frame = StereoRenderer(d.world, calibration, options).render(d.trajectory, stamp_ns);
  const StereoFrame other = StereoRenderer(d.world, exchanged, options).render(d.trajectory, stamp_ns);
  const Eigen::Isometry3d T_right_left = calibration.right.T_body_camera.inverse() * calibration.left.T_body_camera;
  int compared = 0;
  int close = 0;
  double sum = 0.0;
  for (int y = 2; y < HEIGHT - 2; ++y)
  {
    for (int x = 2; x < WIDTH - 2; ++x)
    {
      const Eigen::Vector3d ray = *calibration.left.model.unproject({x, y});
      const double depth = frame.depth.at<float>(y, x);
      if (depth == 0.0)
      {
        continue;
      }
      const Eigen::Vector3d p_right = T_right_left * (ray * (depth / ray.z()));
      const auto pixel = calibration.right.model.project(p_right);
      if (!pixel || pixel->x() < 1.0 || pixel->y() < 1.0 || pixel->x() > WIDTH - 3.0 || pixel->y() > HEIGHT - 3.0)
      {
        continue;
      }
      const double seen = other.depth.at<float>(static_cast<int>(pixel->y() + 0.5), static_cast<int>(pixel->x() + 0.5));
      if (std::abs(seen - p_right.z()) > 0.03 * p_right.z())
      {
        continue;  // hidden from the right camera
      }
      const double difference = std::abs(interpolate(frame.right, *pixel) - frame.left.at<uint8_t>(y, x));
      ++compared;
      sum += difference;
      close += difference < 12.0 ? 1 : 0;
    }
  }
  EXPECT_GT(compared, WIDTH * HEIGHT / 2);
  // Interpolation smooths texture as fine as the pixels: a few grey levels on the average, more at outlines.
  EXPECT_LT(sum / compared, 4.0);
  EXPECT_GT(close, 0.92 * compared);
}

TEST_P(Renderings, DepthPutsTheGroundOnTheGroundAndThingsIntoTheirBoxes)
{
  const Drive& d = drive(std::get<0>(GetParam()));
  const pi_slam::StereoCalibration calibration = makeCalibration(std::get<1>(GetParam()));
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  options.truth = true;
  const int64_t stamp_ns = stampAt(d, 11.0);
  const StereoFrame frame = StereoRenderer(d.world, calibration, options).render(d.trajectory, stamp_ns);
  const Eigen::Isometry3d T_world_camera = d.trajectory.at(stamp_ns).T_world_body * calibration.left.T_body_camera;
  const std::vector<ObstacleState> obstacles = d.world->obstaclesAt(stamp_ns);
  int on_ground = 0;
  int on_things = 0;
  for (int y = 0; y < HEIGHT; ++y)
  {
    for (int x = 0; x < WIDTH; ++x)
    {
      const double depth = frame.depth.at<float>(y, x);
      const int id = frame.objects.at<int32_t>(y, x);
      const Eigen::Vector3d ray = *calibration.left.model.unproject({x, y});
      const Eigen::Vector3d p_world = T_world_camera * (ray * (depth / ray.z()));
      if (id == 0 && depth > 0.0 && depth < 8.0 && y > HEIGHT - 20)
      {
        EXPECT_NEAR(p_world.z(), 0.0, 1e-3);
        ++on_ground;
      }
      if (id != 0)
      {
        const ObstacleState& obstacle = obstacles[static_cast<size_t>(id) - 1];
        if (obstacle.class_name == "building" || obstacle.class_name == "shelf" || obstacle.class_name == "box")
        {
          const Eigen::Vector3d p = obstacle.T_world_object.inverse() * p_world;
          EXPECT_LT((p.cwiseAbs() - 0.5 * obstacle.size).maxCoeff(), 0.01) << obstacle.class_name;
          ++on_things;
        }
      }
    }
  }
  EXPECT_GT(on_ground, 1000);
  EXPECT_GT(on_things, 1000);
}

INSTANTIATE_TEST_SUITE_P(StereoRenderer, Renderings,
                         testing::Combine(testing::Values(WorldKind::CAMPUS, WorldKind::HALL),
                                          testing::Values(pi_slam::Distortion::NONE, pi_slam::Distortion::RADTAN,
                                                          pi_slam::Distortion::EQUIDISTANT)));

TEST(StereoRenderer, PicturesDoNotDependOnThreadsOrOrder)
{
  const Drive& d = drive(WorldKind::CAMPUS);
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::RADTAN);
  StereoRendererOptions options;
  options.blur_samples = 2;
  options.color = true;
  options.truth = true;
  const StereoFrame reference = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 5.0));
  for (const int threads : {2, 3, 7})
  {
    options.threads = threads;
    StereoRenderer renderer(d.world, calibration, options);
    renderer.render(d.trajectory, stampAt(d, 9.0));
    const StereoFrame frame = renderer.render(d.trajectory, stampAt(d, 5.0));
    EXPECT_TRUE(equal(frame.left, reference.left)) << threads;
    EXPECT_TRUE(equal(frame.right, reference.right)) << threads;
    EXPECT_TRUE(equal(frame.depth, reference.depth)) << threads;
    EXPECT_TRUE(equal(frame.objects, reference.objects)) << threads;
  }
}

TEST(StereoRenderer, NoiseHasTheStatedVarianceAndDiffersBetweenCameras)
{
  const Drive& d = drive(WorldKind::HALL);
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::NONE);
  const StereoFrame clean = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 3.0));
  options.shot_noise = 0.05;
  options.read_noise = 2.0;
  const StereoFrame noisy = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 3.0));
  double squares = 0.0;
  double expected = 0.0;
  int count = 0;
  for (int i = 0; i < WIDTH * HEIGHT; ++i)
  {
    const double value = clean.left.data[i];
    if (value > 20.0 && value < 230.0)  // nothing is cut off
    {
      squares += std::pow(noisy.left.data[i] - value, 2);
      expected += 0.05 * value + 4.0 + 1.0 / 6.0;  // and rounding, twice
      ++count;
    }
  }
  ASSERT_GT(count, 10000);
  EXPECT_NEAR(squares / expected, 1.0, 0.05);
  cv::Mat left_noise;
  cv::Mat right_noise;
  cv::subtract(noisy.left, clean.left, left_noise, cv::noArray(), CV_32F);
  cv::subtract(noisy.right, clean.right, right_noise, cv::noArray(), CV_32F);
  EXPECT_LT(std::abs(left_noise.dot(right_noise)) / (cv::norm(left_noise) * cv::norm(right_noise)), 0.02);
}

TEST(StereoRenderer, BlurSmearsAlongTheMotionOnly)
{
  const Drive& d = drive(WorldKind::HALL);
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::NONE);
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  const StereoFrame sharp = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 6.0));
  options.blur_samples = 4;
  options.exposure_s = 0.06;
  StereoRenderer blurring(d.world, calibration, options);
  const StereoFrame blurred = blurring.render(d.trajectory, stampAt(d, 6.0));
  const auto roughness = [](const cv::Mat& picture)
  { return cv::norm(picture.colRange(0, WIDTH - 1), picture.colRange(1, WIDTH), cv::NORM_L1); };
  EXPECT_LT(roughness(blurred.left), 0.9 * roughness(sharp.left));
  EXPECT_NEAR(cv::mean(blurred.left)[0], cv::mean(sharp.left)[0], 2.0);
  // A body at rest is not blurred.
  const StereoFrame resting = blurring.render(d.trajectory.at(stampAt(d, 6.0)).T_world_body, stampAt(d, 6.0));
  EXPECT_TRUE(equal(resting.left, sharp.left));
}

TEST(StereoRenderer, GreyIsTheLumaOfColour)
{
  const Drive& d = drive(WorldKind::CAMPUS);
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::NONE);
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  const StereoFrame grey = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 4.0));
  options.color = true;
  options.brightness = 0.8;  // no channel may saturate
  const StereoFrame color = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 4.0));
  ASSERT_EQ(color.left.type(), CV_8UC3);
  const cv::Vec3b bgr = color.left.at<cv::Vec3b>(200, 160);
  EXPECT_NEAR(grey.left.at<uint8_t>(200, 160) * 0.8 / 1.15, 0.114 * bgr[0] + 0.587 * bgr[1] + 0.299 * bgr[2], 1.5);
}

TEST(StereoRenderer, CornersAreDarkerWithVignettingAndGainChangesBothCamerasAlike)
{
  const Drive& d = drive(WorldKind::CAMPUS);
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::NONE);
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  const StereoFrame plain = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 4.0));
  options.vignetting = 0.5;
  const StereoFrame vignetted = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 4.0));
  EXPECT_NEAR(vignetted.left.at<uint8_t>(HEIGHT - 1, 0), 0.5 * plain.left.at<uint8_t>(HEIGHT - 1, 0), 1.0);
  EXPECT_NEAR(vignetted.left.at<uint8_t>(HEIGHT / 2, WIDTH / 2), plain.left.at<uint8_t>(HEIGHT / 2, WIDTH / 2), 1.0);
  options.vignetting = 0.0;
  options.gain_variation = 0.5;
  const StereoFrame varied = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 4.0));
  const double left = cv::mean(varied.left)[0] / cv::mean(plain.left)[0];
  const double right = cv::mean(varied.right)[0] / cv::mean(plain.right)[0];
  EXPECT_GT(std::abs(left - 1.0), 0.01);
  EXPECT_NEAR(left, right, 0.02);
}

TEST(StereoRenderer, SeesNothingOutsideOfTheImageCircle)
{
  const Drive& d = drive(WorldKind::HALL);
  pi_slam::StereoCalibration calibration = pi_slam::StereoCalibration::makeForwardPair(WIDTH, HEIGHT);
  calibration.left.model.distortion = pi_slam::Distortion::RADTAN;
  calibration.left.model.coefficients = {-0.4, 0.0, 0.0, 0.0};  // folds back within the picture
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  options.truth = true;
  const StereoFrame frame = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 4.0));
  EXPECT_EQ(frame.left.at<uint8_t>(0, 0), 0);
  EXPECT_EQ(frame.depth.at<float>(0, 0), 0.0f);
  EXPECT_GT(frame.left.at<uint8_t>(HEIGHT / 2, WIDTH / 2), 0);
}

TEST(StereoRenderer, ShowsActorsWhereTheyAre)
{
  std::vector<pi_slam::StampedPose> poses(2);
  poses[0].T_world_body.translation() << 0.0, 0.0, 1.0;
  poses[1].T_world_body.translation() << 30.0, 0.0, 1.0;
  poses[1].stamp_ns = 1000000000;
  SyntheticWorldOptions world_options;
  world_options.actors = {{"box", {0.8, 0.8, 1.0}, {{6.0, 0.5}}}};
  const auto world = SyntheticWorld::build(world_options, poses);
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::NONE);
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  options.truth = true;
  StereoRenderer renderer(world, calibration, options);
  ActorState box;
  box.position = {6.0, 0.5};
  const StereoFrame without = renderer.render(poses[0].T_world_body, 0, {box});
  box.present = true;
  const StereoFrame with = renderer.render(poses[0].T_world_body, 0, {box});
  // Its middle, half a metre below the camera and half a metre to the left.
  const auto pixel =
      calibration.left.model.project((calibration.left.T_body_camera.inverse() * Eigen::Vector3d(5.6, 0.5, -0.5)));
  ASSERT_TRUE(pixel);
  const int x = static_cast<int>(pixel->x());
  const int y = static_cast<int>(pixel->y());
  EXPECT_NEAR(with.depth.at<float>(y, x), 5.6, 0.05);
  EXPECT_GT(without.depth.at<float>(y, x), 8.0);
  EXPECT_GT(with.objects.at<int32_t>(y, x), 0);
}

TEST(StereoRenderer, LivePicturesLookLikeRecordedOnes)
{
  const Drive& d = drive(WorldKind::CAMPUS);
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::RADTAN);
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  const StereoFrame recorded = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 5.0));
  options.quality = RenderQuality::LIVE;
  const StereoFrame live = StereoRenderer(d.world, calibration, options).render(d.trajectory, stampAt(d, 5.0));
  cv::Scalar mean[2];
  cv::Scalar deviation[2];
  cv::meanStdDev(recorded.left, mean[0], deviation[0]);
  cv::meanStdDev(live.left, mean[1], deviation[1]);
  EXPECT_NEAR(mean[0][0], mean[1][0], 3.0);
  EXPECT_NEAR(deviation[1][0] / deviation[0][0], 1.0, 0.05);
  // The detail is other detail, but as strong.
  const auto roughness = [](const cv::Mat& picture)
  { return cv::norm(picture.colRange(0, WIDTH - 1), picture.colRange(1, WIDTH), cv::NORM_L1); };
  EXPECT_NEAR(roughness(live.left) / roughness(recorded.left), 1.0, 0.12);
  EXPECT_FALSE(equal(live.left, recorded.left));
}

TEST(VisibleObstacles, ReportsWhatThePictureShows)
{
  const Drive& d = drive(WorldKind::CAMPUS);
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::NONE);
  StereoRendererOptions options = StereoRendererOptions::makeIdeal();
  options.truth = true;
  const int64_t stamp_ns = stampAt(d, 8.0);
  const Eigen::Isometry3d T_world_body = d.trajectory.at(stamp_ns).T_world_body;
  const StereoFrame frame = StereoRenderer(d.world, calibration, options).render(T_world_body, stamp_ns);
  const auto visible = visibleObstacles(*d.world, frame, T_world_body);
  ASSERT_GT(visible.size(), 5u);
  for (const VisibleObstacle& obstacle : visible)
  {
    EXPECT_EQ(cv::countNonZero(frame.objects == obstacle.id), obstacle.pixels);
    EXPECT_EQ(cv::countNonZero(frame.objects(obstacle.box) == obstacle.id), obstacle.pixels);
    EXPECT_GT(obstacle.p_body.x() + 0.5 * obstacle.size.norm() + 1.0, obstacle.nearest_depth_m) << obstacle.class_name;
  }
  const std::string json = toJson(stamp_ns, visible);
  EXPECT_EQ(json.find("{\"stamp_ns\": " + std::to_string(stamp_ns) + ", \"obstacles\": [{\"id\": "), 0u);
  EXPECT_EQ(toJson(5, {}), "{\"stamp_ns\": 5, \"obstacles\": []}");
}

TEST(StereoRenderer, RefusesWhatItCannotRenderByName)
{
  const Drive& d = drive(WorldKind::HALL);
  const pi_slam::StereoCalibration calibration = makeCalibration(pi_slam::Distortion::NONE);
  StereoRendererOptions options;
  options.blur_samples = 0;
  EXPECT_EQ(messageOf<std::invalid_argument>([&] { StereoRenderer(d.world, calibration, options); }),
            "renderer: blur_samples = 0.000000, must be in [1, 16]");
  EXPECT_NE(messageOf<std::invalid_argument>([&] { StereoRenderer(nullptr, calibration); }).find("world is null"),
            std::string::npos);
  StereoRenderer renderer(d.world, calibration);
  EXPECT_THROW(renderer.render(d.trajectory, d.trajectory.endNs() + 1), std::out_of_range);
  const StereoFrame frame = renderer.render(d.trajectory, d.trajectory.startNs());
  EXPECT_THROW(visibleObstacles(*d.world, frame, Eigen::Isometry3d::Identity()), std::invalid_argument);
}

}  // namespace
