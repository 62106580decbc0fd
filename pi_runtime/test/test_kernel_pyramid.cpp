#include <gtest/gtest.h>

#include <stdexcept>

#include "kernel_test_images.h"
#include "kernel_test_runs.h"
#include <pi_runtime/kernels/pyramid.h>

namespace pi_runtime
{
namespace
{

using kernels::PyramidLayout;
using kernels::PyramidShape;

const CodeletPtr PYRAMID_DOWN = kernels::pyramidDownCodelet();
const CodeletPtr IMAGE_PYRAMID = kernels::imagePyramidCodelet();

/// One pyramid_down task with strides larger than the rows.
struct DownTask
{
  explicit DownTask(const cv::Mat& image, int extra_stride = 5)
    : width((image.cols + 1) / 2), height((image.rows + 1) / 2), stride(width + extra_stride)
  {
    const PyramidShape shape{image.cols, image.rows, image.cols + extra_stride, stride, 0};
    destination = Buffer::allocate(static_cast<size_t>(stride) * height);
    arguments = {Argument::in(wrapMat(withGaps(image, extra_stride))), Argument::out(destination),
                 Argument::value(shape)};
  }
  cv::Mat result() const { return toImage(destination, width, height, stride); }
  void clear() const { std::memset(destination->host(Access::WRITE), 0xa5, destination->bytes()); }

  const int width;
  const int height;
  const int stride;
  BufferPtr destination;
  std::vector<Argument> arguments;
};

std::vector<cv::Mat> testImages()
{
  std::vector<cv::Mat> images;
  for (const cv::Size& size : {cv::Size(640, 480), cv::Size(752, 480), cv::Size(639, 479)})
  {
    for (const Content content : {Content::RANDOM, Content::CONSTANT, Content::GRADIENT, Content::NATURAL})
    {
      images.push_back(makeImage(content, size.width, size.height));
    }
  }
  return images;
}

cv::Mat openCvDown(const cv::Mat& image)
{
  cv::Mat smaller;
  cv::pyrDown(image, smaller);
  return smaller;
}

TEST(PyramidDown, BothImplementationsEqualOpenCv)
{
  for (const cv::Mat& image : testImages())
  {
    const DownTask task(image);
    const cv::Mat expected = openCvDown(image);
    for (const bool native : {true, false})
    {
      task.clear();
      runOn(native, PYRAMID_DOWN, task.arguments, task.height);
      EXPECT_EQ(differences(task.result(), expected), 0) << (native ? "native " : "opencl ") << image.size();
    }
  }
}

TEST(PyramidDown, MirrorsAtTheBordersOfTheSmallestImages)
{
  for (int width = 1; width <= 70; ++width)
  {
    for (const int height : {1, 2, 3, 4, 17})
    {
      const cv::Mat image = makeImage(Content::RANDOM, width, height);
      const DownTask task(image, 0);
      const cv::Mat expected = openCvDown(image);
      for (const bool native : {true, false})
      {
        task.clear();
        runOn(native, PYRAMID_DOWN, task.arguments, task.height);
        ASSERT_EQ(differences(task.result(), expected), 0) << (native ? "native " : "opencl ") << image.size();
      }
    }
  }
}

TEST(PyramidDown, WritesNothingBetweenTheRows)
{
  const DownTask task(makeImage(Content::RANDOM, 101, 41));
  task.clear();
  CodeletRunner::shared().opencl(PYRAMID_DOWN, task.arguments, task.height);
  CodeletRunner::shared().native(PYRAMID_DOWN, task.arguments, task.height);
  const cv::Mat with_gaps = toImage(task.destination, task.stride, task.height, task.stride);
  EXPECT_EQ(cv::countNonZero(with_gaps.colRange(task.width, task.stride) != 0xa5), 0);
}

TEST(PyramidDown, SlicesEqualTheWhole)
{
  const cv::Mat image = makeImage(Content::NATURAL, 333, 217);
  const DownTask task(image);
  const cv::Mat expected = openCvDown(image);
  const uint64_t slice = 3 * PYRAMID_DOWN->slice_granularity;
  task.clear();
  CodeletRunner::shared().nativeSliced(PYRAMID_DOWN, task.arguments, task.height, slice);
  EXPECT_EQ(differences(task.result(), expected), 0);
  task.clear();
  CodeletRunner::shared().openclSliced(PYRAMID_DOWN, task.arguments, task.height, slice);
  EXPECT_EQ(differences(task.result(), expected), 0);
}

TEST(PyramidDown, RefusesArgumentsThatDoNotFit)
{
  const DownTask task(makeImage(Content::RANDOM, 64, 48));
  std::vector<Argument> arguments = task.arguments;
  arguments[0] = Argument::in(Buffer::allocate(69 * 47 + 63));
  expectRefused(PYRAMID_DOWN, arguments, 24, "argument 0 (source) has 3306 bytes, must have at least 3307");
  arguments = task.arguments;
  arguments[1] = Argument::out(Buffer::allocate(100));
  expectRefused(PYRAMID_DOWN, arguments, 24, "argument 1 (destination) has 100 bytes");
  expectRefused(PYRAMID_DOWN, task.arguments, 25, "the range is 25, must be 24");
  arguments = task.arguments;
  arguments[2] = Argument::value(PyramidShape{0, 48, 69, 37, 0});
  expectRefused(PYRAMID_DOWN, arguments, 24, "width = 0, must be 1 to 32768");
  arguments[2] = Argument::value(PyramidShape{64, 48, 63, 37, 0});
  expectRefused(PYRAMID_DOWN, arguments, 24, "source_stride = 63, must be 64");
}

TEST(ImagePyramid, BothImplementationsEqualOpenCvOnEveryLevel)
{
  for (const cv::Mat& image : testImages())
  {
    const PyramidLayout layout(image.cols, image.rows, 6);
    const BufferPtr pyramid = Buffer::allocate(layout.bytes);
    const PyramidShape shape{image.cols, image.rows, image.cols + 3, 0, layout.levels};
    const std::vector<Argument> arguments = {Argument::in(wrapMat(withGaps(image, 3))), Argument::out(pyramid),
                                             Argument::value(shape)};
    for (const bool native : {true, false})
    {
      std::memset(pyramid->host(Access::WRITE), 0xa5, pyramid->bytes());
      runOn(native, IMAGE_PYRAMID, arguments, 1);
      cv::Mat expected = image;
      for (int i = 0; i < layout.levels; ++i)
      {
        const kernels::PyramidLevel& level = layout.level[i];
        const cv::Mat result = toImage(pyramid, level.width, level.height, level.stride, level.offset);
        EXPECT_EQ(differences(result, expected), 0) << (native ? "native" : "opencl") << " level " << i;
        expected = openCvDown(expected);
      }
    }
  }
}

TEST(ImagePyramid, RefusesArgumentsThatDoNotFit)
{
  const BufferPtr image = Buffer::allocate(64 * 48);
  const size_t bytes = PyramidLayout(64, 48, 3).bytes;
  const Argument shape = Argument::value(PyramidShape{64, 48, 64, 0, 3});
  expectRefused(IMAGE_PYRAMID, {Argument::in(image), Argument::out(Buffer::allocate(bytes - 1)), shape}, 1,
                "argument 1 (pyramid) has " + std::to_string(bytes - 1) + " bytes");
  const BufferPtr pyramid = Buffer::allocate(bytes);
  expectRefused(IMAGE_PYRAMID, {Argument::in(image), Argument::out(pyramid), shape}, 2, "the range is 2, must be 1");
  const Argument nine_levels = Argument::value(PyramidShape{64, 48, 64, 0, 9});
  expectRefused(IMAGE_PYRAMID, {Argument::in(image), Argument::out(pyramid), nine_levels}, 1,
                "levels = 9, must be 1 to 8");
}

TEST(PyramidLayout, PutsLevelsBehindEachOtherWithAlignedRows)
{
  const PyramidLayout layout(639, 479, 3);

  EXPECT_EQ(layout.level[0].stride, 640u);
  EXPECT_EQ(layout.level[1].width, 320);
  EXPECT_EQ(layout.level[1].height, 240);
  EXPECT_EQ(layout.level[1].offset, 640u * 479u);
  EXPECT_EQ(layout.level[2].stride, 192u);
  EXPECT_EQ(layout.level[2].offset, 640u * 479u + 320u * 240u);
  EXPECT_EQ(layout.bytes, layout.level[2].offset + 192u * 120u + 64u);
}

TEST(PyramidLayout, GoesDownToASinglePixel)
{
  const PyramidLayout layout(5, 1, 8);

  EXPECT_EQ(layout.level[7].width, 1);
  EXPECT_EQ(layout.level[7].height, 1);
  EXPECT_THROW(PyramidLayout(5, 0, 2), std::invalid_argument);
  EXPECT_THROW(PyramidLayout(5, 5, 0), std::invalid_argument);
}

}  // namespace
}  // namespace pi_runtime
