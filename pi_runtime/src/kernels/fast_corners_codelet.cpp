#include <algorithm>

#include <pi_runtime/kernels/fast_corners.h>
#include "kernels/codelet_arguments.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr char NAME[] = "fast_corners";
constexpr size_t BLOCK = 32;      ///< pixels per item, as in fast_corners.cl
constexpr size_t MAP_LEFT = 16;   ///< as in fast_corners.cl
constexpr int RADIUS = 3;         ///< of the circle: no corners nearer to the border [px]
constexpr size_t ROW_ITEMS = 64;  ///< items of the one group of fast_offsets
constexpr size_t LOCAL = 4;       ///< items per group of the others
constexpr size_t LOCAL_ROWS = 4;  ///< and rows per group

/// Where the parts of the working memory lie.
struct WorkLayout
{
  WorkLayout(int image_width, int image_height)
    : width(image_width - 2 * RADIUS)
    , height(image_height - 2 * RADIUS)
    , blocks(roundUp(static_cast<size_t>(std::max(width, 0)), BLOCK) / BLOCK)
    , map_stride(MAP_LEFT + (blocks + 1) * BLOCK)
    , masks(roundUp(map_stride * static_cast<size_t>(std::max(height, 0) + 2), 128))
    , offsets(roundUp(masks + blocks * sizeof(uint32_t) * static_cast<size_t>(std::max(height, 0)), 128))
    , bytes(offsets + sizeof(uint32_t) * static_cast<size_t>(std::max(height, 0)))
  {
  }
  bool empty() const { return width < 1 || height < 1; }

  int width;   ///< pixels that can be corners
  int height;  ///< rows of them
  size_t blocks;
  size_t map_stride;
  uint64_t masks;    ///< [B] from the start
  uint64_t offsets;  ///< [B] from the start
  size_t bytes;
};

FastCornersShape checkedShape(const TaskArguments& arguments)
{
  const auto shape = arguments.value<FastCornersShape>(4);
  requireBetween(NAME, "width", shape.width, 1, 32768);
  requireBetween(NAME, "height", shape.height, 1, 32768);
  requireBetween(NAME, "stride", shape.stride, shape.width, 1 << 20);
  requireBetween(NAME, "threshold", shape.threshold, 0, 254);
  requireBetween(NAME, "capacity", shape.capacity, 1, INT32_MAX);
  requireBytes(arguments, NAME, 0, "image", imageBytes(shape.height, shape.stride, shape.width));
  requireBytes(arguments, NAME, 1, "corners", static_cast<size_t>(shape.capacity) * sizeof(Corner));
  requireBytes(arguments, NAME, 2, "count", sizeof(uint32_t));
  requireBytes(arguments, NAME, 3, "working memory", fastCornersWorkBytes(shape.width, shape.height));
  requireRange(arguments, NAME, "not sliceable", 1);
  return shape;
}

void runNative(const NativeCall& call)
{
  const FastCornersShape shape = checkedShape(call);
  const ImageView<const uint8_t> image{call.buffer<const uint8_t>(0), shape.width, shape.height,
                                       static_cast<size_t>(shape.stride)};
  *call.buffer<uint32_t>(2) = static_cast<uint32_t>(
      findFastCorners(image, shape.threshold, call.buffer<Corner>(1), static_cast<size_t>(shape.capacity)));
}

void runOpenCl(OpenClCommand& command)
{
  const FastCornersShape shape = checkedShape(command);
  const WorkLayout work(shape.width, shape.height);
  if (work.empty())
  {
    command.enqueue("fast_none", NdRange(1, 1), command.buffer(2));
    return;
  }
  const cl_mem map = command.buffer(3);
  const auto map_stride = static_cast<int32_t>(work.map_stride);
  const auto blocks = static_cast<int32_t>(work.blocks);
  const auto rows = static_cast<size_t>(work.height);
  const bool narrow = work.width < static_cast<int>(BLOCK);
  command.enqueue(narrow ? "fast_score_narrow" : "fast_score",
                  narrow ? NdRange(1, rows + 2, 1, 1)
                         : NdRange(roundUp(work.blocks + 1, LOCAL), roundUp(rows + 2, LOCAL_ROWS), LOCAL, LOCAL_ROWS),
                  command.buffer(0), shape.stride, work.width, work.height, shape.threshold, map, map_stride);
  command.enqueue("fast_maxima", NdRange(roundUp(work.blocks, LOCAL), roundUp(rows, LOCAL_ROWS), LOCAL, LOCAL_ROWS),
                  map, map_stride, blocks, work.height, work.masks);
  command.enqueue("fast_offsets", NdRange(ROW_ITEMS, ROW_ITEMS), map, blocks, work.height, work.masks, work.offsets,
                  command.buffer(2));
  command.enqueue("fast_list", NdRange(roundUp(rows, LOCAL), LOCAL), map, map_stride, blocks, work.height, work.masks,
                  work.offsets, command.buffer(1), shape.capacity);
}

}  // namespace

size_t fastCornersWorkBytes(int width, int height)
{
  const WorkLayout work(width, height);
  return work.empty() ? 0 : work.bytes;
}

CodeletPtr fastCornersCodelet()
{
  static const CodeletPtr instance =
      makeKernelCodelet(NAME, runNative, fast_corners_cl,
                        {"fast_score", "fast_score_narrow", "fast_maxima", "fast_offsets", "fast_list", "fast_none"},
                        runOpenCl, NOT_SLICEABLE, "-DROW_ITEMS=" + std::to_string(ROW_ITEMS));
  return instance;
}

}  // namespace pi_runtime::kernels
