#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "codelet_runner.h"
#include "kernel_pictures.h"
#include "kernels/rectify.h"

namespace pi_runtime
{
namespace kernels
{
namespace
{

const cv::Matx33d EUROC_K(458.654, 0, 367.215, 0, 457.296, 248.375, 0, 0, 1);
const cv::Vec4d RADTAN(-0.28340811, 0.07395907, 0.00019359, 1.76187e-05);
const cv::Vec4d EQUIDISTANT(-0.013, 0.021, -0.011, 0.0024);

cv::Matx33d smallRotation()
{
  cv::Matx33d R;
  cv::Rodrigues(cv::Vec3d(0.01, -0.02, 0.03), R);
  return R;
}

CameraIntrinsics camera(LensModel model)
{
  const cv::Vec4d& d = model == LensModel::RADTAN ? RADTAN : EQUIDISTANT;
  return {model, EUROC_K(0, 0), EUROC_K(1, 1), EUROC_K(0, 2), EUROC_K(1, 2), {d[0], d[1], d[2], d[3], 0.0}};
}

RectifiedCamera view(double f, int width, int height)
{
  RectifiedCamera result;
  const cv::Matx33d R = smallRotation();
  std::copy(R.val, R.val + 9, result.R_rect_cam.begin());
  result.fx = result.fy = f;
  result.cx = width / 2.0;
  result.cy = height / 2.0;
  return result;
}

struct Table
{
  Table(int width, int height) : xy(height, width, CV_16SC2), fraction(height, width, CV_16UC1) {}
  cv::Mat xy;
  cv::Mat fraction;
};

Table tableFor(LensModel model, double f, int width, int height)
{
  Table table(width, height);
  buildRemapTable(camera(model), view(f, width, height), width, height, table.xy.ptr<int16_t>(),
                  table.fraction.ptr<uint16_t>());
  return table;
}

/// Positions in 32nds of a pixel.
cv::Point positionAt(const Table& table, int x, int y)
{
  const auto xy = table.xy.at<cv::Vec2s>(y, x);
  const int fraction = table.fraction.at<uint16_t>(y, x);
  return {xy[0] * 32 + (fraction & 31), xy[1] * 32 + (fraction >> 5)};
}

/// OpenCV's AVX2 code uses fused multiply-add, so a few positions may round the other way.
void expectSamePositions(const Table& ours, const Table& reference)
{
  int different = 0;
  for (int y = 0; y < ours.xy.rows; ++y)
  {
    for (int x = 0; x < ours.xy.cols; ++x)
    {
      const cv::Point d = positionAt(ours, x, y) - positionAt(reference, x, y);
      ASSERT_LE(std::max(std::abs(d.x), std::abs(d.y)), 1) << "at " << x << ", " << y;
      different += d != cv::Point();
    }
  }
  EXPECT_LE(different, static_cast<int>(ours.xy.total() / 1000));
}

TEST(RemapTable, OfARadtanLensIsOpenCvs)
{
  const Table ours = tableFor(LensModel::RADTAN, 420, 752, 480);
  Table reference(752, 480);
  const cv::Matx33d K(420, 0, 376, 0, 420, 240, 0, 0, 1);
  cv::initUndistortRectifyMap(EUROC_K, RADTAN, smallRotation(), K, {752, 480}, CV_16SC2, reference.xy,
                              reference.fraction);
  expectSamePositions(ours, reference);
}

TEST(RemapTable, OfAnEquidistantLensIsOpenCvs)
{
  const Table ours = tableFor(LensModel::EQUIDISTANT, 250, 639, 479);
  Table reference(639, 479);
  const cv::Matx33d K(250, 0, 319.5, 0, 250, 239.5, 0, 0, 1);
  cv::fisheye::initUndistortRectifyMap(EUROC_K, EQUIDISTANT, smallRotation(), K, {639, 479}, CV_16SC2, reference.xy,
                                       reference.fraction);
  expectSamePositions(ours, reference);
}

TEST(RemapTable, MarksRaysBehindTheCamera)
{
  RectifiedCamera backwards = view(100, 8, 8);
  backwards.R_rect_cam = {-1, 0, 0, 0, 1, 0, 0, 0, -1};
  Table table(8, 8);
  buildRemapTable(camera(LensModel::RADTAN), backwards, 8, 8, table.xy.ptr<int16_t>(), table.fraction.ptr<uint16_t>());
  EXPECT_EQ(table.xy.at<cv::Vec2s>(3, 3), cv::Vec2s(INT16_MIN, INT16_MIN));
}

TEST(RemapTable, RefusesSizesAndFocalLengthsThatMakeNoSense)
{
  int16_t xy[2];
  uint16_t fraction;
  EXPECT_THROW(buildRemapTable(camera(LensModel::RADTAN), view(100, 1, 1), 0, 1, xy, &fraction), std::invalid_argument);
  EXPECT_THROW(buildRemapTable(camera(LensModel::RADTAN), view(0, 1, 1), 1, 1, xy, &fraction), std::invalid_argument);
  EXPECT_THROW(buildRemapTable(camera(LensModel::RADTAN), view(NAN, 1, 1), 1, 1, xy, &fraction), std::invalid_argument);
}

class Remap : public testing::Test
{
protected:
  struct Job
  {
    std::vector<Argument> arguments;
    cv::Mat output;
    uint64_t rows;
  };

  /// The output lies in a wider image, whose other bytes must survive.
  static Job job(const cv::Mat& source, const Table& table)
  {
    const int width = table.xy.cols;
    const int height = table.xy.rows;
    cv::Mat frame(height, width + 7, source.type(), cv::Scalar::all(77));
    cv::Mat output = frame(cv::Rect(0, 0, width, height));
    const RemapGeometry geometry{source.cols, source.rows, static_cast<int>(source.step[0]), source.channels(),
                                 width,       height,      static_cast<int>(output.step[0])};
    return {{Argument::in(wrapMat(source)), Argument::in(wrapMat(table.xy)), Argument::in(wrapMat(table.fraction)),
             Argument::inOut(wrapMat(output)), Argument::value(geometry)},
            output,
            static_cast<uint64_t>(height)};
  }

  static void expectUntouchedPadding(const cv::Mat& output)
  {
    cv::Size whole;
    cv::Point offset;
    output.locateROI(whole, offset);
    for (int y = 0; y + 1 < output.rows; ++y)
    {
      const uchar* padding = output.ptr(y) + output.cols * output.elemSize();
      const size_t bytes = output.step[0] - output.cols * output.elemSize();
      ASSERT_TRUE(std::all_of(padding, padding + bytes, [](uchar value) { return value == 77; })) << "row " << y;
    }
  }

  static void expectOpenCvsBits(const cv::Mat& source, const Table& table)
  {
    cv::Mat expected;
    cv::remap(source, expected, table.xy, table.fraction, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
    const Job native = job(source, table);
    CodeletRunner::shared().native(remapCodelet(), native.arguments, native.rows);
    EXPECT_EQ(cv::norm(native.output, expected, cv::NORM_INF), 0) << "native";
    expectUntouchedPadding(native.output);
    const Job opencl = job(source, table);
    CodeletRunner::shared().opencl(remapCodelet(), opencl.arguments, opencl.rows);
    EXPECT_EQ(cv::norm(opencl.output, expected, cv::NORM_INF), 0) << "OpenCL";
    expectUntouchedPadding(opencl.output);
  }
};

TEST_F(Remap, GivesOpenCvsBitsForOneAndThreeChannels)
{
  for (const int channels : {1, 3})
  {
    for (const cv::Size size : {cv::Size(752, 480), cv::Size(639, 479)})
    {
      const cv::Mat picture = makePicture(size.width, size.height, channels);
      expectOpenCvsBits(picture, tableFor(LensModel::RADTAN, 420, size.width, size.height));
    }
  }
}

TEST_F(Remap, CountsPixelsOutsideTheSourceAsBlack)
{
  // So wide a view that most of it lies outside, and a constant picture, which shows any wrong neighbour.
  const cv::Mat white(120, 160, CV_8UC3, cv::Scalar::all(255));
  const Table table = tableFor(LensModel::EQUIDISTANT, 60, 200, 100);
  expectOpenCvsBits(white, table);
  expectOpenCvsBits(makePicture(160, 120, 1), table);
}

TEST_F(Remap, ReadsSourcesWithPaddedRows)
{
  const cv::Mat frame = makePicture(300, 200, 3);
  expectOpenCvsBits(frame(cv::Rect(11, 5, 201, 150)), tableFor(LensModel::RADTAN, 200, 201, 150));
}

TEST_F(Remap, TakesTheSmallestImages)
{
  cv::RNG random(3);
  for (const cv::Size source : {cv::Size(1, 1), cv::Size(2, 2), cv::Size(3, 1), cv::Size(5, 4)})
  {
    for (const int channels : {1, 3})
    {
      cv::Mat picture(source, CV_8UC(channels));
      random.fill(picture, cv::RNG::UNIFORM, 0, 256);
      Table table(70, 3);
      random.fill(table.xy, cv::RNG::UNIFORM, -2, 6);
      random.fill(table.fraction, cv::RNG::UNIFORM, 0, 1024);
      expectOpenCvsBits(picture, table);
    }
  }
}

TEST_F(Remap, InSlicesEqualsTheWhole)
{
  const cv::Mat picture = makePicture(320, 240, 3);
  const Table table = tableFor(LensModel::RADTAN, 200, 320, 240);
  const Job whole = job(picture, table);
  const Job native = job(picture, table);
  const Job opencl = job(picture, table);
  CodeletRunner::shared().native(remapCodelet(), whole.arguments, 240);
  CodeletRunner::shared().nativeSliced(remapCodelet(), native.arguments, 240, 17);
  CodeletRunner::shared().openclSliced(remapCodelet(), opencl.arguments, 240, 64);
  EXPECT_EQ(cv::norm(whole.output, native.output, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(whole.output, opencl.output, cv::NORM_INF), 0);
}

TEST_F(Remap, RefusesBuffersAndGeometriesThatDoNotFit)
{
  const cv::Mat picture = makePicture(32, 24, 3);
  const Table table = tableFor(LensModel::RADTAN, 30, 32, 24);
  const Job good = job(picture, table);
  const auto geometry = [&](int source_height, int channels, int height) {
    return Argument::value(RemapGeometry{32, source_height, 96, channels, 32, height, 117});
  };
  for (const Argument& bad : {geometry(25, 3, 24), geometry(24, 2, 24), geometry(24, 3, 25), geometry(0, 3, 24)})
  {
    std::vector<Argument> arguments = good.arguments;
    arguments[4] = bad;
    EXPECT_THROW(CodeletRunner::shared().native(remapCodelet(), arguments, 24), std::runtime_error);
    EXPECT_THROW(CodeletRunner::shared().opencl(remapCodelet(), arguments, 24), std::runtime_error);
  }
  EXPECT_THROW(CodeletRunner::shared().native(remapCodelet(), good.arguments, 25), std::runtime_error);
}

}  // namespace
}  // namespace kernels
}  // namespace pi_runtime
