#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

#include <pi_runtime/kernels/blob.h>
#include "kernel_cases.h"
#include "kernels/kernel_pictures.h"

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

}  // namespace

std::vector<KernelCase> imageCases(CodeletRunner& runner)
{
  return {blobCase(runner, 300)};
}

}  // namespace pi_runtime
