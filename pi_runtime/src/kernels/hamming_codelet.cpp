#include <string>

#include <pi_runtime/kernels/hamming.h>
#include "kernels/codelet_arguments.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr char NAME[] = "hamming";
constexpr size_t LOCAL = 8;  ///< work items per group

HammingShape checkedShape(const TaskArguments& call)
{
  const auto shape = call.value<HammingShape>(5);
  requireBetween(NAME, "queries", shape.queries, 0, HAMMING_MOST);
  requireBetween(NAME, "trains", shape.trains, 0, HAMMING_MOST);
  const auto queries = static_cast<size_t>(shape.queries);
  const auto trains = static_cast<size_t>(shape.trains);
  requireBytes(call, NAME, 0, "queries", queries * HAMMING_BYTES);
  requireBytes(call, NAME, 1, "trains", trains * HAMMING_BYTES);
  if (shape.use_window != 0)
  {
    requireBytes(call, NAME, 2, "positions of the queries", queries * 2 * sizeof(float));
    requireBytes(call, NAME, 3, "positions of the trains", trains * 2 * sizeof(float));
  }
  requireBytes(call, NAME, 4, "matches", queries * sizeof(HammingMatch));
  requireRange(call, NAME, "queries", queries);
  return shape;
}

void matchNative(const NativeCall& call)
{
  const HammingShape shape = checkedShape(call);
  matchHamming(call.buffer<const uint8_t>(0), call.buffer<const uint8_t>(1), call.buffer<const float>(2),
               call.buffer<const float>(3), shape, call.begin(), call.end(), call.buffer<HammingMatch>(4));
}

void matchOpenCl(OpenClCommand& command)
{
  const HammingShape shape = checkedShape(command);
  const auto begin = static_cast<cl_int>(command.begin());
  const auto end = static_cast<cl_int>(command.end());
  const NdRange range(roundUp(command.end() - command.begin(), LOCAL), LOCAL);
  if (shape.use_window == 0)
  {
    command.enqueue("match_all", range, command.buffer(0), command.buffer(1), command.buffer(4), shape, begin, end);
    return;
  }
  command.enqueue("match_in_window", range, command.buffer(0), command.buffer(1), command.buffer(2), command.buffer(3),
                  command.buffer(4), shape, begin, end);
}

}  // namespace

CodeletPtr hammingCodelet()
{
  static const CodeletPtr instance =
      makeKernelCodelet(NAME, matchNative, hamming_cl, {"match_all", "match_in_window"}, matchOpenCl);
  return instance;
}

}  // namespace pi_runtime::kernels
