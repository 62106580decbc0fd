#include <gtest/gtest.h>

#include <opencv2/dnn.hpp>

#include <pi_runtime/kernels/blob.h>
#include "kernels/codelet_runner.h"
#include "kernels/kernel_pictures.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr float SCALE = 1.0F / 57.0F;
const BlobColours COLOURS{{123.7F, 116.3F, 103.5F}, {SCALE, SCALE, SCALE}, 1, 114};

class Blob : public testing::Test
{
protected:
  struct Job
  {
    std::vector<Argument> arguments;
    BufferPtr output;
    uint64_t rows;
  };

  static BlobGeometry geometryOf(const cv::Mat& source, cv::Size size)
  {
    return {source.cols, source.rows, static_cast<int>(source.step[0]), source.channels(), size.width, size.height, 0};
  }

  static Job job(const cv::Mat& source, const BlobGeometry& geometry, const BlobColours& colours)
  {
    const size_t elements = static_cast<size_t>(geometry.channels) * geometry.width * geometry.height;
    const BufferPtr output = Buffer::allocate(elements * sizeof(float));
    return {{Argument::in(wrapMat(source)), Argument::in(makeBlobPlan(geometry)), Argument::out(output),
             Argument::value(geometry), Argument::value(colours)},
            output,
            static_cast<uint64_t>(geometry.height)};
  }

  /// The output of both implementations, which must have the same bits.
  static BufferPtr run(const cv::Mat& source, const BlobGeometry& geometry, const BlobColours& colours)
  {
    const Job native = job(source, geometry, colours);
    const Job opencl = job(source, geometry, colours);
    CodeletRunner::shared().native(blobCodelet(), native.arguments, native.rows);
    CodeletRunner::shared().opencl(blobCodelet(), opencl.arguments, opencl.rows);
    EXPECT_EQ(std::memcmp(native.output->host(Access::READ), opencl.output->host(Access::READ), native.output->bytes()),
              0);
    return native.output;
  }

  /// Largest difference to a blob of OpenCV, in grey levels.
  static double levelsApart(const BufferPtr& output, const cv::Mat& expected, float scale)
  {
    const auto* ours = output->hostAs<const float>(Access::READ);
    const auto* theirs = expected.ptr<float>();
    double most = 0.0;
    for (size_t i = 0; i < expected.total(); ++i)
    {
      most = std::max(most, std::abs(static_cast<double>(ours[i]) - theirs[i]) / scale);
    }
    return most;
  }

  static cv::Mat openCvs(const cv::Mat& source, cv::Size size, const BlobColours& colours)
  {
    return cv::dnn::blobFromImage(source, colours.scale[0], size,
                                  cv::Scalar(colours.mean[0], colours.mean[1], colours.mean[2]), colours.swap_rb != 0,
                                  false, CV_32F);
  }
};

constexpr double FLOAT_ROUNDING = 1e-3;  ///< [levels]: a few last bits of values near 255

TEST_F(Blob, StretchesAndNormalisesAsBlobFromImageDoes)
{
  for (const cv::Size from : {cv::Size(640, 480), cv::Size(639, 479), cv::Size(1280, 720), cv::Size(160, 100)})
  {
    const cv::Mat picture = makePicture(from.width, from.height, 3);
    for (const cv::Size to : {cv::Size(300, 300), cv::Size(416, 257), cv::Size(17, 5)})
    {
      const BufferPtr output = run(picture, geometryOf(picture, to), COLOURS);
      EXPECT_LT(levelsApart(output, openCvs(picture, to, COLOURS), SCALE), FLOAT_ROUNDING) << from << " to " << to;
    }
  }
}

TEST_F(Blob, KeepsTheOrderOfChannelsIfAskedTo)
{
  BlobColours colours = COLOURS;
  colours.swap_rb = 0;
  const cv::Mat picture = makePicture(320, 200, 3);
  const BufferPtr output = run(picture, geometryOf(picture, {300, 300}), colours);
  EXPECT_LT(levelsApart(output, openCvs(picture, {300, 300}, colours), colours.scale[0]), FLOAT_ROUNDING);
}

TEST_F(Blob, TakesGreyImages)
{
  BlobColours colours = COLOURS;
  colours.swap_rb = 0;  // OpenCV would take the third mean for the only channel
  const cv::Mat picture = makePicture(321, 200, 1);
  const BufferPtr output = run(picture, geometryOf(picture, {96, 96}), colours);
  EXPECT_LT(levelsApart(output, openCvs(picture, {96, 96}, colours), colours.scale[0]), FLOAT_ROUNDING);
}

TEST_F(Blob, IsOneLevelFromOpenCvAtExactlyHalfTheSize)
{
  const cv::Mat picture = makePicture(600, 600, 3);
  const BufferPtr output = run(picture, geometryOf(picture, {300, 300}), COLOURS);
  EXPECT_LE(levelsApart(output, openCvs(picture, {300, 300}, COLOURS), SCALE), 1.0 + FLOAT_ROUNDING);
}

TEST_F(Blob, CopiesAnImageOfTheRightSize)
{
  const cv::Mat picture = makePicture(300, 300, 3);
  const BufferPtr output = run(picture, geometryOf(picture, {300, 300}), {{0, 0, 0}, {1.0F, 1.0F, 1.0F}, 0, 0});
  const auto* values = output->hostAs<const float>(Access::READ);
  for (int channel = 0; channel < 3; ++channel)
  {
    EXPECT_EQ(values[(channel * 300 + 20) * 300 + 299], picture.at<cv::Vec3b>(20, 299)[channel]);
  }
}

TEST_F(Blob, LetterboxKeepsTheAspectRatioBetweenBars)
{
  for (const cv::Size from : {cv::Size(640, 360), cv::Size(201, 480)})
  {
    const cv::Mat picture = makePicture(from.width, from.height, 3);
    BlobGeometry geometry = geometryOf(picture, {300, 300});
    geometry.letterbox = BLOB_CENTRED;
    const BlobContent content = blobContent(geometry);
    EXPECT_NEAR(static_cast<double>(content.width) / content.height, static_cast<double>(from.width) / from.height,
                0.01);
    cv::Mat resized;
    cv::Mat boxed;
    cv::resize(picture, resized, cv::Size(content.width, content.height));
    cv::copyMakeBorder(resized, boxed, content.y, 300 - content.y - content.height, content.x,
                       300 - content.x - content.width, cv::BORDER_CONSTANT, cv::Scalar::all(COLOURS.fill));
    const BufferPtr output = run(picture, geometry, COLOURS);
    EXPECT_LT(levelsApart(output, openCvs(boxed, {300, 300}, COLOURS), SCALE), FLOAT_ROUNDING) << from;
  }
}

TEST_F(Blob, LetterboxAtTheTopLeftCutsSidesToWholePixels)
{
  for (const cv::Size from : {cv::Size(640, 427), cv::Size(201, 480), cv::Size(300, 300)})
  {
    const cv::Mat picture = makePicture(from.width, from.height, 3);
    BlobGeometry geometry = geometryOf(picture, {300, 300});
    geometry.letterbox = BLOB_AT_TOP_LEFT;
    const double ratio = std::min(300.0 / from.width, 300.0 / from.height);
    const cv::Size content(static_cast<int>(from.width * ratio), static_cast<int>(from.height * ratio));
    cv::Mat resized;
    cv::resize(picture, resized, content);
    cv::Mat boxed(300, 300, CV_8UC3, cv::Scalar::all(COLOURS.fill));
    resized.copyTo(boxed(cv::Rect(cv::Point(0, 0), content)));
    const BufferPtr output = run(picture, geometry, COLOURS);
    EXPECT_LT(levelsApart(output, openCvs(boxed, {300, 300}, COLOURS), SCALE), FLOAT_ROUNDING) << from;
  }
}

TEST_F(Blob, ScalesEachPlaneByItsOwnFactor)
{
  const BlobColours colours{{103.5F, 116.3F, 123.7F}, {1.0F / 57.4F, 1.0F / 57.1F, 1.0F / 58.4F}, 0, 0};
  const cv::Mat picture = makePicture(300, 300, 3);
  const BufferPtr output = run(picture, geometryOf(picture, {300, 300}), colours);
  const auto* values = output->hostAs<const float>(Access::READ);
  for (int plane = 0; plane < 3; ++plane)
  {
    const float level = picture.at<cv::Vec3b>(20, 299)[plane];
    EXPECT_FLOAT_EQ(values[(plane * 300 + 20) * 300 + 299], (level - colours.mean[plane]) * colours.scale[plane]);
  }
}

TEST_F(Blob, ReadsPaddedRowsAndTheSmallestImages)
{
  const cv::Mat frame = makePicture(300, 200, 3);
  for (const cv::Rect part : {cv::Rect(11, 5, 201, 150), cv::Rect(290, 190, 2, 1), cv::Rect(100, 0, 3, 200)})
  {
    const cv::Mat picture = frame(part);
    const BufferPtr output = run(picture, geometryOf(picture, {40, 30}), COLOURS);
    EXPECT_LT(levelsApart(output, openCvs(picture, {40, 30}, COLOURS), SCALE), FLOAT_ROUNDING) << part;
  }
}

TEST_F(Blob, InSlicesEqualsTheWhole)
{
  const cv::Mat picture = makePicture(640, 480, 3);
  const BlobGeometry geometry = geometryOf(picture, {300, 300});
  const Job whole = job(picture, geometry, COLOURS);
  const Job native = job(picture, geometry, COLOURS);
  const Job opencl = job(picture, geometry, COLOURS);
  CodeletRunner::shared().native(blobCodelet(), whole.arguments, 300);
  CodeletRunner::shared().nativeSliced(blobCodelet(), native.arguments, 300, 7);
  CodeletRunner::shared().openclSliced(blobCodelet(), opencl.arguments, 300, 64);
  const void* expected = whole.output->host(Access::READ);
  EXPECT_EQ(std::memcmp(expected, native.output->host(Access::READ), whole.output->bytes()), 0);
  EXPECT_EQ(std::memcmp(expected, opencl.output->host(Access::READ), whole.output->bytes()), 0);
}

TEST_F(Blob, RefusesWhatDoesNotFit)
{
  const cv::Mat picture = makePicture(64, 48, 3);
  const BlobGeometry good = geometryOf(picture, {30, 20});
  const auto refuses = [&](size_t index, const Argument& bad, uint64_t rows)
  {
    std::vector<Argument> arguments = job(picture, good, COLOURS).arguments;
    arguments[index] = bad;
    EXPECT_THROW(CodeletRunner::shared().native(blobCodelet(), arguments, rows), std::runtime_error)
        << "argument " << index;
    EXPECT_THROW(CodeletRunner::shared().opencl(blobCodelet(), arguments, rows), std::runtime_error)
        << "argument " << index;
  };
  BlobGeometry bad = good;
  bad.channels = 4;
  refuses(3, Argument::value(bad), 20);
  bad = good;
  bad.source_height = 49;
  refuses(3, Argument::value(bad), 20);
  bad = good;
  bad.letterbox = 3;
  refuses(3, Argument::value(bad), 20);
  refuses(1, Argument::in(Buffer::allocate(blobPlanBytes(good) - 4)), 20);
  refuses(2, Argument::out(Buffer::allocate(30 * 20 * 3 * 4 - 1)), 20);
  BlobColours too_bright = COLOURS;
  too_bright.fill = 256;
  refuses(4, Argument::value(too_bright), 20);
  refuses(4, Argument::value(COLOURS), 21);
  bad = good;
  bad.source_width = 1;
  EXPECT_THROW(makeBlobPlan(bad), std::invalid_argument);
}

}  // namespace
}  // namespace pi_runtime::kernels
