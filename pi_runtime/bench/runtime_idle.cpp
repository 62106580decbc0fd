// Part `idle` of bench_runtime: what a Runtime costs that has nothing to do, in CPU time and memory.
#include <malloc.h>

#include <algorithm>
#include <condition_variable>
#include <cstdio>
#include <mutex>
#include <stdexcept>
#include <thread>

#include "units/native_executor.h"
#include <pi_runtime/opencl_command.h>
#include <pi_runtime/runtime.h>
#include "runtime_bench.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::Argument;
using pi_runtime::Buffer;
using pi_runtime::Codelet;
using pi_runtime::Runtime;
using pi_runtime::RuntimeOptions;
using pi_runtime::TaskHandle;
using pi_runtime::TaskRequest;

constexpr double CHILD_LIMIT_S = 60.0;
constexpr size_t EXTRA_UNITS = 16;
constexpr size_t QUEUED_TASKS = 10000;

pi_runtime::CustomUnit nativeUnit(size_t index)
{
  pi_runtime::CustomUnit unit;
  unit.name = "extra" + std::to_string(index);
  unit.executors.push_back(std::make_unique<pi_runtime::NativeExecutor>(unit.type));
  return unit;
}

TaskRequest emptyTask(bool opencl)
{
  Codelet codelet;
  TaskRequest request;
  if (opencl)
  {
    codelet.name = "empty_opencl";
    codelet.opencl = {
        pi_runtime::singleKernel("kernel void nothing(global int* a) { if (a == 0) a[0] = 1; }", "nothing", 1)};
    request.arguments = {Argument::inOut(Buffer::allocate(4096))};
  }
  else
  {
    codelet.name = "empty_native";
    codelet.native = {{[](const pi_runtime::NativeCall&) {}, pi_runtime::ANY_UNIT_TYPE}};
  }
  request.codelet = makeCodelet(codelet);
  return request;
}

void runEverywhere(Runtime* runtime, bool opencl)
{
  for (const pi_runtime::TaskResult& result : runtime->calibrate(emptyTask(opencl), 3))
  {
    if (!result.ok())
    {
      throw std::runtime_error("an empty task failed: " + result.message);
    }
  }
}

double heapBytes()
{
  const struct mallinfo2 info = mallinfo2();
  return static_cast<double>(info.uordblks) + static_cast<double>(info.hblkhd);
}

/// Heap of a native task that waits in a queue, its handle included [B].
double queuedTaskBytes(Runtime* runtime)
{
  std::mutex mutex;
  std::condition_variable changed;
  bool open = false;
  Codelet gate;
  gate.name = "gate";
  gate.native = {{[&](const pi_runtime::NativeCall&)
                  {
                    std::unique_lock<std::mutex> lock(mutex);
                    changed.wait(lock, [&] { return open; });
                  }}};
  TaskRequest blocker;
  blocker.codelet = makeCodelet(gate);
  blocker.unit = "cpu0";
  TaskHandle blocked = runtime->submit(blocker);
  TaskRequest request = emptyTask(false);
  request.unit = "cpu0";
  std::vector<TaskHandle> handles(QUEUED_TASKS);
  const double before = heapBytes();
  for (TaskHandle& handle : handles)
  {
    handle = runtime->submit(request);
  }
  const double bytes = (heapBytes() - before) / QUEUED_TASKS + sizeof(TaskHandle);
  {
    std::lock_guard<std::mutex> lock(mutex);
    open = true;
  }
  changed.notify_all();
  blocked.wait();
  handles.back().wait();
  for (const TaskHandle& handle : handles)
  {
    handle.wait();
  }
  return bytes;
}

/// Private memory of one more native unit, its thread included [kB].
double extraUnitKilobytes(RuntimeOptions options)
{
  options.native = false;
  std::vector<std::unique_ptr<Runtime>> runtimes;
  std::vector<double> added_kb;
  for (const size_t count : {size_t{1}, 1 + EXTRA_UNITS})
  {
    std::vector<pi_runtime::CustomUnit> units;
    for (size_t index = 0; index < count; ++index)
    {
      units.push_back(nativeUnit(index));
    }
    const Memory before = processMemory();
    runtimes.push_back(std::make_unique<Runtime>(options, std::move(units)));
    runEverywhere(runtimes.back().get(), false);
    added_kb.push_back(processMemory().private_kb - before.private_kb);
  }
  return (added_kb[1] - added_kb[0]) / EXTRA_UNITS;
}

void printMemoryOf(const std::string& name, const Memory& before)
{
  const Memory now = processMemory();
  std::printf("%s_rss_kb %.0f\n%s_private_kb %.0f\n", name.c_str(), now.rss_kb - before.rss_kb, name.c_str(),
              now.private_kb - before.private_kb);
}

struct IdleFigures
{
  std::map<std::string, std::vector<double>> values;

  void add(const std::string& prefix, const Lines& lines)
  {
    for (const std::vector<std::string>& words : lines)
    {
      values[prefix + words.front()].push_back(std::stod(words.at(1)));
    }
  }
  void print(const char* title, const std::string& name, double scale, const char* format) const
  {
    const auto found = values.find(name);
    if (found == values.end())
    {
      return;
    }
    std::vector<double> scaled = found->second;
    std::transform(scaled.begin(), scaled.end(), scaled.begin(), [scale](double value) { return value * scale; });
    std::printf("%-62s %28s\n", title, spread(scaled, format).c_str());
  }
};

}  // namespace

void childIdle(const std::vector<std::string>& words)
{
  const bool opencl = words.at(1) == "opencl";
  const double seconds = std::stod(words.at(2));
  const Memory before = processMemory();
  RuntimeOptions options = benchOptions();
  options.opencl_cpu = opencl;
  options.cache_folder = words.at(3);
  auto runtime = std::make_unique<Runtime>(options);
  printMemoryOf("start", before);
  runEverywhere(runtime.get(), opencl);
  printMemoryOf("used", before);
  const double cpu_before_s = processCpu();
  const auto start = Clock::now();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  std::printf("cpu %.5f\n", 100.0 * (processCpu() - cpu_before_s) / secondsSince(start));
  if (opencl)
  {
    return;
  }
  std::printf("unit_private_kb %.2f\n", extraUnitKilobytes(options));
  std::printf("task_bytes %.1f\n", queuedTaskBytes(runtime.get()));
}

void benchIdle(Settings* settings)
{
  const double seconds = std::max(1.0, settings->seconds / 10.0 / settings->rounds);
  IdleFigures figures;
  for (int round = 0; round < settings->rounds; ++round)
  {
    const std::string cache = settings->scratch + "/idle" + std::to_string(round);
    const std::string text = std::to_string(seconds);
    const std::string programs = cache + "/programs";
    figures.add("native_", runChild({"idle", "native", text, programs}, seconds + CHILD_LIMIT_S));
    for (const char* const name : {"cold_", "warm_"})  // the first fills the caches of PoCL and of the runtime
    {
      figures.add(name, runChild({"idle", "opencl", text, programs}, seconds + CHILD_LIMIT_S,
                                 {{"POCL_CACHE_DIR", cache + "/pocl"}}));
    }
    if (starpuAvailable())
    {
      for (const int workers : {1, 2})
      {
        figures.add(
            "starpu" + std::to_string(workers) + "_",
            runChild({"starpu", "idle", text}, seconds + CHILD_LIMIT_S, starpuEnvironment(*settings, "dmda", workers)));
      }
    }
  }
  std::printf("\nIdle: %d processes of each kind, %.1f s each, after a few tasks\n", settings->rounds, seconds);
  figures.print("CPU of an idle Runtime, native [% of a core]", "native_cpu", 1.0, "%.3f");
  figures.print("CPU of an idle Runtime, native and OpenCL [%]", "warm_cpu", 1.0, "%.3f");
  figures.print("CPU of an idle StarPU, 1 worker [%]", "starpu1_cpu", 1.0, "%.1f");
  figures.print("CPU of an idle StarPU, 2 workers [%]", "starpu2_cpu", 1.0, "%.1f");
  std::printf("Memory that a Runtime adds to a process that has the library linked [MB]\n");
  for (const auto& [name, title] : {std::pair<const char*, const char*>("native", "native units only"),
                                    {"cold", "OpenCL, compiled now (LLVM runs)"},
                                    {"warm", "OpenCL, programs and kernels from the caches"}})
  {
    for (const auto& [when, moment] :
         {std::pair<const char*, const char*>("start", "started"), {"used", "after tasks"}})
    {
      const std::string base = std::string(name) + "_" + when;
      figures.print((std::string(title) + ", " + moment + ": private").c_str(), base + "_private_kb", 1e-3, "%.2f");
      figures.print((std::string(title) + ", " + moment + ": resident").c_str(), base + "_rss_kb", 1e-3, "%.2f");
    }
  }
  figures.print("StarPU, 2 workers: private", "starpu2_private_kb", 1e-3, "%.2f");
  figures.print("one more native unit: private [kB]", "native_unit_private_kb", 1.0, "%.1f");
  figures.print("one task in a queue: heap [B]", "native_task_bytes", 1.0, "%.0f");
  printBar(settings, "CPU of an idle Runtime with OpenCL", median(figures.values.at("warm_cpu")), 0.5, " %", false);
}

}  // namespace pi_runtime_bench
