#include <gtest/gtest.h>

#include "codelet_runner.h"
#include "kernel_pictures.h"
#include <pi_runtime/kernels/gaussian_blur.h>

namespace pi_runtime
{
namespace kernels
{
namespace
{

class GaussianBlur7 : public testing::Test
{
protected:
  struct Job
  {
    std::vector<Argument> arguments;
    cv::Mat output;
  };

  static Job job(const cv::Mat& source)
  {
    const cv::Mat frame(source.rows, source.cols + 5, CV_8U, cv::Scalar(77));
    const cv::Mat output = frame(cv::Rect(0, 0, source.cols, source.rows));
    const BlurGeometry geometry{source.cols, source.rows, static_cast<int>(source.step[0]),
                                static_cast<int>(output.step[0])};
    return {{Argument::in(wrapMat(source)), Argument::inOut(wrapMat(output)), Argument::value(geometry)}, output};
  }

  static void expectOpenCvsBits(const cv::Mat& source)
  {
    cv::Mat expected;
    cv::GaussianBlur(source.clone(), expected, cv::Size(7, 7), 2, 2);
    const Job native = job(source);
    const Job opencl = job(source);
    CodeletRunner::shared().native(gaussianBlur7Codelet(), native.arguments, source.rows);
    CodeletRunner::shared().opencl(gaussianBlur7Codelet(), opencl.arguments, source.rows);
    EXPECT_EQ(cv::norm(native.output, expected, cv::NORM_INF), 0) << "native, " << source.size();
    EXPECT_EQ(cv::norm(opencl.output, expected, cv::NORM_INF), 0) << "OpenCL, " << source.size();
    if (source.rows > 1)
    {
      EXPECT_EQ(opencl.output.ptr(0)[source.cols], 77) << "wrote past the row";
    }
  }
};

TEST_F(GaussianBlur7, GivesOpenCvsBitsOnPictures)
{
  expectOpenCvsBits(makePicture(640, 480, 1));
  expectOpenCvsBits(makePicture(639, 479, 1));
  expectOpenCvsBits(makePicture(752, 480, 1)(cv::Rect(5, 3, 701, 400)));
}

TEST_F(GaussianBlur7, GivesOpenCvsBitsOnExtremeValues)
{
  cv::Mat noise(97, 131, CV_8U);
  cv::RNG(1).fill(noise, cv::RNG::UNIFORM, 0, 2);
  expectOpenCvsBits(noise * 255);
  expectOpenCvsBits(cv::Mat(40, 50, CV_8U, cv::Scalar(255)));
  expectOpenCvsBits(cv::Mat(40, 50, CV_8U, cv::Scalar(0)));
}

TEST_F(GaussianBlur7, TakesImagesSmallerThanItself)
{
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(2, 2), cv::Size(3, 1), cv::Size(1, 9), cv::Size(22, 4)})
  {
    expectOpenCvsBits(makePicture(size.width, size.height, 1));
  }
}

TEST_F(GaussianBlur7, InSlicesEqualsTheWhole)
{
  const cv::Mat picture = makePicture(321, 243, 1);
  const Job whole = job(picture);
  const Job native = job(picture);
  const Job opencl = job(picture);
  CodeletRunner::shared().native(gaussianBlur7Codelet(), whole.arguments, 243);
  CodeletRunner::shared().nativeSliced(gaussianBlur7Codelet(), native.arguments, 243, 10);
  CodeletRunner::shared().openclSliced(gaussianBlur7Codelet(), opencl.arguments, 243, 50);
  EXPECT_EQ(cv::norm(whole.output, native.output, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(whole.output, opencl.output, cv::NORM_INF), 0);
}

TEST_F(GaussianBlur7, RefusesWhatDoesNotFit)
{
  const cv::Mat picture = makePicture(64, 48, 1);
  for (const BlurGeometry& bad :
       {BlurGeometry{64, 49, 64, 69}, BlurGeometry{64, 48, 63, 69}, BlurGeometry{0, 48, 64, 69}})
  {
    std::vector<Argument> arguments = job(picture).arguments;
    arguments[2] = Argument::value(bad);
    EXPECT_THROW(CodeletRunner::shared().native(gaussianBlur7Codelet(), arguments, 48), std::runtime_error);
    EXPECT_THROW(CodeletRunner::shared().opencl(gaussianBlur7Codelet(), arguments, 48), std::runtime_error);
  }
}

}  // namespace
}  // namespace kernels
}  // namespace pi_runtime
