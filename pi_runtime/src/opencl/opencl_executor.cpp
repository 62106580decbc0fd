#include "opencl/opencl_executor.h"

#include <algorithm>
#include <chrono>
#include <limits>
#include <utility>

namespace pi_runtime
{
namespace
{

using Clock = std::chrono::steady_clock;

constexpr size_t BANDWIDTH_TEST_BYTES = 8 << 20;

struct ClMemCopy : MemorySpace::Copy
{
  ClMemCopy(std::shared_ptr<const OpenClContext> owner, ClMem object)
    : context(std::move(owner)), memory(std::move(object))
  {
  }
  const std::shared_ptr<const OpenClContext> context;  ///< PoCL does not stand objects that outlive it
  ClMem memory;
  void* mapped = nullptr;  ///< where the host has it, in MAPPED memory
};

ClMem makeMemory(const OpenClContext& context, cl_mem_flags flags, size_t bytes, void* host)
{
  cl_int code = CL_SUCCESS;
  ClMem memory(clCreateBuffer(context.get(), flags, bytes, host, &code));
  checkOpenCl(code, "clCreateBuffer of " + std::to_string(bytes) + " bytes on " + context.info().name);
  return memory;
}

/// A device's own memory: bytes are moved.
class SeparateSpace : public MemorySpace
{
public:
  explicit SeparateSpace(ClQueue queue) : queue_(std::move(queue)) {}

  void upload(Copy& copy, const void* host, size_t bytes) override
  {
    checkOpenCl(clEnqueueWriteBuffer(queue_.get(), static_cast<ClMemCopy&>(copy).memory.get(), CL_TRUE, 0, bytes, host,
                                     0, nullptr, nullptr),
                "clEnqueueWriteBuffer of " + std::to_string(bytes) + " bytes");
  }

  void download(Copy& copy, void* host, size_t bytes) override
  {
    checkOpenCl(clEnqueueReadBuffer(queue_.get(), static_cast<ClMemCopy&>(copy).memory.get(), CL_TRUE, 0, bytes, host,
                                    0, nullptr, nullptr),
                "clEnqueueReadBuffer of " + std::to_string(bytes) + " bytes");
  }

private:
  const ClQueue queue_;
};

/// The host's memory, which belongs to the device between unmap and map. Nothing is moved.
class MappedSpace : public MemorySpace
{
public:
  explicit MappedSpace(ClQueue queue) : queue_(std::move(queue)) {}

  void upload(Copy&, const void*, size_t) override {}
  void download(Copy& copy, void*, size_t bytes) override { giveToHost(copy, bytes); }

  void giveToUnit(Copy& copy) override
  {
    ClMemCopy& own = static_cast<ClMemCopy&>(copy);
    if (own.mapped != nullptr)
    {
      checkOpenCl(clEnqueueUnmapMemObject(queue_.get(), own.memory.get(), own.mapped, 0, nullptr, nullptr),
                  "clEnqueueUnmapMemObject");
      own.mapped = nullptr;
      checkOpenCl(clFinish(queue_.get()), "clFinish");
    }
  }

  void giveToHost(Copy& copy, size_t bytes) override
  {
    ClMemCopy& own = static_cast<ClMemCopy&>(copy);
    if (own.mapped == nullptr)
    {
      cl_int code = CL_SUCCESS;
      own.mapped = clEnqueueMapBuffer(queue_.get(), own.memory.get(), CL_TRUE, CL_MAP_READ | CL_MAP_WRITE, 0, bytes, 0,
                                      nullptr, nullptr, &code);
      checkOpenCl(code, "clEnqueueMapBuffer of " + std::to_string(bytes) + " bytes");
    }
  }

private:
  const ClQueue queue_;
};

std::shared_ptr<MemorySpace> makeSpace(const OpenClContext& context, size_t device)
{
  switch (context.memoryModel())
  {
    case MemoryModel::MAPPED:
      return std::make_shared<MappedSpace>(context.makeQueue(device));
    case MemoryModel::SEPARATE:
      return std::make_shared<SeparateSpace>(context.makeQueue(device));
    case MemoryModel::DIRECT:
      break;
  }
  return nullptr;
}

/// What a completion callback of the driver has to know.
struct Pending
{
  Executor::Completion completion;
  ExecutionReport report;
  std::string codelet;
};

void CL_CALLBACK onComplete(cl_event event, cl_int status, void* data)
{
  const std::unique_ptr<Pending> pending(static_cast<Pending*>(data));
  clReleaseEvent(event);
  if (status < 0)
  {
    const OpenClError error("a kernel of " + pending->codelet, status);
    pending->report.opencl_code = status;
    pending->report.message = error.what();
    pending->report.outcome = error.deviceLost() ? Outcome::UNIT_FAILED : Outcome::EXECUTION_FAILED;
  }
  pending->completion(pending->report);
}

}  // namespace

OpenClExecutor::OpenClExecutor(std::shared_ptr<OpenClContext> context, size_t device, std::string cache_folder)
  : context_(std::move(context))
  , device_(device)
  , cache_folder_(std::move(cache_folder))
  , queue_(context_->makeQueue(device))
  , space_(makeSpace(*context_, device))
{
}

OpenClExecutor::~OpenClExecutor()
{
  clFinish(queue_.get());
  // PoCL 3.1 crashes now and then where its own thread, which releases the last event after clFinish(), is the last to
  // hold queue and context: both are kept until the process ends.
  if (context_->info().platform_name == "Portable Computing Language")
  {
    clRetainCommandQueue(queue_.get());
  }
}

OpenClProgram* OpenClExecutor::find(const CodeletPtr& codelet) const
{
  std::lock_guard<std::mutex> lock(mutex_);
  const auto found = prepared_.find(codelet->name);
  return found != prepared_.end() && found->second.codelet == codelet ? found->second.program.get() : nullptr;
}

bool OpenClExecutor::ready(const Execution& execution) const
{
  return !space_ && find(execution.codelet) != nullptr;
}

void OpenClExecutor::prepare(const CodeletPtr& codelet)
{
  if (find(codelet) != nullptr)
  {
    return;
  }
  const OpenClImplementation& implementation = codelet->opencl.front();
  auto program = std::make_unique<OpenClProgram>(*context_, device_, implementation, cache_folder_);
  for (const std::string& kernel : implementation.kernels)
  {
    program->kernel(kernel);
  }
  std::lock_guard<std::mutex> lock(mutex_);
  Prepared& prepared = prepared_[codelet->name];
  if (prepared.codelet != codelet)  // else another thread was faster
  {
    prepared = Prepared{codelet, std::move(program)};
  }
}

double OpenClExecutor::tryOut(const Execution& execution)
{
  constexpr int RUNS = 3;  // the first one compiles the kernels for their local sizes, the second one fills caches
  prepare(execution.codelet);
  const bool shared = context_->memoryModel() != MemoryModel::SEPARATE;
  std::vector<ClMem> owned;
  std::vector<cl_mem> memory(execution.arguments.size(), nullptr);
  for (size_t index = 0; index < memory.size(); ++index)
  {
    const Argument& argument = execution.arguments[index];
    if (argument.isBuffer())
    {
      Buffer& buffer = *argument.buffer();
      const cl_mem_flags flags = CL_MEM_READ_WRITE | (shared ? CL_MEM_USE_HOST_PTR : CL_MEM_COPY_HOST_PTR);
      owned.push_back(makeMemory(*context_, flags, buffer.bytes(), buffer.address()));
      memory[index] = owned.back().get();
    }
  }
  const ClQueue queue = context_->makeQueue(device_);
  double seconds = 0.0;
  for (int run = 0; run < RUNS; ++run)
  {
    const auto begin = Clock::now();
    OpenClCommand command(*find(execution.codelet), queue.get(), execution.arguments, memory, execution.begin,
                          execution.end, execution.range);
    try
    {
      execution.codelet->opencl.front().function(command);
    }
    catch (...)
    {
      clFinish(queue.get());  // what was enqueued before uses the buffers
      throw;
    }
    checkOpenCl(clFinish(queue.get()), "a trial of " + execution.codelet->name);
    seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  }
  return seconds;
}

cl_mem OpenClExecutor::memoryOf(Buffer& buffer, Access access, ExecutionReport* report)
{
  const bool shared = context_->memoryModel() != MemoryModel::SEPARATE;
  const cl_mem_flags flags = CL_MEM_READ_WRITE | (shared ? CL_MEM_USE_HOST_PTR : 0);
  const auto make = [&]
  {
    return std::make_unique<ClMemCopy>(
        context_, makeMemory(*context_, flags, buffer.bytes(), shared ? buffer.address() : nullptr));
  };
  if (!space_)
  {
    // Copies of other units go to the host first.
    report->moved_bytes += buffer.bytesToMove(nullptr, access);
    buffer.host(access);
    return static_cast<ClMemCopy&>(buffer.shared(context_.get(), make)).memory.get();
  }
  size_t moved = 0;
  MemorySpace::Copy& copy = buffer.copyIn(space_, access, make, &moved);
  report->moved_bytes += context_->memoryModel() == MemoryModel::SEPARATE ? moved : 0;
  return static_cast<ClMemCopy&>(copy).memory.get();
}

void OpenClExecutor::enqueue(const Execution& execution, ExecutionReport* report, ClEvent* finished)
{
  prepare(execution.codelet);
  OpenClProgram* const program = find(execution.codelet);
  memory_.assign(execution.arguments.size(), nullptr);
  const auto begin = space_ ? Clock::now() : Clock::time_point();
  for (size_t index = 0; index < execution.arguments.size(); ++index)
  {
    const Argument& argument = execution.arguments[index];
    if (argument.isBuffer())
    {
      memory_[index] = memoryOf(*argument.buffer(), execution.accessOf(argument), report);
    }
  }
  if (space_)
  {
    report->transfer_ns = (Clock::now() - begin) / std::chrono::nanoseconds(1);
  }
  OpenClCommand command(*program, queue_.get(), execution.arguments, memory_, execution.begin, execution.end,
                        execution.range);
  execution.codelet->opencl.front().function(command);
  *finished = ClEvent(command.takeLastEvent());
}

void OpenClExecutor::start(const Execution& execution, Completion completion)
{
  auto pending = std::make_unique<Pending>();
  ClEvent finished;
  try
  {
    enqueue(execution, &pending->report, &finished);
    if (finished.get() != nullptr)
    {
      pending->completion = completion;
      pending->codelet = execution.codelet->name;
      const cl_event event = finished.get();
      checkOpenCl(clRetainEvent(event), "clRetainEvent");
      const cl_int code = clSetEventCallback(event, CL_COMPLETE, onComplete, pending.get());
      if (code != CL_SUCCESS)
      {
        clReleaseEvent(event);
        checkOpenCl(code, "clSetEventCallback");
      }
      pending.release();
      clFlush(queue_.get());
      return;
    }
  }
  catch (...)
  {
    // What was enqueued before the failure may still use the buffers.
    clFinish(queue_.get());
    completion(reportOfCurrentException());
    return;
  }
  completion(pending->report);
}

double OpenClExecutor::measureBandwidth()
{
  if (context_->memoryModel() != MemoryModel::SEPARATE)
  {
    return std::numeric_limits<double>::infinity();
  }
  const BufferPtr buffer = Buffer::allocate(BANDWIDTH_TEST_BYTES);
  ClMemCopy copy(context_, makeMemory(*context_, CL_MEM_READ_WRITE, buffer->bytes(), nullptr));
  double best_s = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 3; ++round)
  {
    const auto begin = Clock::now();
    space_->upload(copy, buffer->address(), buffer->bytes());
    space_->download(copy, buffer->address(), buffer->bytes());
    best_s = std::min(best_s, std::chrono::duration<double>(Clock::now() - begin).count());
  }
  return 2.0 * static_cast<double>(buffer->bytes()) / best_s;
}

}  // namespace pi_runtime
