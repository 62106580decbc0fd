#include <pi_runtime/kernels/lucas_kanade.h>
#include "kernels/codelet_arguments.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr char NAME[] = "track_points";

TrackOptions checkedOptions(const TaskArguments& arguments)
{
  const auto options = arguments.value<TrackOptions>(6);
  options.validate();
  const size_t pyramid = PyramidLayout(options.width, options.height, options.levels).bytes;
  const size_t points = arguments.range();
  requireBytes(arguments, NAME, 0, "previous pyramid", pyramid);
  requireBytes(arguments, NAME, 1, "next pyramid", pyramid);
  requireBytes(arguments, NAME, 2, "previous points", points * sizeof(Point2f));
  requireBytes(arguments, NAME, 3, "next points", points * sizeof(Point2f));
  requireBytes(arguments, NAME, 4, "status", points);
  requireBytes(arguments, NAME, 5, "residual", points * sizeof(float));
  return options;
}

void runNative(const NativeCall& call)
{
  const TrackOptions options = checkedOptions(call);
  trackPoints(call.buffer<const uint8_t>(0), call.buffer<const uint8_t>(1), options, call.buffer<const Point2f>(2),
              call.buffer<Point2f>(3), call.buffer<uint8_t>(4), call.buffer<float>(5), call.begin(), call.end());
}

void runOpenCl(OpenClCommand& command)
{
  const TrackOptions options = checkedOptions(command);
  command.enqueue("track_points", NdRange(command.end() - command.begin(), 1).offset(command.begin()),
                  command.buffer(0), command.buffer(1), command.buffer(2), command.buffer(3), command.buffer(4),
                  command.buffer(5), options);
}

}  // namespace

CodeletPtr trackPointsCodelet()
{
  static const CodeletPtr instance = makeKernelCodelet(NAME, runNative, lucas_kanade_cl, {"track_points"}, runOpenCl);
  return instance;
}

}  // namespace pi_runtime::kernels
