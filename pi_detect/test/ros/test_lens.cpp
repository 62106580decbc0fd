#include "ros/lens.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

namespace pi_detect
{
namespace
{

sensor_msgs::CameraInfo makeInfo(const std::string& lens, const std::vector<double>& coefficients)
{
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.distortion_model = lens;
  info.D = coefficients;
  info.K = {400.0, 0.0, 320.0, 0.0, 410.0, 240.0, 0.0, 0.0, 1.0};
  return info;
}

TEST(Lens, PixelsAndRaysAreInverse)
{
  for (const auto& info : {makeInfo("plumb_bob", {-0.25, 0.08, 0.001, -0.001, 0.0}), makeInfo("plumb_bob", {}),
                           makeInfo("rational_polynomial", {0.1, 0.02, 0.0, 0.0, 0.0, 0.3, 0.05, 0.0}),
                           makeInfo("equidistant", {0.02, -0.01, 0.0, 0.0})})
  {
    const Lens lens(info, "info");
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(320.0, 240.0), Eigen::Vector2d(40.0, 60.0)})
    {
      const Eigen::Vector3d ray = lens.ray(pixel);
      EXPECT_EQ(ray.z(), 1.0);
      EXPECT_LT((lens.pixel(3.0 * ray) - pixel).norm(), 0.5) << info.distortion_model;
    }
    EXPECT_LT((lens.ray({320.0, 240.0}) - Eigen::Vector3d::UnitZ()).norm(), 1e-6);
  }
}

TEST(Lens, IsThatOfThePicturesAsTheyCome)
{
  sensor_msgs::CameraInfo info = makeInfo("plumb_bob", {});
  info.binning_x = info.binning_y = 2;
  info.roi.x_offset = 100;
  info.roi.width = 400;
  info.roi.height = 480;
  EXPECT_LT((Lens(info, "info").pixel({0.0, 0.0, 1.0}) - Eigen::Vector2d(110.0, 120.0)).norm(), 1e-6);
}

TEST(Lens, SaysWhatIsWrong)
{
  EXPECT_THROW(Lens(makeInfo("lens_of_glass", {0.1}), "info"), std::invalid_argument);
  EXPECT_THROW(Lens(makeInfo("equidistant", {0.1}), "info"), std::invalid_argument);
  EXPECT_THROW(Lens(sensor_msgs::CameraInfo(), "info"), std::invalid_argument);
}

}  // namespace
}  // namespace pi_detect
