#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

#include <pi_runtime/kernels/blob.h>
#include "kernel_cases.h"
#include "kernels/kernel_pictures.h"
#include "kernels/ssd_outputs.h"

namespace pi_runtime
{
namespace
{

using namespace kernels;

KernelCase blobCase(CodeletRunner& runner, int size)
{
  const cv::Mat source = makePicture(640, 480, 3);
  const BlobGeometry geometry{640, 480, 640 * 3, 3, size, size, 0};
  const BlobColours colours{{127.5F, 127.5F, 127.5F}, {1.0F / 127.5F, 1.0F / 127.5F, 1.0F / 127.5F}, 1, 0};
  const BufferPtr destination = Buffer::allocate(static_cast<size_t>(3) * size * size * sizeof(float));
  const std::vector<Argument> arguments{Argument::in(wrapMat(source)), Argument::in(makeBlobPlan(geometry)),
                                        Argument::out(destination), Argument::value(geometry),
                                        Argument::value(colours)};
  const CodeletPtr codelet = blobCodelet();
  KernelCase result;
  result.name = "blob 640x480 to " + std::to_string(size) + " float";
  result.native = [&runner, codelet, arguments, size] { runner.native(codelet, arguments, size); };
  result.opencl = [&runner, codelet, arguments, size] { runner.opencl(codelet, arguments, size); };
  result.opencv = [source, size, output = cv::Mat()]() mutable
  { cv::dnn::blobFromImage(source, output, 1.0 / 127.5, cv::Size(size, size), cv::Scalar::all(127.5), true, false); };
  return result;
}

/// OpenCV's DetectionOutput layer takes scores, so that softmax has no counterpart there.
KernelCase ssdCase(CodeletRunner& runner, const std::string& name, SsdOutputs outputs, bool softmax)
{
  if (!softmax)
  {
    softmaxRows(&outputs);
  }
  const SsdVariances variances{0.1F, 0.1F, 0.2F, 0.2F};
  const SsdShape shape{static_cast<int32_t>(outputs.priors.size()),
                       outputs.classes,
                       0,
                       400,
                       100,
                       0.01F,
                       0.45F,
                       softmax ? SSD_SOFTMAX : SSD_RAW};
  const auto in = [](auto& values)
  {
    return Argument::in(
        wrapMat(cv::Mat(1, static_cast<int>(values.size() * sizeof(values[0])), CV_8U, values.data()).clone()));
  };
  const std::vector<Argument> arguments{
      in(outputs.locations),
      in(outputs.confidences),
      in(outputs.priors),
      Argument::out(Buffer::allocate(ssdWorkBytes(shape))),
      Argument::out(Buffer::allocate(static_cast<size_t>(shape.keep_top_k) * sizeof(SsdDetection))),
      Argument::out(Buffer::allocate(sizeof(int32_t))),
      Argument::value(shape),
      Argument::value(variances)};
  const CodeletPtr codelet = ssdPostprocessCodelet();
  KernelCase result;
  result.name = name + (softmax ? " softmax" : " scores");
  result.native = [&runner, codelet, arguments] { runner.native(codelet, arguments, 1); };
  result.opencl = [&runner, codelet, arguments] { runner.opencl(codelet, arguments, 1); };
  if (!softmax)
  {
    const auto layer = std::make_shared<OpenCvDetectionOutput>(outputs, shape, variances);
    result.opencv = [layer] { layer->run(); };
  }
  return result;
}

}  // namespace

std::vector<KernelCase> imageCases(CodeletRunner& runner)
{
  const SsdOutputs mobilenet = makeSsdOutputs(mobilenetSsdPriors(), 91, 1);
  const SsdOutputs ssd300 = makeSsdOutputs(ssd300Priors(), 21, 2);
  return {blobCase(runner, 300), ssdCase(runner, "ssd_postprocess 1917 x 91", mobilenet, false),
          ssdCase(runner, "ssd_postprocess 1917 x 91", mobilenet, true),
          ssdCase(runner, "ssd_postprocess 8732 x 21", ssd300, false),
          ssdCase(runner, "ssd_postprocess 8732 x 21", ssd300, true)};
}

}  // namespace pi_runtime
