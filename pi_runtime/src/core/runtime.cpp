#include <pi_runtime/runtime.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <stdexcept>

#include "core/runtime_core.h"

namespace pi_runtime
{
namespace
{

constexpr const char* TRACE_FOLDER = "PI_RUNTIME_TRACE";
constexpr size_t TRACED_TASKS = 100'000;  // 13 MB; a vehicle has 150 runs of stages per second

}  // namespace

Runtime::Runtime(const RuntimeOptions& options) : Runtime(options, {}) {}

Runtime::Runtime(const RuntimeOptions& options, std::vector<CustomUnit> units)
  : core_(std::make_shared<RuntimeCore>(options, std::move(units)))
{
  if (const char* const folder = std::getenv(TRACE_FOLDER))
  {
    trace().keepAtLeast(TRACED_TASKS);
    if (!std::filesystem::is_directory(folder))
    {
      // Now: at its end, a node says nothing any more.
      core_->say(LogLevel::WARNING, std::string(TRACE_FOLDER) + " = " + folder + " is no folder: make it first");
    }
  }
  core_->start();
}

Runtime::~Runtime()
{
  core_->stop();
  const char* const folder = std::getenv(TRACE_FOLDER);
  if (folder == nullptr)
  {
    return;
  }
  try
  {
    writeTrace(std::string(folder) + "/" + program_invocation_short_name + "_" + std::to_string(getpid()) + ".json");
  }
  catch (const std::exception& error)
  {
    core_->say(LogLevel::WARNING, std::string(TRACE_FOLDER) + ": " + error.what());
  }
}

std::shared_ptr<Runtime> Runtime::shared(const RuntimeOptions& options)
{
  static std::mutex mutex;
  static std::weak_ptr<Runtime> shared;
  std::lock_guard<std::mutex> lock(mutex);
  std::shared_ptr<Runtime> runtime = shared.lock();
  if (!runtime)
  {
    runtime = std::make_shared<Runtime>(options);
    shared = runtime;
  }
  return runtime;
}

TaskHandle Runtime::submit(TaskRequest request)
{
  return core_->submit(std::move(request));
}

std::string Runtime::refusalOf(const TaskRequest& request) const
{
  return core_->refusalOf(request);
}

std::vector<TaskHandle> Runtime::submitBatch(std::vector<TaskRequest> requests)
{
  return core_->submitBatch(std::move(requests));
}

std::vector<TaskHandle> Runtime::submitGraph(GraphRequest request)
{
  return core_->submitGraph(std::move(request));
}

Admission Runtime::admit(const StreamRequest& request)
{
  return core_->admit(request);
}

Admission Runtime::amend(StreamId id, const StreamRequest& request)
{
  return core_->amend(id, request);
}

void Runtime::retire(StreamId id)
{
  core_->retire(id);
}

std::vector<StreamStatus> Runtime::streams() const
{
  return core_->streams();
}

std::vector<TaskResult> Runtime::calibrate(const TaskRequest& request, int runs)
{
  return core_->calibrate(request, runs);
}

void Runtime::raiseThread() const
{
  core_->raiseThread();
}

std::vector<UnitStatus> Runtime::units() const
{
  return core_->units();
}

void Runtime::setUnitAvailable(const std::string& unit, bool available)
{
  core_->setUnitAvailable(unit, available);
}

RuntimeStatistics Runtime::statistics() const
{
  return core_->statistics();
}

InterCoreOptions Runtime::interCoreOptions() const
{
  return core_->interCoreOptions();
}

void Runtime::setInterCoreOptions(const InterCoreOptions& options)
{
  core_->setInterCoreOptions(options);
}

InnerCoreOptions Runtime::innerCoreOptions() const
{
  return core_->innerCoreOptions();
}

void Runtime::setInnerCoreOptions(const InnerCoreOptions& options)
{
  core_->setInnerCoreOptions(options);
}

std::vector<EtcTable::Entry> Runtime::etcEntries() const
{
  return core_->etcEntries();
}

void Runtime::setEtcEntries(const std::vector<EtcTable::Entry>& entries)
{
  core_->setEtcEntries(entries);
}

void Runtime::clearEtc()
{
  core_->clearEtc();
}

double Runtime::predict(const CodeletPtr& codelet, double size, const std::string& unit) const
{
  return core_->predict(codelet, size, unit);
}

void Runtime::writeTrace(const std::string& path)
{
  std::vector<std::string> names;
  for (const UnitStatus& unit : units())
  {
    names.push_back(unit.name);
  }
  errno = 0;
  std::ofstream file(path);
  writeChromeTrace(file, trace().snapshot(), names, program_invocation_short_name);
  file.close();
  if (!file)
  {
    throw std::runtime_error("trace " + path + " cannot be written: " + std::strerror(errno));
  }
}

TraceRecorder& Runtime::trace()
{
  return core_->trace();
}

}  // namespace pi_runtime
