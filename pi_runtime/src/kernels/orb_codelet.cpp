#include <string>

#include "kernels/codelet_arguments.h"
#include "kernels/image_bytes.h"
#include "kernel_sources.h"
#include <pi_runtime/kernels/orb.h>
#include <pi_runtime/opencl_command.h>

namespace pi_runtime
{
namespace kernels
{
namespace
{

constexpr char NAME[] = "orb";
constexpr size_t LOCAL = 8;            ///< work items per group
constexpr size_t ITEMS_PER_POINT = 4;  ///< in the description, as in orb.cl

OrbShape checkedShape(const TaskArguments& call)
{
  const auto shape = call.value<OrbShape>(6);
  requireBetween(NAME, "width", shape.width, 1, INT16_MAX);
  requireBetween(NAME, "height", shape.height, 1, INT16_MAX);
  requireBetween(NAME, "image_stride", shape.image_stride, shape.width, INT32_MAX / INT16_MAX);
  requireBetween(NAME, "smoothed_stride", shape.smoothed_stride, shape.width, INT32_MAX / INT16_MAX);
  requireBetween(NAME, "points", shape.points, 0, 1 << 24);
  const auto points = static_cast<size_t>(shape.points);
  requireBytes(call, NAME, 0, "image", imageBytes(shape.height, shape.image_stride, shape.width));
  requireBytes(call, NAME, 1, "smoothed image", imageBytes(shape.height, shape.smoothed_stride, shape.width));
  requireBytes(call, NAME, 2, "points", points * 2 * sizeof(float));
  requireBytes(call, NAME, 3, "tables", sizeof(OrbTables));
  requireBytes(call, NAME, 4, "descriptors", points * ORB_BYTES);
  requireBytes(call, NAME, 5, "angles", points * sizeof(uint16_t));
  requireRange(call, NAME, "points", points);
  return shape;
}

void runNative(const NativeCall& call)
{
  const OrbShape shape = checkedShape(call);
  describeOrb({call.buffer<const uint8_t>(0), shape.width, shape.height, static_cast<size_t>(shape.image_stride)},
              {call.buffer<const uint8_t>(1), shape.width, shape.height, static_cast<size_t>(shape.smoothed_stride)},
              call.buffer<const float>(2), *call.buffer<const OrbTables>(3), call.begin(), call.end(),
              call.buffer<uint8_t>(4), call.buffer<uint16_t>(5));
}

void runOpenCl(OpenClCommand& command)
{
  const OrbShape shape = checkedShape(command);
  const auto begin = static_cast<cl_int>(command.begin());
  const auto end = static_cast<cl_int>(command.end());
  const size_t points = command.end() - command.begin();
  command.enqueue("orb_angles", NdRange(roundUp(points, LOCAL), LOCAL), command.buffer(0), command.buffer(2),
                  command.buffer(3), command.buffer(5), shape, begin, end);
  command.enqueue("orb_descriptors", NdRange(roundUp(points * ITEMS_PER_POINT, LOCAL), LOCAL), command.buffer(1),
                  command.buffer(2), command.buffer(3), command.buffer(4), command.buffer(5), shape, begin, end);
}

}  // namespace

CodeletPtr orbCodelet()
{
  static const CodeletPtr instance = []
  {
    Codelet codelet;
    codelet.name = NAME;
    codelet.native = {NativeImplementation{runNative}};
    codelet.opencl = {
        OpenClImplementation{std::string(prelude_cl) + orb_cl, "", {"orb_angles", "orb_descriptors"}, runOpenCl}};
    codelet.sliceable = true;
    return makeCodelet(std::move(codelet));
  }();
  return instance;
}

}  // namespace kernels
}  // namespace pi_runtime
