#include "mean_filter.h"

#include <pi_runtime/opencl_command.h>

#include <algorithm>

using namespace pi_runtime;

namespace
{

const char* const SOURCE = R"(
  kernel void mean_filter(global const float* samples, global float* means)
  {
    const size_t i = get_global_id(0), last = get_global_size(0) - 1;
    const size_t before = i == 0 ? 0 : i - 1, after = min(i + 1, last);
    means[i] = (samples[before] + samples[i] + samples[after]) / 3.0f;
  })";

void filterNatively(const NativeCall& call)
{
  const float* const samples = call.buffer<float>(0);
  float* const means = call.buffer<float>(1);
  for (uint64_t i = call.begin(); i < call.end(); ++i)
  {
    const uint64_t before = i == 0 ? 0 : i - 1;
    const uint64_t after = std::min(i + 1, call.range() - 1);
    means[i] = (samples[before] + samples[i] + samples[after]) / 3.0F;
  }
}

}  // namespace

CodeletPtr meanFilter()
{
  static const CodeletPtr instance = []
  {
    Codelet codelet;
    codelet.name = "mean_filter";
    codelet.native = {{filterNatively}};
    codelet.opencl = {singleKernel(SOURCE, "mean_filter", 64)};
    return makeCodelet(codelet);
  }();
  return instance;
}

TaskRequest meanFilterTask(const BufferPtr& samples, const BufferPtr& means, uint64_t count)
{
  TaskRequest task;
  task.codelet = meanFilter();
  task.arguments = {Argument::in(samples), Argument::out(means)};
  task.range = count;
  return task;
}
