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
  const auto shape = call.value<HammingShape>(3);
  requireBetween(NAME, "queries", shape.queries, 0, HAMMING_MOST);
  requireBetween(NAME, "trains", shape.trains, 0, HAMMING_MOST);
  const auto queries = static_cast<size_t>(shape.queries);
  const auto trains = static_cast<size_t>(shape.trains);
  requireBytes(call, NAME, 0, "queries", queries * HAMMING_BYTES);
  requireBytes(call, NAME, 1, "trains", trains * HAMMING_BYTES);
  requireBytes(call, NAME, 2, "matches", queries * sizeof(HammingMatch));
  requireRange(call, NAME, "queries", queries);
  return shape;
}

void matchNative(const NativeCall& call)
{
  const HammingShape shape = checkedShape(call);
  matchHamming(call.buffer<const uint8_t>(0), call.buffer<const uint8_t>(1), shape, call.begin(), call.end(),
               call.buffer<HammingMatch>(2));
}

void matchOpenCl(OpenClCommand& command)
{
  const HammingShape shape = checkedShape(command);
  const NdRange range(roundUp(command.end() - command.begin(), LOCAL), LOCAL);
  command.enqueue("match_all", range, command.buffer(0), command.buffer(1), command.buffer(2), shape,
                  static_cast<cl_int>(command.begin()), static_cast<cl_int>(command.end()));
}

}  // namespace

CodeletPtr hammingCodelet()
{
  static const CodeletPtr instance = makeKernelCodelet(NAME, matchNative, hamming_cl, {"match_all"}, matchOpenCl);
  return instance;
}

}  // namespace pi_runtime::kernels
