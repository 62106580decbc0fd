#include <opencv2/features2d.hpp>

#include <pi_runtime/kernels/hamming.h>
#include "kernel_cases.h"
#include "kernels/kernel_pictures.h"

namespace pi_runtime
{
namespace
{

using namespace kernels;

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
  return {hammingCase(runner, 500, false), hammingCase(runner, 500, true)};
}

}  // namespace pi_runtime
