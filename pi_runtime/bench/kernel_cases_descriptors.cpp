#include <opencv2/features2d.hpp>

#include <pi_runtime/kernels/hamming.h>
#include "kernel_cases.h"
#include "kernels/kernel_pictures.h"

namespace pi_runtime
{
namespace
{

using namespace kernels;

KernelCase hammingCase(CodeletRunner& runner, int count)
{
  cv::Mat queries(count, HAMMING_BYTES, CV_8U);
  cv::Mat trains(count, HAMMING_BYTES, CV_8U);
  cv::RNG random(3);
  for (cv::Mat* descriptors : {&queries, &trains})
  {
    random.fill(*descriptors, cv::RNG::UNIFORM, 0, 256);
  }
  const std::vector<Argument> arguments{
      Argument::in(wrapMat(queries)), Argument::in(wrapMat(trains)),
      Argument::out(Buffer::allocate(static_cast<size_t>(count) * sizeof(HammingMatch))),
      Argument::value(HammingShape{count, count})};
  const CodeletPtr codelet = hammingCodelet();
  KernelCase result;
  result.name = "hamming " + std::to_string(count) + " x " + std::to_string(count);
  result.native = [&runner, codelet, arguments, count] { runner.native(codelet, arguments, count); };
  result.opencl = [&runner, codelet, arguments, count] { runner.opencl(codelet, arguments, count); };
  result.opencv = [queries, trains, matches = std::vector<std::vector<cv::DMatch>>()]() mutable
  { cv::BFMatcher(cv::NORM_HAMMING).knnMatch(queries, trains, matches, 2); };
  return result;
}

}  // namespace

std::vector<KernelCase> descriptorCases(CodeletRunner& runner)
{
  return {hammingCase(runner, 500)};
}

}  // namespace pi_runtime
