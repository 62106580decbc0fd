#include <gtest/gtest.h>
#include <pi_runtime/kernels/gaussian_blur.h>

#include "kernels/kernel_pictures.h"

namespace pi_runtime::kernels
{
namespace
{

/// The result in a frame of 5 columns that must stay as they are.
cv::Mat framed(const cv::Mat& source)
{
  const cv::Mat frame(source.rows, source.cols + 5, CV_8U, cv::Scalar(77));
  return frame(cv::Rect(0, 0, source.cols, source.rows));
}

void blur(const cv::Mat& source, const cv::Mat& output, int begin, int end)
{
  gaussianBlur7({source.data, source.cols, source.rows, source.step[0]},
                {output.data, output.cols, output.rows, output.step[0]}, begin, end);
}

void expectOpenCvsBits(const cv::Mat& source)
{
  cv::Mat expected;
  cv::GaussianBlur(source.clone(), expected, cv::Size(7, 7), 2, 2);
  const cv::Mat output = framed(source);
  blur(source, output, 0, source.rows);
  EXPECT_EQ(cv::norm(output, expected, cv::NORM_INF), 0) << source.size();
  if (source.rows > 1)
  {
    EXPECT_EQ(output.ptr(0)[source.cols], 77) << "wrote past the row";
  }
}

TEST(GaussianBlur7, GivesOpenCvsBitsOnPictures)
{
  expectOpenCvsBits(makePicture(640, 480, 1));
  expectOpenCvsBits(makePicture(639, 479, 1));
  expectOpenCvsBits(makePicture(752, 480, 1)(cv::Rect(5, 3, 701, 400)));
}

TEST(GaussianBlur7, GivesOpenCvsBitsOnExtremeValues)
{
  cv::Mat noise(97, 131, CV_8U);
  cv::RNG(1).fill(noise, cv::RNG::UNIFORM, 0, 2);
  expectOpenCvsBits(noise * 255);
  expectOpenCvsBits(cv::Mat(40, 50, CV_8U, cv::Scalar(255)));
  expectOpenCvsBits(cv::Mat(40, 50, CV_8U, cv::Scalar(0)));
}

TEST(GaussianBlur7, TakesImagesSmallerThanItself)
{
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(2, 2), cv::Size(3, 1), cv::Size(1, 9), cv::Size(22, 4)})
  {
    expectOpenCvsBits(makePicture(size.width, size.height, 1));
  }
}

TEST(GaussianBlur7, InSlicesEqualsTheWhole)
{
  const cv::Mat picture = makePicture(321, 243, 1);
  const cv::Mat whole = framed(picture);
  const cv::Mat sliced = framed(picture);
  blur(picture, whole, 0, picture.rows);
  for (int begin = 0; begin < picture.rows; begin += 10)
  {
    blur(picture, sliced, begin, std::min(begin + 10, picture.rows));
  }
  EXPECT_EQ(cv::norm(whole, sliced, cv::NORM_INF), 0);
}

}  // namespace
}  // namespace pi_runtime::kernels
