#include <pi_runtime/runtime.h>

#include <mutex>

#include "core/runtime_core.h"

namespace pi_runtime
{

Runtime::Runtime(const RuntimeOptions& options) : Runtime(options, {}) {}

Runtime::Runtime(const RuntimeOptions& options, std::vector<CustomUnit> units)
  : core_(std::make_shared<RuntimeCore>(options, std::move(units)))
{
  core_->start();
}

Runtime::~Runtime()
{
  core_->stop();
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

TraceRecorder& Runtime::trace()
{
  return core_->trace();
}

}  // namespace pi_runtime
