// Part `latency` of bench_runtime: what a task costs that does nothing.
#include <condition_variable>
#include <cstdio>
#include <mutex>
#include <stdexcept>
#include <thread>

#include <pi_runtime/opencl_command.h>
#include <pi_runtime/runtime.h>
#include "runtime_bench.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::Argument;
using pi_runtime::Buffer;
using pi_runtime::BufferPtr;
using pi_runtime::Codelet;
using pi_runtime::CodeletPtr;
using pi_runtime::Runtime;
using pi_runtime::TaskHandle;
using pi_runtime::TaskRequest;

constexpr size_t WAITS = 3000;   ///< of each kind and round
constexpr size_t TASKS = 10000;  ///< of each throughput figure and round
constexpr size_t UNMEASURED = 200;
constexpr double STARPU_LIMIT_S = 60.0;
constexpr char EMPTY_SOURCE[] = "kernel void nothing(global int* a) { if (get_global_id(0) == 1000000) a[0] = 1; }";

/// Two threads that wake each other by a condition variable each: the floor of any runtime with threads of its own.
class PingPong
{
public:
  PingPong() : partner_([this] { answer(); }) {}
  ~PingPong()
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    there_.notify_one();
    partner_.join();
  }

  void roundTrip()
  {
    std::unique_lock<std::mutex> lock(mutex_);
    asked_ = true;
    there_.notify_one();
    back_.wait(lock, [this] { return !asked_; });
  }

private:
  void answer()
  {
    std::unique_lock<std::mutex> lock(mutex_);
    for (;;)
    {
      there_.wait(lock, [this] { return asked_ || stop_; });
      if (stop_)
      {
        return;
      }
      asked_ = false;
      back_.notify_one();
    }
  }

  std::mutex mutex_;
  std::condition_variable there_;
  std::condition_variable back_;
  bool asked_ = false;
  bool stop_ = false;
  std::thread partner_;
};

/// An empty kernel by hand, on the first core as the first unit of a Runtime.
class PlainOpenCl
{
public:
  explicit PlainOpenCl(const pi_runtime::OpenClImplementation& implementation)
    : context_(firstCpu(), subDevices(firstCpu()), pi_runtime::MemoryModel::DIRECT)
    , program_(context_, 0, implementation, "")
    , queue_(context_.makeQueue(0))
    , kernel_(program_.kernel("nothing"))
    , buffer_(Buffer::allocate(4096))
  {
    cl_int code = CL_SUCCESS;
    memory_ = pi_runtime::ClMem(clCreateBuffer(context_.get(), CL_MEM_READ_WRITE | CL_MEM_USE_HOST_PTR,
                                               buffer_->bytes(), buffer_->address(), &code));
    pi_runtime::checkOpenCl(code, "clCreateBuffer");
  }

  void launchAndWait()
  {
    cl_event event = nullptr;
    launch(&event);
    pi_runtime::checkOpenCl(clWaitForEvents(1, &event), "clWaitForEvents");
    clReleaseEvent(event);
  }
  void launchMany(size_t count)
  {
    for (size_t i = 0; i < count; ++i)
    {
      launch(nullptr);
    }
    pi_runtime::checkOpenCl(clFinish(queue_.get()), "clFinish");
  }

private:
  void launch(cl_event* event)
  {
    const size_t one = 1;
    const cl_mem memory = memory_.get();
    pi_runtime::checkOpenCl(clSetKernelArg(kernel_, 0, sizeof memory, &memory), "clSetKernelArg");
    pi_runtime::checkOpenCl(clEnqueueNDRangeKernel(queue_.get(), kernel_, 1, nullptr, &one, &one, 0, nullptr, event),
                            "clEnqueueNDRangeKernel");
  }
  static pi_runtime::OpenClDeviceInfo firstCpu()
  {
    for (const pi_runtime::OpenClDeviceInfo& info : pi_runtime::findOpenClDevices(nullptr))
    {
      if (info.type == pi_runtime::UnitType::CPU)
      {
        return info;
      }
    }
    throw std::runtime_error("no OpenCL CPU device (Debian: pocl-opencl-icd)");
  }
  static std::vector<unsigned> subDevices(const pi_runtime::OpenClDeviceInfo& info)
  {
    return info.compute_units > 1 ? std::vector<unsigned>{1} : std::vector<unsigned>{};
  }

  pi_runtime::OpenClContext context_;
  pi_runtime::OpenClProgram program_;
  pi_runtime::ClQueue queue_;
  cl_kernel kernel_;
  BufferPtr buffer_;
  pi_runtime::ClMem memory_;
};

struct Tasks
{
  CodeletPtr native;
  CodeletPtr opencl;
  BufferPtr buffer = Buffer::allocate(4096);

  Tasks()
  {
    Codelet codelet;
    codelet.name = "empty_native";
    codelet.native = {{[](const pi_runtime::NativeCall&) {}}};
    native = makeCodelet(codelet);
    codelet.name = "empty_opencl";
    codelet.native.clear();
    codelet.opencl = {pi_runtime::singleKernel(EMPTY_SOURCE, "nothing", 1)};
    opencl = makeCodelet(codelet);
  }

  TaskRequest nativeRequest() const
  {
    TaskRequest request;
    request.codelet = native;
    return request;
  }
  TaskRequest openclRequest() const
  {
    TaskRequest request;
    request.codelet = opencl;
    request.arguments = {Argument::inOut(buffer)};
    request.unit = "cpu0";  // as the plain one
    return request;
  }
};

double microseconds(const std::function<void()>& function)
{
  const auto start = Clock::now();
  function();
  return secondsSince(start) * 1e6;
}

void waitOrThrow(const TaskHandle& handle)
{
  if (!handle.wait().ok())
  {
    throw std::runtime_error("an empty task failed: " + handle.wait().message);
  }
}

/// Figures of all rounds, by name.
using Rounds = std::map<std::string, std::vector<double>>;

void addQuantiles(const std::string& name, const std::vector<double>& times_us, Rounds* rounds)
{
  (*rounds)[name + " p50"].push_back(quantile(times_us, 0.5));
  (*rounds)[name + " p95"].push_back(quantile(times_us, 0.95));
  (*rounds)[name + " p99"].push_back(quantile(times_us, 0.99));
}

/// The four kinds alternate task by task, so that what else the machine does hits all of them.
void measureWaits(Runtime* runtime, const Tasks& tasks, PingPong* ping_pong, PlainOpenCl* plain, Rounds* rounds)
{
  const std::map<std::string, std::function<void()>> kinds{
      {"condition variable", [&] { ping_pong->roundTrip(); }},
      {"native task", [&] { waitOrThrow(runtime->submit(tasks.nativeRequest())); }},
      {"plain OpenCL", [&] { plain->launchAndWait(); }},
      {"opencl task", [&] { waitOrThrow(runtime->submit(tasks.openclRequest())); }},
  };
  std::map<std::string, std::vector<double>> times_us;
  for (size_t i = 0; i < UNMEASURED + WAITS; ++i)
  {
    for (const auto& [name, run] : kinds)
    {
      const double time_us = microseconds(run);
      if (i >= UNMEASURED)
      {
        times_us[name].push_back(time_us);
      }
    }
  }
  for (const auto& [name, times] : times_us)
  {
    addQuantiles(name, times, rounds);
  }
}

void measureLoop(Runtime* runtime, const std::string& name, const std::function<TaskRequest()>& request, Rounds* rounds)
{
  std::vector<TaskHandle> handles;
  handles.reserve(TASKS);
  const auto start = Clock::now();
  for (size_t i = 0; i < TASKS; ++i)
  {
    handles.push_back(runtime->submit(request()));
  }
  const double submit_s = secondsSince(start);
  for (const TaskHandle& handle : handles)
  {
    waitOrThrow(handle);
  }
  (*rounds)[name + ", loop: submit"].push_back(submit_s * 1e6 / TASKS);
  (*rounds)[name + ", loop: all"].push_back(secondsSince(start) * 1e6 / TASKS);
}

void measureBatch(Runtime* runtime, const Tasks& tasks, Rounds* rounds)
{
  std::vector<TaskRequest> batch(TASKS, tasks.nativeRequest());
  const auto start = Clock::now();
  const std::vector<TaskHandle> handles = runtime->submitBatch(std::move(batch));
  const double submit_s = secondsSince(start);
  for (const TaskHandle& handle : handles)
  {
    waitOrThrow(handle);
  }
  (*rounds)["native, batch: submit"].push_back(submit_s * 1e6 / TASKS);
  (*rounds)["native, batch: all"].push_back(secondsSince(start) * 1e6 / TASKS);
}

void measureChain(Runtime* runtime, const Tasks& tasks, Rounds* rounds)
{
  pi_runtime::GraphRequest graph;
  graph.tasks.assign(TASKS, tasks.nativeRequest());
  for (uint32_t i = 1; i < TASKS; ++i)
  {
    graph.edges.push_back({i - 1, i, 0.0});
  }
  const auto start = Clock::now();
  const std::vector<TaskHandle> handles = runtime->submitGraph(std::move(graph));
  const double submit_s = secondsSince(start);
  waitOrThrow(handles.back());
  (*rounds)["native, chain: submit"].push_back(submit_s * 1e6 / TASKS);
  (*rounds)["native, chain: all"].push_back(secondsSince(start) * 1e6 / TASKS);
}

void measureStarpu(const Settings& settings, int workers, Rounds* rounds)
{
  const Lines lines = runChild({"starpu", "latency", std::to_string(WAITS)}, STARPU_LIMIT_S,
                               starpuEnvironment(settings, "dmda", workers));
  const std::string name = "StarPU, " + std::to_string(workers) + (workers == 1 ? " worker" : " workers");
  addQuantiles(name, valuesOf(lines, "wait_us"), rounds);
  (*rounds)[name + ", loop: submit"].push_back(valuesOf(lines, "submit_us").at(0));
  (*rounds)[name + ", loop: all"].push_back(valuesOf(lines, "loop_us").at(0));
  (*rounds)[name + ", chain: all"].push_back(valuesOf(lines, "chain_us").at(0));
}

void addRatio(const std::string& name, const std::string& baseline, Rounds* rounds)
{
  (*rounds)[name + " / " + baseline].push_back((*rounds)[name + " p50"].back() / (*rounds)[baseline + " p50"].back());
}

void printWaits(const Rounds& rounds)
{
  std::printf("%-24s %24s %24s %24s\n", "submit + wait [us]", "p50", "p95", "p99");
  for (const char* const name :
       {"condition variable", "native task", "plain OpenCL", "opencl task", "StarPU, 1 worker", "StarPU, 2 workers"})
  {
    if (rounds.count(std::string(name) + " p50") != 0)
    {
      std::printf("%-24s", name);
      for (const char* const column : {" p50", " p95", " p99"})
      {
        std::printf(" %24s", spread(rounds.at(name + std::string(column))).c_str());
      }
      std::printf("\n");
    }
  }
}

}  // namespace

void benchLatency(Settings* settings)
{
  const Tasks tasks;
  PingPong ping_pong;
  PlainOpenCl plain(tasks.opencl->opencl.front());
  Rounds rounds;
  for (int round = 0; round < settings->rounds; ++round)
  {
    {
      Runtime runtime(benchOptions());
      runtime.calibrate(tasks.nativeRequest(), 20);
      runtime.calibrate(tasks.openclRequest(), 20);
      measureWaits(&runtime, tasks, &ping_pong, &plain, &rounds);
      addRatio("native task", "condition variable", &rounds);
      addRatio("opencl task", "plain OpenCL", &rounds);
      measureLoop(
          &runtime, "native", [&] { return tasks.nativeRequest(); }, &rounds);
      measureLoop(
          &runtime, "opencl", [&] { return tasks.openclRequest(); }, &rounds);
      rounds["plain OpenCL, loop: all"].push_back(microseconds([&] { plain.launchMany(TASKS); }) / TASKS);
      measureBatch(&runtime, tasks, &rounds);
      measureChain(&runtime, tasks, &rounds);
    }
    for (int workers = 1; starpuAvailable() && workers <= 2; ++workers)
    {
      measureStarpu(*settings, workers, &rounds);
    }
  }
  std::printf("\nLatency: %d rounds of %zu empty tasks of each kind, taking turns\n", settings->rounds, WAITS);
  printWaits(rounds);
  std::printf("%-44s %24s\n", "time per task [us]", "");
  for (const auto& [name, values] : rounds)
  {
    if (name.find(": ") != std::string::npos)
    {
      std::printf("%-44s %24s\n", name.c_str(), spread(values).c_str());
    }
  }
  for (const auto& [name, limit] :
       {std::pair<const char*, double>("native task / condition variable", 1.5), {"opencl task / plain OpenCL", 1.3}})
  {
    std::printf("%-44s %24s\n", name, spread(rounds.at(name)).c_str());
    printBar(settings, name, median(rounds.at(name)), limit, "", false);
  }
}

}  // namespace pi_runtime_bench
