#include <string>

#include "kernels/codelet_arguments.h"
#include "kernel_sources.h"
#include <pi_runtime/kernels/hamming.h>
#include <pi_runtime/opencl_command.h>

namespace pi_runtime
{
namespace kernels
{
namespace
{

constexpr char MATCH[] = "hamming";
constexpr char FILTER[] = "hamming_filter";
constexpr size_t LOCAL = 8;  ///< work items per group

HammingShape checkedShape(const TaskArguments& call)
{
  const auto shape = call.value<HammingShape>(5);
  requireBetween(MATCH, "queries", shape.queries, 0, HAMMING_MOST);
  requireBetween(MATCH, "trains", shape.trains, 0, HAMMING_MOST);
  const auto queries = static_cast<size_t>(shape.queries);
  const auto trains = static_cast<size_t>(shape.trains);
  requireBytes(call, MATCH, 0, "queries", queries * HAMMING_BYTES);
  requireBytes(call, MATCH, 1, "trains", trains * HAMMING_BYTES);
  if (shape.use_window != 0)
  {
    requireBytes(call, MATCH, 2, "positions of the queries", queries * 2 * sizeof(float));
    requireBytes(call, MATCH, 3, "positions of the trains", trains * 2 * sizeof(float));
  }
  requireBytes(call, MATCH, 4, "matches", queries * sizeof(HammingMatch));
  requireRange(call, MATCH, "queries", queries);
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

HammingFilter checkedFilter(const TaskArguments& call)
{
  const auto filter = call.value<HammingFilter>(3);
  requireBetween(FILTER, "queries", filter.queries, 0, HAMMING_MOST);
  requireBetween(FILTER, "trains", filter.trains, 0, HAMMING_MOST);
  requireBetween(FILTER, "ratio_percent", filter.ratio_percent, 0, 1000);
  const auto queries = static_cast<size_t>(filter.queries);
  requireBytes(call, FILTER, 0, "matches of the queries", queries * sizeof(HammingMatch));
  if (filter.mutual != 0)
  {
    requireBytes(call, FILTER, 1, "matches of the trains", static_cast<size_t>(filter.trains) * sizeof(HammingMatch));
  }
  requireBytes(call, FILTER, 2, "accepted matches", queries * sizeof(int32_t));
  requireRange(call, FILTER, "queries", queries);
  return filter;
}

void filterNative(const NativeCall& call)
{
  const HammingFilter filter = checkedFilter(call);
  filterHamming(call.buffer<const HammingMatch>(0), call.buffer<const HammingMatch>(1), filter, call.begin(),
                call.end(), call.buffer<int32_t>(2));
}

void filterOpenCl(OpenClCommand& command)
{
  const HammingFilter filter = checkedFilter(command);
  command.enqueue("filter_matches", NdRange(roundUp(command.end() - command.begin(), LOCAL), LOCAL), command.buffer(0),
                  command.buffer(1), command.buffer(2), filter, static_cast<cl_int>(command.begin()),
                  static_cast<cl_int>(command.end()));
}

}  // namespace

CodeletPtr hammingCodelet()
{
  static const CodeletPtr instance = []
  {
    Codelet codelet;
    codelet.name = MATCH;
    codelet.native = {NativeImplementation{matchNative}};
    codelet.opencl = {
        OpenClImplementation{std::string(prelude_cl) + hamming_cl, "", {"match_all", "match_in_window"}, matchOpenCl}};
    codelet.sliceable = true;
    return makeCodelet(std::move(codelet));
  }();
  return instance;
}

CodeletPtr hammingFilterCodelet()
{
  static const CodeletPtr instance = []
  {
    Codelet codelet;
    codelet.name = FILTER;
    codelet.native = {NativeImplementation{filterNative}};
    codelet.opencl = {OpenClImplementation{std::string(prelude_cl) + hamming_cl, "", {"filter_matches"}, filterOpenCl}};
    codelet.sliceable = true;
    return makeCodelet(std::move(codelet));
  }();
  return instance;
}

}  // namespace kernels
}  // namespace pi_runtime
