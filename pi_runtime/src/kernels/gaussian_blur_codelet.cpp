#include <string>

#include "kernels/codelet_arguments.h"
#include "kernels/image_bytes.h"
#include "kernel_sources.h"
#include <pi_runtime/kernels/gaussian_blur.h>
#include <pi_runtime/opencl_command.h>

namespace pi_runtime
{
namespace kernels
{
namespace
{

constexpr char NAME[] = "gaussian_blur7";
constexpr size_t RUN = 16;    ///< columns per work item, as in gaussian_blur.cl
constexpr size_t ROWS = 32;   ///< rows per work item, as there
constexpr size_t LOCAL = 16;  ///< work items per group

BlurGeometry checkedGeometry(const TaskArguments& call)
{
  const auto g = call.value<BlurGeometry>(2);
  requireBetween(NAME, "width", g.width, 1, INT16_MAX);
  requireBetween(NAME, "height", g.height, 1, INT16_MAX);
  requireBetween(NAME, "source_stride", g.source_stride, g.width, INT32_MAX / INT16_MAX);
  requireBetween(NAME, "stride", g.stride, g.width, INT32_MAX / INT16_MAX);
  requireBytes(call, NAME, 0, "source", imageBytes(g.height, g.source_stride, g.width));
  requireBytes(call, NAME, 1, "destination", imageBytes(g.height, g.stride, g.width));
  requireRange(call, NAME, "rows", g.height);
  return g;
}

void runNative(const NativeCall& call)
{
  const BlurGeometry g = checkedGeometry(call);
  gaussianBlur7({call.buffer<const uint8_t>(0), g.width, g.height, static_cast<size_t>(g.source_stride)},
                {call.buffer<uint8_t>(1), g.width, g.height, static_cast<size_t>(g.stride)},
                static_cast<int>(call.begin()), static_cast<int>(call.end()));
}

void runOpenCl(OpenClCommand& command)
{
  const BlurGeometry g = checkedGeometry(command);
  const size_t rows = command.end() - command.begin();
  command.enqueue("gaussian_blur7",
                  NdRange(roundUp((g.width + RUN - 1) / RUN, LOCAL), (rows + ROWS - 1) / ROWS, LOCAL, 1),
                  command.buffer(0), command.buffer(1), g, static_cast<cl_int>(command.begin()),
                  static_cast<cl_int>(command.end()));
}

}  // namespace

CodeletPtr gaussianBlur7Codelet()
{
  static const CodeletPtr instance = []
  {
    Codelet codelet;
    codelet.name = NAME;
    codelet.native = {NativeImplementation{runNative}};
    codelet.opencl = {
        OpenClImplementation{std::string(prelude_cl) + gaussian_blur_cl, "", {"gaussian_blur7"}, runOpenCl}};
    codelet.sliceable = true;
    return makeCodelet(std::move(codelet));
  }();
  return instance;
}

}  // namespace kernels
}  // namespace pi_runtime
