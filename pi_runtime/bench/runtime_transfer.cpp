// Part `transfer` of bench_runtime: what it costs to hand data to a unit and back under each memory model, against the
// OpenCL calls that one would write by hand for it. On PoCL all three are the host's memory, so SEPARATE shows the
// copies that a discrete GPU needs, not its bus.
#include <atomic>
#include <cstdio>
#include <stdexcept>

#include <pi_runtime/opencl_command.h>
#include "opencl/opencl_executor.h"
#include <pi_runtime/runtime.h>
#include "runtime_bench.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::Access;
using pi_runtime::Argument;
using pi_runtime::Buffer;
using pi_runtime::BufferPtr;
using pi_runtime::checkOpenCl;
using pi_runtime::CodeletPtr;
using pi_runtime::Execution;
using pi_runtime::ExecutionReport;
using pi_runtime::Executor;
using pi_runtime::MemoryModel;
using pi_runtime::OpenClContext;

constexpr size_t LOCAL = 256;
constexpr float FACTOR = 0.5f;
constexpr char SOURCE[] = R"cl(
kernel void saxpy(global const float* x, global float* y, float a)
{
  const size_t i = get_global_id(0);
  y[i] = a * x[i] + 0.5f * y[i];
}
)cl";

/// Counts the bytes that another executor moves to its unit.
class CountingExecutor : public Executor
{
public:
  CountingExecutor(std::unique_ptr<Executor> inner, std::atomic<uint64_t>* bytes)
    : inner_(std::move(inner)), bytes_(bytes)
  {
  }
  const char* name() const override { return inner_->name(); }
  bool supports(const pi_runtime::Codelet& codelet) const override { return inner_->supports(codelet); }
  bool asynchronous() const override { return inner_->asynchronous(); }
  bool ready(const Execution& execution) const override { return inner_->ready(execution); }
  void prepare(const CodeletPtr& codelet) override { inner_->prepare(codelet); }
  const pi_runtime::MemorySpace* memory() const override { return inner_->memory(); }
  double measureBandwidth() override { return inner_->measureBandwidth(); }
  void start(const Execution& execution, Completion completion) override
  {
    inner_->start(execution,
                  [bytes = bytes_, completion = std::move(completion)](const ExecutionReport& report)
                  {
                    bytes->fetch_add(report.moved_bytes);
                    completion(report);
                  });
  }

private:
  const std::unique_ptr<Executor> inner_;
  std::atomic<uint64_t>* const bytes_;
};

CodeletPtr saxpyCodelet()
{
  pi_runtime::Codelet codelet;
  codelet.name = "saxpy";
  codelet.opencl = {pi_runtime::singleKernel(SOURCE, "saxpy", LOCAL)};
  return makeCodelet(codelet);
}

pi_runtime::OpenClDeviceInfo cpuDevice()
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

std::shared_ptr<OpenClContext> oneCore(MemoryModel model)
{
  const pi_runtime::OpenClDeviceInfo info = cpuDevice();
  const std::vector<unsigned> counts = info.compute_units > 1 ? std::vector<unsigned>{1} : std::vector<unsigned>{};
  return std::make_shared<OpenClContext>(info, counts, model);
}

/// One cycle: the host changes x, `tasks` kernels use it, the host reads y.
class RuntimeSaxpy
{
public:
  RuntimeSaxpy(MemoryModel model, size_t bytes)
    : codelet_(saxpyCodelet()), x_(Buffer::allocate(bytes)), y_(Buffer::allocate(bytes))
  {
    pi_runtime::RuntimeOptions options = benchOptions();
    options.native = false;
    options.opencl_cpu = false;
    pi_runtime::CustomUnit unit;
    unit.name = "device";
    unit.executors.push_back(std::make_unique<CountingExecutor>(
        std::make_unique<pi_runtime::OpenClExecutor>(oneCore(model), 0, options.cache_folder), &moved_));
    std::vector<pi_runtime::CustomUnit> units;
    units.push_back(std::move(unit));
    runtime_ = std::make_unique<pi_runtime::Runtime>(options, std::move(units));
  }

  void cycle(int tasks, float value)
  {
    x_->hostAs<float>(Access::READ_WRITE)[0] = value;
    pi_runtime::TaskRequest request;
    request.codelet = codelet_;
    request.arguments = {Argument::in(x_), Argument::inOut(y_), Argument::value(FACTOR)};
    request.range = x_->bytes() / sizeof(float);
    for (int i = 0; i < tasks; ++i)
    {
      const pi_runtime::TaskResult result = runtime_->submit(request).wait();
      if (!result.ok())
      {
        throw std::runtime_error("saxpy fails: " + result.message);
      }
    }
    moved_ += y_->bytesToMove(nullptr, Access::READ);
    last_ = y_->hostAs<float>(Access::READ)[0];
  }

  float last() const { return last_; }
  /// Since the last call.
  uint64_t takeMoved() { return moved_.exchange(0); }

private:
  const CodeletPtr codelet_;
  const BufferPtr x_;
  const BufferPtr y_;
  std::atomic<uint64_t> moved_{0};
  float last_ = 0.0f;
  std::unique_ptr<pi_runtime::Runtime> runtime_;
};

/// The same by plain OpenCL.
class PlainSaxpy
{
public:
  PlainSaxpy(MemoryModel model, size_t bytes)
    : model_(model)
    , context_(oneCore(model))
    , program_(*context_, 0, saxpyCodelet()->opencl.front(), "")
    , kernel_(program_.kernel("saxpy"))
    , queue_(context_->makeQueue(0))
    , x_(Buffer::allocate(bytes))
    , y_(Buffer::allocate(bytes))
    , x_memory_(makeMemory(*x_))
    , y_memory_(makeMemory(*y_))
  {
    if (model_ == MemoryModel::SEPARATE)
    {
      write(y_memory_.get(), *y_);
    }
  }

  void cycle(int tasks, float value)
  {
    hostAccess(x_memory_.get(), *x_, CL_MAP_READ | CL_MAP_WRITE, [&](float* x) { x[0] = value; });
    if (model_ == MemoryModel::SEPARATE)
    {
      write(x_memory_.get(), *x_);
    }
    for (int i = 0; i < tasks; ++i)
    {
      launchAndWait();
    }
    if (model_ == MemoryModel::SEPARATE)
    {
      checkOpenCl(clEnqueueReadBuffer(queue_.get(), y_memory_.get(), CL_TRUE, 0, y_->bytes(), y_->address(), 0, nullptr,
                                      nullptr),
                  "clEnqueueReadBuffer");
    }
    hostAccess(y_memory_.get(), *y_, CL_MAP_READ, [&](const float* y) { last_ = y[0]; });
  }

  float last() const { return last_; }

private:
  pi_runtime::ClMem makeMemory(const Buffer& buffer) const
  {
    cl_int code = CL_SUCCESS;
    const bool separate = model_ == MemoryModel::SEPARATE;
    pi_runtime::ClMem memory(clCreateBuffer(context_->get(), CL_MEM_READ_WRITE | (separate ? 0 : CL_MEM_USE_HOST_PTR),
                                            buffer.bytes(), separate ? nullptr : buffer.address(), &code));
    checkOpenCl(code, "clCreateBuffer");
    return memory;
  }

  void write(cl_mem memory, const Buffer& buffer)
  {
    checkOpenCl(
        clEnqueueWriteBuffer(queue_.get(), memory, CL_TRUE, 0, buffer.bytes(), buffer.address(), 0, nullptr, nullptr),
        "clEnqueueWriteBuffer");
  }

  template <typename Use>
  void hostAccess(cl_mem memory, const Buffer& buffer, cl_map_flags flags, const Use& use)
  {
    if (model_ != MemoryModel::MAPPED)
    {
      use(static_cast<float*>(buffer.address()));
      return;
    }
    cl_int code = CL_SUCCESS;
    void* const mapped =
        clEnqueueMapBuffer(queue_.get(), memory, CL_TRUE, flags, 0, buffer.bytes(), 0, nullptr, nullptr, &code);
    checkOpenCl(code, "clEnqueueMapBuffer");
    use(static_cast<float*>(mapped));
    checkOpenCl(clEnqueueUnmapMemObject(queue_.get(), memory, mapped, 0, nullptr, nullptr), "clEnqueueUnmapMemObject");
  }

  void launchAndWait()
  {
    const cl_mem x = x_memory_.get();
    const cl_mem y = y_memory_.get();
    const size_t global = x_->bytes() / sizeof(float);
    cl_event event = nullptr;
    checkOpenCl(clSetKernelArg(kernel_, 0, sizeof x, &x), "clSetKernelArg");
    checkOpenCl(clSetKernelArg(kernel_, 1, sizeof y, &y), "clSetKernelArg");
    checkOpenCl(clSetKernelArg(kernel_, 2, sizeof FACTOR, &FACTOR), "clSetKernelArg");
    checkOpenCl(clEnqueueNDRangeKernel(queue_.get(), kernel_, 1, nullptr, &global, &LOCAL, 0, nullptr, &event),
                "clEnqueueNDRangeKernel");
    checkOpenCl(clWaitForEvents(1, &event), "clWaitForEvents");
    clReleaseEvent(event);
  }

  const MemoryModel model_;
  const std::shared_ptr<OpenClContext> context_;
  pi_runtime::OpenClProgram program_;
  const cl_kernel kernel_;
  const pi_runtime::ClQueue queue_;
  const BufferPtr x_;
  const BufferPtr y_;
  const pi_runtime::ClMem x_memory_;
  const pi_runtime::ClMem y_memory_;
  float last_ = 0.0f;
};

struct Case
{
  MemoryModel model;
  size_t bytes;
  int tasks;
  int cycles;  ///< of a round
};

struct CaseFigures
{
  std::vector<double> ours_us;  ///< a cycle, median of a round
  std::vector<double> plain_us;
  std::vector<double> ratio;
  double moved_bytes = 0.0;  ///< per cycle of the last round
};

void measure(const Case& one, CaseFigures* figures)
{
  RuntimeSaxpy ours(one.model, one.bytes);
  PlainSaxpy plain(one.model, one.bytes);
  std::vector<double> ours_us;
  std::vector<double> plain_us;
  const int unmeasured = 3;  // compile, fault pages in
  for (int cycle = -unmeasured; cycle < one.cycles; ++cycle)
  {
    const auto value = static_cast<float>(cycle);
    if (cycle == 0)
    {
      ours.takeMoved();
    }
    const auto start = Clock::now();
    ours.cycle(one.tasks, value);
    const auto middle = Clock::now();
    plain.cycle(one.tasks, value);
    if (cycle >= 0)
    {
      ours_us.push_back(std::chrono::duration<double, std::micro>(middle - start).count());
      plain_us.push_back(secondsSince(middle) * 1e6);
    }
    if (ours.last() != plain.last())
    {
      throw std::runtime_error("saxpy: the runtime and plain OpenCL have different results");
    }
  }
  figures->ours_us.push_back(median(ours_us));
  figures->plain_us.push_back(median(plain_us));
  figures->ratio.push_back(median(ours_us) / median(plain_us));
  figures->moved_bytes = static_cast<double>(ours.takeMoved()) / one.cycles;
}

}  // namespace

void benchTransfer(Settings* settings)
{
  std::vector<Case> cases;
  for (const size_t megabytes : {1, 16})
  {
    for (const MemoryModel model : {MemoryModel::DIRECT, MemoryModel::MAPPED, MemoryModel::SEPARATE})
    {
      for (const int tasks : {1, 10})
      {
        cases.push_back({model, megabytes << 20, tasks, megabytes == 1 ? 60 : 12});
      }
    }
  }
  std::vector<CaseFigures> figures(cases.size());
  for (int round = 0; round < settings->rounds; ++round)
  {
    for (size_t i = 0; i < cases.size(); ++i)
    {
      measure(cases[i], &figures[i]);
    }
  }
  std::printf(
      "\nTransfer: the host changes x, tasks compute y = a x + y / 2 on one core, the host reads y; %d rounds,\n"
      "taking turns with plain OpenCL cycle by cycle; bytes handed over per cycle: mapped or copied\n",
      settings->rounds);
  std::printf("%-9s %7s %6s %30s %30s %20s %17s\n", "memory", "buffers", "tasks", "pi_runtime [us]",
              "plain OpenCL [us]", "ratio", "handed over [MB]");
  for (size_t i = 0; i < cases.size(); ++i)
  {
    std::printf("%-9s %4zu MB %6d %30s %30s %20s %17.2f\n", toString(cases[i].model), cases[i].bytes >> 20,
                cases[i].tasks, spread(figures[i].ours_us, "%.0f").c_str(), spread(figures[i].plain_us, "%.0f").c_str(),
                spread(figures[i].ratio).c_str(), figures[i].moved_bytes / (1 << 20));
  }
}

}  // namespace pi_runtime_bench
