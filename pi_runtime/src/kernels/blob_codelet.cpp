#include <stdexcept>
#include <string>

#include <pi_runtime/kernels/blob.h>
#include "kernels/codelet_arguments.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr char NAME[] = "blob";
constexpr size_t RUN = 16;   ///< columns per work item, as in blob.cl
constexpr size_t LOCAL = 4;  ///< work items per group

BlobGeometry checkedGeometry(const TaskArguments& call)
{
  const auto g = call.value<BlobGeometry>(3);
  if (g.channels != 1 && g.channels != 3)
  {
    throw std::invalid_argument(std::string(NAME) + ": channels = " + std::to_string(g.channels) + ", must be 1 or 3");
  }
  requireBetween(NAME, "source_width", g.source_width, 2, INT16_MAX);
  requireBetween(NAME, "source_height", g.source_height, 1, INT16_MAX);
  requireBetween(NAME, "source_stride", g.source_stride, g.source_width * g.channels, INT32_MAX / INT16_MAX);
  requireBetween(NAME, "width", g.width, 1, INT16_MAX);
  requireBetween(NAME, "height", g.height, 1, INT16_MAX);
  requireBetween(NAME, "letterbox", g.letterbox, BLOB_STRETCHED, BLOB_AT_TOP_LEFT);
  requireBytes(call, NAME, 0, "source", imageBytes(g.source_height, g.source_stride, g.source_width * g.channels));
  requireBytes(call, NAME, 1, "plan", blobPlanBytes(g));
  requireBytes(
      call, NAME, 2, "destination",
      sizeof(float) * static_cast<size_t>(g.channels) * static_cast<size_t>(g.height) * static_cast<size_t>(g.width));
  requireRange(call, NAME, "rows of the destination", g.height);
  return g;
}

BlobColours checkedColours(const TaskArguments& call)
{
  const auto colours = call.value<BlobColours>(4);
  requireBetween(NAME, "fill", colours.fill, 0, 255);
  return colours;
}

void runNative(const NativeCall& call)
{
  makeBlob(call.buffer<const uint8_t>(0), call.buffer<const int32_t>(1), checkedGeometry(call), checkedColours(call),
           static_cast<int>(call.begin()), static_cast<int>(call.end()), call.buffer<float>(2));
}

void runOpenCl(OpenClCommand& command)
{
  const BlobGeometry g = checkedGeometry(command);
  const BlobColours colours = checkedColours(command);
  const BlobContent content = blobContent(g);
  const NdRange range = NdRange(roundUp((g.width + RUN - 1) / RUN, LOCAL), command.end() - command.begin(), LOCAL, 1)
                            .offset(0, command.begin());
  const std::string kernel = "blob_float_" + std::to_string(g.channels);
  command.enqueue(kernel, range, command.buffer(0), command.buffer(1), command.buffer(2), g, colours, content);
}

}  // namespace

CodeletPtr blobCodelet()
{
  static const CodeletPtr instance =
      makeKernelCodelet(NAME, runNative, blob_cl, {"blob_float_1", "blob_float_3"}, runOpenCl);
  return instance;
}

}  // namespace pi_runtime::kernels
