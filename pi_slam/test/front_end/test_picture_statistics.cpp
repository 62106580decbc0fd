#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "front_end/picture_statistics.h"

using namespace pi_slam::front_end;

namespace
{

Picture view(const std::vector<uint8_t>& pixels, int width)
{
  return {pixels.data(), width, static_cast<int>(pixels.size()) / width, static_cast<size_t>(width)};
}

std::vector<uint8_t> noise(size_t count, int low, int high)
{
  std::mt19937 random(11);
  std::uniform_int_distribution<int> grey(low, high);
  std::vector<uint8_t> pixels(count);
  for (uint8_t& pixel : pixels)
  {
    pixel = static_cast<uint8_t>(grey(random));
  }
  return pixels;
}

}  // namespace

TEST(PictureStatistics, AreMeanAndStandardDeviation)
{
  const std::vector<uint8_t> pixels{10, 20, 30, 40, 250, 250};
  const PictureStatistics statistics = describePicture(view(pixels, 3));
  EXPECT_DOUBLE_EQ(statistics.mean, 100.0);
  EXPECT_NEAR(statistics.contrast, std::sqrt((90 * 90 + 80 * 80 + 70 * 70 + 60 * 60 + 2 * 150 * 150) / 6.0), 1e-9);
}

TEST(PictureStatistics, TellBlankPictures)
{
  for (const int grey : {0, 128, 255})
  {
    EXPECT_TRUE(isBlank(describePicture(view(std::vector<uint8_t>(64, static_cast<uint8_t>(grey)), 8))));
  }
  EXPECT_TRUE(isBlank(describePicture(view(noise(6400, 0, 4), 80))));
  EXPECT_FALSE(isBlank(describePicture(view(noise(6400, 0, 20), 80))));
  EXPECT_TRUE(isBlank(PictureStatistics()));
}

TEST(PictureStatistics, RatiosOfBrightnessIgnoreDarkWhiteAndOutsidePatches)
{
  const std::vector<uint8_t> first = noise(100 * 50, 60, 100);
  std::vector<uint8_t> second(first);
  for (uint8_t& pixel : second)
  {
    pixel = static_cast<uint8_t>(2 * pixel);
  }
  std::fill(second.begin(), second.begin() + 100 * 25, 255);
  std::vector<std::pair<Pixel, Pixel>> points;
  for (int i = 0; i < 10; ++i)
  {
    const Pixel good{static_cast<float>(5 + 9 * i), 40.0F};
    points.emplace_back(good, good);
    points.emplace_back(Pixel{good.x, 10.0F}, Pixel{good.x, 10.0F});
    points.emplace_back(Pixel{-5.0F, 10.0F}, good);
    points.emplace_back(good, Pixel{good.x, std::nanf("")});
  }
  const std::optional<double> ratio = brightnessRatio(view(first, 100), view(second, 100), points);
  ASSERT_TRUE(ratio);
  EXPECT_NEAR(*ratio, 0.5, 1e-9);
  points.resize(20);  // five good ones
  EXPECT_FALSE(brightnessRatio(view(first, 100), view(second, 100), points));
}

TEST(PictureStatistics, MultipliesRoundedAndSaturated)
{
  for (const double gain : {0.25, 0.5, 1.0, 1.1, 3.7})
  {
    const Pyramid pyramid = pi_runtime::Buffer::allocate(261);  // not a multiple of any vector
    auto* bytes = pyramid->hostAs<uint8_t>(pi_runtime::Access::WRITE);
    for (int i = 0; i < 261; ++i)
    {
      bytes[i] = static_cast<uint8_t>(i);
    }
    multiplyPyramid(pyramid, gain);
    for (int i = 0; i < 261; ++i)
    {
      // The factor is a multiple of 1 / 2048, and the product cut to an eighth before it is rounded.
      EXPECT_NEAR(bytes[i], std::min(255.0, (i % 256) * gain), 0.5 + 0.125 + 255.0 / 4096) << i << " times " << gain;
    }
  }
}
