#include <opencv2/calib3d.hpp>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

#include "kernel_pictures.h"
#include "ssd_outputs.h"
#include "kernel_cases.h"
#include <pi_runtime/kernels/blob.h>
#include "kernels/rectify.h"

namespace pi_runtime
{
namespace
{

using namespace kernels;

KernelCase remapCase(CodeletRunner& runner, int channels)
{
  // The left camera of EuRoC, turned a little as rectification does.
  CameraIntrinsics camera{LensModel::RADTAN, 458.654 * 640 / 752,
                          457.296,           367.215 * 640 / 752,
                          248.375,           {-0.28340811, 0.07395907, 0.00019359, 1.76187e-05, 0.0}};
  RectifiedCamera rectified;
  const cv::Matx33d R(0.9999, -0.002, 0.0135, 0.0021, 0.99998, -0.007, -0.0135, 0.007, 0.9999);
  std::copy(R.val, R.val + 9, rectified.R_rect_cam.begin());
  rectified.fx = rectified.fy = 400.0;
  rectified.cx = 320.0;
  rectified.cy = 240.0;
  const cv::Mat source = makePicture(640, 480, channels);
  cv::Mat xy(480, 640, CV_16SC2);
  cv::Mat fraction(480, 640, CV_16UC1);
  buildRemapTable(camera, rectified, 640, 480, xy.ptr<int16_t>(), fraction.ptr<uint16_t>());
  const BufferPtr destination = Buffer::allocate(640 * 480 * channels);
  const RemapGeometry geometry{640, 480, 640 * channels, channels, 640, 480, 640 * channels};
  const std::vector<Argument> arguments{Argument::in(wrapMat(source)), Argument::in(wrapMat(xy)),
                                        Argument::in(wrapMat(fraction)), Argument::out(destination),
                                        Argument::value(geometry)};
  const CodeletPtr codelet = remapCodelet();
  KernelCase result;
  result.name = "remap 640x480x" + std::to_string(channels);
  result.native = [&runner, codelet, arguments] { runner.native(codelet, arguments, 480); };
  result.opencl = [&runner, codelet, arguments] { runner.opencl(codelet, arguments, 480); };
  result.opencv = [source, xy, fraction, output = cv::Mat()]() mutable
  { cv::remap(source, output, xy, fraction, cv::INTER_LINEAR, cv::BORDER_CONSTANT); };
  return result;
}

KernelCase blobCase(CodeletRunner& runner, int size, bool half)
{
  const cv::Mat source = makePicture(640, 480, 3);
  const BlobGeometry geometry{640, 480, 640 * 3, 3, size, size, 0, half ? 1 : 0};
  const BlobColours colours{{127.5F, 127.5F, 127.5F}, 1.0F / 127.5F, 1, 0};
  const BufferPtr destination = Buffer::allocate(static_cast<size_t>(3) * size * size * (half ? 2 : 4));
  const std::vector<Argument> arguments{Argument::in(wrapMat(source)), Argument::in(makeBlobPlan(geometry)),
                                        Argument::out(destination), Argument::value(geometry),
                                        Argument::value(colours)};
  const CodeletPtr codelet = blobCodelet();
  KernelCase result;
  result.name = "blob 640x480 to " + std::to_string(size) + (half ? " half" : " float");
  result.native = [&runner, codelet, arguments, size] { runner.native(codelet, arguments, size); };
  result.opencl = [&runner, codelet, arguments, size] { runner.opencl(codelet, arguments, size); };
  if (!half)
  {
    result.opencv = [source, size, output = cv::Mat()]() mutable
    { cv::dnn::blobFromImage(source, output, 1.0 / 127.5, cv::Size(size, size), cv::Scalar::all(127.5), true, false); };
  }
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
  return {remapCase(runner, 1),
          remapCase(runner, 3),
          blobCase(runner, 300, false),
          blobCase(runner, 300, true),
          ssdCase(runner, "ssd_postprocess 1917 x 91", mobilenet, false),
          ssdCase(runner, "ssd_postprocess 1917 x 91", mobilenet, true),
          ssdCase(runner, "ssd_postprocess 8732 x 21", ssd300, false),
          ssdCase(runner, "ssd_postprocess 8732 x 21", ssd300, true)};
}

}  // namespace pi_runtime
