#include <pi_runtime/kernels/pyramid.h>
#include "kernels/codelet_arguments.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr size_t ROWS_PER_ITEM = 8;  ///< of pyramid_down: shares the horizontal sums between rows
constexpr size_t ITEM_WIDTH = 16;    ///< of pyramid_down [px]
constexpr size_t LOCAL_X = 4;
constexpr size_t LOCAL_Y = 1;
constexpr size_t COPY_WIDTH = 64;  ///< of pyramid_copy, per item [px]

struct Down
{
  cl_mem source;
  uint64_t source_offset;
  int32_t source_stride;
  int32_t width;
  int32_t height;
  cl_mem destination;
  uint64_t destination_offset;
  int32_t destination_stride;
};

PyramidShape checkedShape(const TaskArguments& arguments, const char* codelet)
{
  const auto shape = arguments.value<PyramidShape>(2);
  requireBetween(codelet, "width", shape.width, 1, 32768);
  requireBetween(codelet, "height", shape.height, 1, 32768);
  requireBetween(codelet, "source_stride", shape.source_stride, shape.width, 1 << 20);
  requireBytes(arguments, codelet, 0, "source", imageBytes(shape.height, shape.source_stride, shape.width));
  return shape;
}

PyramidShape checkedDown(const TaskArguments& arguments)
{
  const PyramidShape shape = checkedShape(arguments, "pyramid_down");
  const int32_t width = (shape.width + 1) / 2;
  const int32_t height = (shape.height + 1) / 2;
  requireBetween("pyramid_down", "destination_stride", shape.destination_stride, width, 1 << 20);
  requireBytes(arguments, "pyramid_down", 1, "destination", imageBytes(height, shape.destination_stride, width));
  requireRange(arguments, "pyramid_down", "rows of the destination", static_cast<size_t>(height));
  return shape;
}

PyramidLayout checkedLayout(const TaskArguments& arguments, const PyramidShape& shape)
{
  const PyramidLayout layout(shape.width, shape.height, shape.levels);
  requireBytes(arguments, "image_pyramid", 1, "pyramid", layout.bytes);
  requireRange(arguments, "image_pyramid", "not sliceable", 1);
  return layout;
}

void enqueueDown(OpenClCommand& command, const Down& down, size_t begin, size_t end)
{
  const size_t width = static_cast<size_t>(down.width + 1) / 2;
  const bool narrow = width <= ITEM_WIDTH;
  const NdRange range = narrow
                            ? NdRange(width, end - begin, 1, 1)
                            : NdRange(roundUp(width, ITEM_WIDTH * LOCAL_X) / ITEM_WIDTH,
                                      roundUp(end - begin, ROWS_PER_ITEM * LOCAL_Y) / ROWS_PER_ITEM, LOCAL_X, LOCAL_Y);
  command.enqueue(narrow ? "pyramid_down_narrow" : "pyramid_down", range, down.source, down.source_offset,
                  down.source_stride, down.width, down.height, down.destination, down.destination_offset,
                  down.destination_stride, static_cast<int32_t>(begin), static_cast<int32_t>(end));
}

void downNative(const NativeCall& call)
{
  const PyramidShape shape = checkedDown(call);
  const ImageView<const uint8_t> source{call.buffer<const uint8_t>(0), shape.width, shape.height,
                                        static_cast<size_t>(shape.source_stride)};
  const ImageView<uint8_t> destination{call.buffer<uint8_t>(1), (shape.width + 1) / 2, (shape.height + 1) / 2,
                                       static_cast<size_t>(shape.destination_stride)};
  pyramidDown(source, destination, static_cast<int>(call.begin()), static_cast<int>(call.end()));
}

void downOpenCl(OpenClCommand& command)
{
  const PyramidShape shape = checkedDown(command);
  enqueueDown(command,
              Down{command.buffer(0), 0, shape.source_stride, shape.width, shape.height, command.buffer(1), 0,
                   shape.destination_stride},
              command.begin(), command.end());
}

void pyramidNative(const NativeCall& call)
{
  const PyramidShape shape = checkedShape(call, "image_pyramid");
  const PyramidLayout layout = checkedLayout(call, shape);
  buildPyramid(ImageView<const uint8_t>{call.buffer<const uint8_t>(0), shape.width, shape.height,
                                        static_cast<size_t>(shape.source_stride)},
               layout, call.buffer<uint8_t>(1));
}

void pyramidOpenCl(OpenClCommand& command)
{
  const PyramidShape shape = checkedShape(command, "image_pyramid");
  const PyramidLayout layout = checkedLayout(command, shape);
  const cl_mem pyramid = command.buffer(1);
  const PyramidLevel& full = layout.level[0];
  command.enqueue("pyramid_copy", NdRange(full.stride / COPY_WIDTH, static_cast<size_t>(full.height), 1, 1),
                  command.buffer(0), shape.source_stride, shape.width, pyramid, static_cast<int32_t>(full.stride));
  for (int i = 1; i < layout.levels; ++i)
  {
    const PyramidLevel& from = layout.level[i - 1];
    const PyramidLevel& to = layout.level[i];
    enqueueDown(command,
                Down{pyramid, from.offset, static_cast<int32_t>(from.stride), from.width, from.height, pyramid,
                     to.offset, static_cast<int32_t>(to.stride)},
                0, static_cast<size_t>(to.height));
  }
}

std::string openClOptions()
{
  return "-DROWS=" + std::to_string(ROWS_PER_ITEM);
}

}  // namespace

CodeletPtr pyramidDownCodelet()
{
  static const CodeletPtr instance =
      makeKernelCodelet("pyramid_down", downNative, pyramid_cl, {"pyramid_down", "pyramid_down_narrow"}, downOpenCl,
                        ROWS_PER_ITEM, openClOptions());
  return instance;
}

CodeletPtr imagePyramidCodelet()
{
  static const CodeletPtr instance = makeKernelCodelet("image_pyramid", pyramidNative, pyramid_cl,
                                                       {"pyramid_copy", "pyramid_down", "pyramid_down_narrow"},
                                                       pyramidOpenCl, NOT_SLICEABLE, openClOptions());
  return instance;
}

}  // namespace pi_runtime::kernels
