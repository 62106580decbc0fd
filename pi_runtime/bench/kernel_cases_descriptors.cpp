#include <opencv2/features2d.hpp>

#include "kernel_pictures.h"
#include "kernel_cases.h"
#include <pi_runtime/kernels/gaussian_blur.h>
#include <pi_runtime/kernels/hamming.h>
#include <pi_runtime/kernels/orb.h>

namespace pi_runtime
{
namespace
{

using namespace kernels;

KernelCase blurCase(CodeletRunner& runner)
{
  const cv::Mat source = makePicture(640, 480, 1);
  const std::vector<Argument> arguments{Argument::in(wrapMat(source)), Argument::out(Buffer::allocate(640 * 480)),
                                        Argument::value(BlurGeometry{640, 480, 640, 640})};
  const CodeletPtr codelet = gaussianBlur7Codelet();
  KernelCase result;
  result.name = "gaussian_blur7 640x480";
  result.native = [&runner, codelet, arguments] { runner.native(codelet, arguments, 480); };
  result.opencl = [&runner, codelet, arguments] { runner.opencl(codelet, arguments, 480); };
  result.opencv = [source, output = cv::Mat()]() mutable { cv::GaussianBlur(source, output, cv::Size(7, 7), 2, 2); };
  return result;
}

/// Smoothing and description together, as cv::ORB::compute does both. That takes orientations as given.
KernelCase orbCase(CodeletRunner& runner, int count)
{
  const cv::Mat image = makePicture(640, 480, 1);
  std::vector<cv::Point2f> points;
  std::vector<cv::KeyPoint> keypoints;
  cv::RNG random(2);
  for (int i = 0; i < count; ++i)
  {
    points.emplace_back(random.uniform(32, 608), random.uniform(32, 448));
    keypoints.emplace_back(points.back(), 31.0F, random.uniform(0.0F, 360.0F), 1.0F, 0);
  }
  const BufferPtr smoothed = Buffer::allocate(640 * 480);
  const std::vector<Argument> blur{Argument::in(wrapMat(image)), Argument::out(smoothed),
                                   Argument::value(BlurGeometry{640, 480, 640, 640})};
  const std::vector<Argument> orb{Argument::in(wrapMat(image)),
                                  Argument::in(smoothed),
                                  Argument::in(wrapMat(cv::Mat(points, true))),
                                  Argument::in(orbTablesBuffer()),
                                  Argument::out(Buffer::allocate(static_cast<size_t>(count) * ORB_BYTES)),
                                  Argument::out(Buffer::allocate(static_cast<size_t>(count) * sizeof(uint16_t))),
                                  Argument::value(OrbShape{640, 480, 640, 640, count})};
  const CodeletPtr first = gaussianBlur7Codelet();
  const CodeletPtr second = orbCodelet();
  KernelCase result;
  result.name = "gaussian_blur7 + orb " + std::to_string(count) + " points";
  result.native = [&runner, first, second, blur, orb, count]
  {
    runner.native(first, blur, 480);
    runner.native(second, orb, count);
  };
  result.opencl = [&runner, first, second, blur, orb, count]
  {
    runner.opencl(first, blur, 480);
    runner.opencl(second, orb, count);
  };
  result.opencv = [image, keypoints, extractor = cv::ORB::create(count, 1.2F, 1), output = cv::Mat()]() mutable
  { extractor->compute(image, keypoints, output); };
  return result;
}

KernelCase hammingCase(CodeletRunner& runner, int count, bool stereo)
{
  cv::Mat queries(count, HAMMING_BYTES, CV_8U);
  cv::Mat trains(count, HAMMING_BYTES, CV_8U);
  cv::Mat query_positions(count, 2, CV_32F);
  cv::Mat train_positions(count, 2, CV_32F);
  cv::RNG random(3);
  for (cv::Mat* descriptors : {&queries, &trains})
  {
    random.fill(*descriptors, cv::RNG::UNIFORM, 0, 256);
  }
  for (cv::Mat* positions : {&query_positions, &train_positions})
  {
    random.fill(*positions, cv::RNG::UNIFORM, 0, 480);
  }
  const std::vector<Argument> arguments{
      Argument::in(wrapMat(queries)),
      Argument::in(wrapMat(trains)),
      Argument::in(wrapMat(query_positions)),
      Argument::in(wrapMat(train_positions)),
      Argument::out(Buffer::allocate(static_cast<size_t>(count) * sizeof(HammingMatch))),
      Argument::value(HammingShape{count, count, stereo ? 1 : 0, 2.0F, 0.0F, 100.0F})};
  const CodeletPtr codelet = hammingCodelet();
  KernelCase result;
  result.name = "hamming " + std::to_string(count) + " x " + std::to_string(count) + (stereo ? " stereo" : "");
  result.native = [&runner, codelet, arguments, count] { runner.native(codelet, arguments, count); };
  result.opencl = [&runner, codelet, arguments, count] { runner.opencl(codelet, arguments, count); };
  if (!stereo)
  {
    result.opencv = [queries, trains, matches = std::vector<std::vector<cv::DMatch>>()]() mutable
    { cv::BFMatcher(cv::NORM_HAMMING).knnMatch(queries, trains, matches, 2); };
  }
  return result;
}

}  // namespace

std::vector<KernelCase> descriptorCases(CodeletRunner& runner)
{
  return {blurCase(runner), orbCase(runner, 500), hammingCase(runner, 500, false), hammingCase(runner, 500, true)};
}

}  // namespace pi_runtime
