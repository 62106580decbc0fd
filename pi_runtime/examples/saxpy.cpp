// y = a x + y on whichever computing unit does it first: the smallest program with pi_runtime.
#include <cstdio>

#include <pi_runtime/opencl_command.h>
#include <pi_runtime/runtime.h>

using namespace pi_runtime;

int main()
{
  Codelet codelet;
  codelet.name = "saxpy";
  codelet.sliceable = true;
  codelet.slice_granularity = 64;
  codelet.native = {{[](const NativeCall& call)
                     {
                       const float* const x = call.buffer<float>(0);
                       float* const y = call.buffer<float>(1);
                       for (uint64_t i = call.begin(); i < call.end(); ++i)
                       {
                         y[i] += call.value<float>(2) * x[i];
                       }
                     }}};
  codelet.opencl = {
      singleKernel("kernel void saxpy(global const float* x, global float* y, float a)"
                   "{ const size_t i = get_global_id(0); y[i] += a * x[i]; }",
                   "saxpy", 64)};

  constexpr uint64_t COUNT = 1 << 20;
  const BufferPtr x = Buffer::allocate(COUNT * sizeof(float));
  const BufferPtr y = Buffer::allocate(COUNT * sizeof(float));
  x->hostAs<float>(Access::WRITE)[5] = 3.0f;

  Runtime runtime;
  TaskRequest task;
  task.codelet = makeCodelet(codelet);
  task.arguments = {Argument::in(x), Argument::inOut(y), Argument::value(2.0f)};
  task.range = COUNT;
  const TaskHandle handle = runtime.submit(task);
  const TaskResult& result = handle.wait();  // of the handle
  std::printf("%s on %s by %s: y[5] = %g\n", toString(result.outcome), result.unit.c_str(), result.executor.c_str(),
              static_cast<double>(y->hostAs<float>(Access::READ)[5]));
  return result.ok() ? 0 : 1;
}
