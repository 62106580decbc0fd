#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/features2d.hpp>
#include <tuple>

#include "kernel_test_images.h"
#include "kernel_test_runs.h"
#include <pi_runtime/kernels/fast_corners.h>

namespace pi_runtime
{
namespace
{

using kernels::Corner;
using kernels::FastCornersShape;

const CodeletPtr FAST_CORNERS = kernels::fastCornersCodelet();

/// Column, row, score.
using Corners = std::vector<std::tuple<int, int, int>>;

Corners openCvCorners(const cv::Mat& image, int threshold)
{
  std::vector<cv::KeyPoint> points;
  cv::FAST(image, points, threshold, true, cv::FastFeatureDetector::TYPE_9_16);
  Corners corners;
  for (const cv::KeyPoint& point : points)
  {
    corners.emplace_back(static_cast<int>(point.pt.x), static_cast<int>(point.pt.y), static_cast<int>(point.response));
  }
  return corners;
}

/// One fast_corners task with gaps between the rows.
struct FastTask
{
  FastTask(const cv::Mat& image, int threshold, int capacity)
    : corners(Buffer::allocate(sizeof(Corner) * static_cast<size_t>(capacity)))
    , count(Buffer::allocate(sizeof(uint32_t)))
    , work(Buffer::allocate(std::max<size_t>(1, kernels::fastCornersWorkBytes(image.cols, image.rows))))
  {
    const int gap = 3;
    const FastCornersShape shape{image.cols, image.rows, image.cols + gap, threshold, capacity};
    arguments = {Argument::in(wrapMat(withGaps(image, gap))), Argument::out(corners), Argument::out(count),
                 Argument::out(work), Argument::value(shape)};
  }

  /// The corners in the list after a run.
  Corners run(bool native)
  {
    for (const BufferPtr& buffer : {corners, count, work})
    {
      std::memset(buffer->host(Access::WRITE), 0xa5, buffer->bytes());
    }
    runOn(native, FAST_CORNERS, arguments, 1);
    found = *count->hostAs<uint32_t>(Access::READ);
    const auto* list = corners->hostAs<Corner>(Access::READ);
    Corners result;
    for (size_t i = 0; i < std::min<size_t>(found, corners->bytes() / sizeof(Corner)); ++i)
    {
      result.emplace_back(list[i].x, list[i].y, list[i].score);
    }
    return result;
  }

  BufferPtr corners;
  BufferPtr count;
  BufferPtr work;
  std::vector<Argument> arguments;
  uint32_t found = 0;
};

TEST(FastCorners, BothImplementationsEqualOpenCv)
{
  for (const cv::Size& size : {cv::Size(640, 480), cv::Size(752, 480), cv::Size(639, 479)})
  {
    for (const Content content : {Content::RANDOM, Content::CONSTANT, Content::GRADIENT, Content::NATURAL})
    {
      for (const int threshold : {0, 7, 20, 60})
      {
        const cv::Mat image = makeImage(content, size.width, size.height);
        const Corners expected = openCvCorners(image, threshold);
        FastTask task(image, threshold, 100000);
        EXPECT_TRUE(task.run(true) == expected) << "native " << size << " threshold " << threshold;
        EXPECT_TRUE(task.run(false) == expected) << "opencl " << size << " threshold " << threshold;
      }
    }
  }
}

TEST(FastCorners, FindsManyInTheTestPicture)
{
  FastTask task(makeImage(Content::NATURAL, 640, 480), 20, 100000);

  EXPECT_GT(task.run(true).size(), 100u);
}

TEST(FastCorners, ReachThreePixelsFromTheBorderAtEverySize)
{
  for (int width = 1; width < 90; ++width)
  {
    for (const int height : {1, 6, 7, 8, 9, 20})
    {
      const cv::Mat image = makeImage(Content::RANDOM, width, height, width * 100 + height);
      const Corners expected = openCvCorners(image, 1);
      FastTask task(image, 1, 1000);
      ASSERT_TRUE(task.run(true) == expected) << "native " << width << " x " << height;
      ASSERT_TRUE(task.run(false) == expected) << "opencl " << width << " x " << height;
    }
  }
}

TEST(FastCorners, HaveScoresUpToTheLargestContrast)
{
  cv::Mat image(15, 40, CV_8UC1, cv::Scalar(0));
  image.at<uint8_t>(7, 20) = 255;
  const Corners expected = {{20, 7, 254}};
  FastTask task(image, 254, 10);

  EXPECT_EQ(task.run(true), expected);
  EXPECT_EQ(task.run(false), expected);
}

TEST(FastCorners, CountsBeyondTheCapacityAndKeepsTheFirst)
{
  const cv::Mat image = makeImage(Content::RANDOM, 320, 200);
  const Corners all = openCvCorners(image, 20);
  ASSERT_GT(all.size(), 50u);
  for (const bool native : {true, false})
  {
    FastTask task(image, 20, 50);
    const Corners list = task.run(native);
    EXPECT_EQ(list, Corners(all.begin(), all.begin() + 50));
    EXPECT_EQ(task.found, all.size());
  }
}

TEST(FastCorners, RefusesArgumentsThatDoNotFit)
{
  const FastTask task(makeImage(Content::RANDOM, 64, 48), 20, 100);
  std::vector<Argument> arguments = task.arguments;
  arguments[0] = Argument::in(Buffer::allocate(67 * 47 + 63));
  expectRefused(FAST_CORNERS, arguments, 1, "argument 0 (image) has 3212 bytes, must have at least 3213");
  arguments = task.arguments;
  arguments[1] = Argument::out(Buffer::allocate(799));
  expectRefused(FAST_CORNERS, arguments, 1, "argument 1 (corners) has 799 bytes, must have at least 800");
  arguments = task.arguments;
  arguments[2] = Argument::out(Buffer::allocate(2));
  expectRefused(FAST_CORNERS, arguments, 1, "argument 2 (count) has 2 bytes");
  arguments = task.arguments;
  arguments[3] = Argument::out(Buffer::allocate(10));
  expectRefused(FAST_CORNERS, arguments, 1, "argument 3 (working memory) has 10 bytes");
  arguments = task.arguments;
  arguments[4] = Argument::value(FastCornersShape{64, 48, 67, 255, 100});
  expectRefused(FAST_CORNERS, arguments, 1, "threshold = 255, must be 0 to 254");
  arguments[4] = Argument::value(FastCornersShape{64, 48, 67, 20, 0});
  expectRefused(FAST_CORNERS, arguments, 1, "capacity = 0, must be 1");
  expectRefused(FAST_CORNERS, task.arguments, 2, "the range is 2, must be 1");
}

}  // namespace
}  // namespace pi_runtime
