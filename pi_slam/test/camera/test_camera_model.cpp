#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_slam/camera_model.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <vector>

using pi_slam::CameraModel;
using pi_slam::Distortion;

namespace
{

using pi_node::test_support::messageOf;

CameraModel makeCamera(Distortion distortion, const std::array<double, 8>& coefficients)
{
  CameraModel camera;
  camera.width = 752;
  camera.height = 480;
  camera.fx = 458.654;
  camera.fy = 457.296;
  camera.cx = 367.215;
  camera.cy = 248.375;
  camera.distortion = distortion;
  camera.coefficients = coefficients;
  return camera;
}

const CameraModel PINHOLE = makeCamera(Distortion::NONE, {});
const CameraModel RADTAN = makeCamera(Distortion::RADTAN, {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05});
// As cameras with wide lenses come from their factory: with k3, and as a rational model.
const CameraModel WITH_K3 = makeCamera(Distortion::RADTAN, {-0.17, 0.025, 1.0e-4, -3.0e-4, -0.0021});
const CameraModel RATIONAL = makeCamera(Distortion::RADTAN, {9.45, -12.6, 4.0e-4, -7.0e-4, 15.8, 9.26, -12.2, 15.5});
const CameraModel FISHEYE = makeCamera(Distortion::EQUIDISTANT, {0.0034, 0.00076, -0.0033, 0.0011});

}  // namespace

class Models : public testing::TestWithParam<CameraModel>
{
};

TEST_P(Models, ProjectUndoesUnprojectAtEveryPixel)
{
  const CameraModel& camera = GetParam();
  for (double y = 0.0; y < camera.height; y += 7.9)
  {
    for (double x = 0.0; x < camera.width; x += 7.9)
    {
      const auto ray = camera.unproject({x, y});
      ASSERT_TRUE(ray) << x << " " << y;
      EXPECT_NEAR(ray->norm(), 1.0, 1e-12);
      const auto pixel = camera.project(3.7 * *ray);
      ASSERT_TRUE(pixel) << x << " " << y;
      EXPECT_NEAR(pixel->x(), x, 1e-8);
      EXPECT_NEAR(pixel->y(), y, 1e-8);
    }
  }
}

TEST_P(Models, OpticalAxisHitsThePrincipalPoint)
{
  const auto pixel = GetParam().project({0.0, 0.0, 2.0});
  ASSERT_TRUE(pixel);
  EXPECT_DOUBLE_EQ(pixel->x(), GetParam().cx);
  EXPECT_DOUBLE_EQ(pixel->y(), GetParam().cy);
}

TEST_P(Models, CentreOfProjectionHasNoPixel)
{
  EXPECT_FALSE(GetParam().project({0.0, 0.0, 0.0}));
  EXPECT_FALSE(GetParam().project({0.0, 0.0, -1.0}));
}

INSTANTIATE_TEST_SUITE_P(CameraModel, Models, testing::Values(PINHOLE, RADTAN, WITH_K3, RATIONAL, FISHEYE));

TEST(CameraModel, ProjectsAsOpenCvDefinesRadialTangential)
{
  // Worked by hand from the formula for x = 0.5, y = -0.25: r^2 = 0.3125, radial = 0.918657...
  const auto& k = RADTAN.coefficients;
  const double r2 = 0.3125;
  const double radial = 1.0 + k[0] * r2 + k[1] * r2 * r2;
  const double x = 0.5 * radial + 2.0 * k[2] * 0.5 * -0.25 + k[3] * (r2 + 0.5);
  const double y = -0.25 * radial + k[2] * (r2 + 0.125) + 2.0 * k[3] * 0.5 * -0.25;
  const auto pixel = RADTAN.project({1.0, -0.5, 2.0});
  ASSERT_TRUE(pixel);
  EXPECT_NEAR(pixel->x(), 458.654 * x + 367.215, 1e-9);
  EXPECT_NEAR(pixel->y(), 457.296 * y + 248.375, 1e-9);
}

TEST(CameraModel, ProjectsAsOpenCvDoes)
{
  for (const CameraModel& camera : {RADTAN, WITH_K3, RATIONAL})
  {
    const cv::Matx33d K(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
    const std::vector<cv::Point3d> points = {{1.0, -0.5, 2.0}, {-0.3, 0.9, 1.5}, {0.01, 0.02, 1.0}};
    std::vector<cv::Point2d> expected;
    cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), K,
                      std::vector<double>(camera.coefficients.begin(), camera.coefficients.end()), expected);
    for (size_t i = 0; i < points.size(); ++i)
    {
      const auto pixel = camera.project({points[i].x, points[i].y, points[i].z});
      ASSERT_TRUE(pixel);
      EXPECT_NEAR(expected[i].x, pixel->x(), 1e-9);
      EXPECT_NEAR(expected[i].y, pixel->y(), 1e-9);
    }
  }
}

TEST(CameraModel, FisheyeSeesBeyondNinetyDegrees)
{
  CameraModel camera = FISHEYE;
  camera.coefficients = {};
  camera.fx = camera.fy = 200.0;
  const Eigen::Vector3d sideways(std::sin(1.7), 0.0, std::cos(1.7));
  const auto pixel = camera.project(sideways);
  ASSERT_TRUE(pixel);
  EXPECT_NEAR(pixel->x(), camera.cx + 200.0 * 1.7, 1e-9);
  const auto ray = camera.unproject(*pixel);
  ASSERT_TRUE(ray);
  EXPECT_LT((*ray - sideways).norm(), 1e-9);
}

TEST(CameraModel, HasNoPixelWhereDistortionFoldsBack)
{
  const CameraModel camera = makeCamera(Distortion::RADTAN, {-0.3, 0.0, 0.0, 0.0});
  // r (1 - 0.3 r^2) turns back at r = 1 / sqrt(0.9) = 1.054.
  EXPECT_TRUE(camera.project({1.0, 0.0, 1.0}));
  EXPECT_FALSE(camera.project({1.1, 0.0, 1.0}));
  EXPECT_FALSE(camera.unproject({camera.cx + 0.8 * camera.fx, camera.cy}));
  // r (1 - 0.1 r^6) turns back at r = (1 / 0.7)^(1 / 6) = 1.061.
  const CameraModel with_k3 = makeCamera(Distortion::RADTAN, {0.0, 0.0, 0.0, 0.0, -0.1});
  EXPECT_TRUE(with_k3.project({1.05, 0.0, 1.0}));
  EXPECT_FALSE(with_k3.project({1.2, 0.0, 1.0}));
}

TEST(CameraModel, RefusesValuesOutOfRangeByName)
{
  CameraModel camera = RADTAN;
  camera.fx = 0.0;
  EXPECT_EQ(messageOf<std::invalid_argument>([&] { camera.validate(); }), "camera: fx = 0.000000, must be above 0 px");
  camera = RADTAN;
  camera.width = 0;
  EXPECT_NE(messageOf<std::invalid_argument>([&] { camera.validate(); }).find("width = 0"), std::string::npos);
  camera = RADTAN;
  camera.coefficients[2] = NAN;
  EXPECT_NE(messageOf<std::invalid_argument>([&] { camera.validate(); }).find("coefficient"), std::string::npos);
}
