#include <stdexcept>
#include <string>

#include "kernels/codelet_arguments.h"
#include "kernels/image_bytes.h"
#include "kernel_sources.h"
#include "kernels/rectify.h"
#include <pi_runtime/opencl_command.h>

namespace pi_runtime
{
namespace kernels
{
namespace
{

constexpr char NAME[] = "remap";
constexpr int RUN = 16;    ///< pixels per work item, as in rectify.cl
constexpr int LOCAL = 16;  ///< work items per group

RemapGeometry checkedGeometry(const TaskArguments& call)
{
  const auto geometry = call.value<RemapGeometry>(4);
  if (geometry.channels != 1 && geometry.channels != 3)
  {
    throw std::invalid_argument(std::string(NAME) + ": channels = " + std::to_string(geometry.channels) +
                                ", must be 1 or 3");
  }
  requireBetween(NAME, "source_width", geometry.source_width, 1, INT16_MAX);
  requireBetween(NAME, "source_height", geometry.source_height, 1, INT16_MAX);
  requireBetween(NAME, "width", geometry.width, 1, INT16_MAX);
  requireBetween(NAME, "height", geometry.height, 1, INT16_MAX);
  requireBetween(NAME, "source_stride", geometry.source_stride, geometry.source_width * geometry.channels,
                 INT32_MAX / INT16_MAX);
  requireBetween(NAME, "stride", geometry.stride, geometry.width * geometry.channels, INT32_MAX / INT16_MAX);
  const uint64_t pixels = static_cast<uint64_t>(geometry.width) * geometry.height;
  requireBytes(call, NAME, 0, "source",
               imageBytes(geometry.source_height, geometry.source_stride, geometry.source_width * geometry.channels));
  requireBytes(call, NAME, 1, "xy", pixels * 2 * sizeof(int16_t));
  requireBytes(call, NAME, 2, "fraction", pixels * sizeof(uint16_t));
  requireBytes(call, NAME, 3, "destination",
               imageBytes(geometry.height, geometry.stride, geometry.width * geometry.channels));
  requireRange(call, NAME, "rows of the destination", geometry.height);
  return geometry;
}

void runNative(const NativeCall& call)
{
  const RemapGeometry g = checkedGeometry(call);
  const ImageView<const uint8_t> source{call.buffer<const uint8_t>(0), g.source_width, g.source_height,
                                        static_cast<size_t>(g.source_stride), g.channels};
  const ImageView<uint8_t> destination{call.buffer<uint8_t>(3), g.width, g.height, static_cast<size_t>(g.stride),
                                       g.channels};
  remap(source, call.buffer<const int16_t>(1), call.buffer<const uint16_t>(2), destination,
        static_cast<int>(call.begin()), static_cast<int>(call.end()));
}

void runOpenCl(OpenClCommand& command)
{
  const RemapGeometry g = checkedGeometry(command);
  const size_t runs = (static_cast<size_t>(g.width) + RUN - 1) / RUN;
  const size_t padded = roundUp(runs, LOCAL);
  command.enqueueAll(g.channels == 1 ? "remap_1" : "remap_3",
                     NdRange(padded, command.end() - command.begin(), LOCAL, 1).offset(0, command.begin()));
}

}  // namespace

CodeletPtr remapCodelet()
{
  static const CodeletPtr instance = []
  {
    Codelet codelet;
    codelet.name = NAME;
    codelet.native = {NativeImplementation{runNative}};
    codelet.opencl = {
        OpenClImplementation{std::string(prelude_cl) + rectify_cl, "", {"remap_1", "remap_3"}, runOpenCl}};
    codelet.sliceable = true;
    return makeCodelet(std::move(codelet));
  }();
  return instance;
}

}  // namespace kernels
}  // namespace pi_runtime
