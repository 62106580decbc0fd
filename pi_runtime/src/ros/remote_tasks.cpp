#include "ros/remote_tasks.h"
#include "ros/conversions.h"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <stdexcept>
#include <utility>

namespace pi_runtime
{

RemoteTasks::RemoteTasks(std::shared_ptr<Runtime> runtime, const CodeletRegistry* codelets, KeptBuffers* buffers,
                         const Limits& limits)
  : runtime_(std::move(runtime))
  , codelets_(codelets)
  , buffers_(buffers)
  , limits_(limits)
  , memory_(limits.max_task_memory)
  , reports_([this](EntryPtr entry, TaskReportPtr report) { finish(std::move(entry), std::move(report)); })
{
}

RemoteTasks::~RemoteTasks()
{
  close();
  std::vector<TaskHandle> open;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    for (const auto& [id, entry] : entries_)
    {
      if (entry->handle.valid())
      {
        open.push_back(entry->handle);
      }
    }
  }
  for (const TaskHandle& handle : open)
  {
    handle.cancel();
  }
  reports_.stop();
}

void RemoteTasks::close()
{
  std::lock_guard<std::mutex> lock(mutex_);
  closing_ = true;
  changed_.notify_all();
}

std::shared_ptr<const void> RemoteTasks::takeMemory(size_t bytes)
{
  for (;;)
  {
    if (std::shared_ptr<const void> share = memory_.take(bytes))
    {
      return share;
    }
    std::lock_guard<std::mutex> lock(mutex_);
    if (kept_.empty() || bytes > memory_.limit())
    {
      throw std::runtime_error("the arguments need " + std::to_string(bytes) + " bytes, " +
                               std::to_string(memory_.used()) + " of " + std::to_string(memory_.limit()) +
                               " for tasks are in use (max_task_memory_mb); send it again later, or a smaller one");
    }
    forgetLocked(kept_.front());
  }
}

void RemoteTasks::requireRoom(size_t tasks) const
{
  if (closing_)
  {
    throw std::runtime_error("the runtime node ends");
  }
  if (open_ + tasks > limits_.max_tasks)
  {
    throw std::runtime_error(std::to_string(open_) + " tasks are open, with " + std::to_string(tasks) +
                             " more there would be more than max_tasks = " + std::to_string(limits_.max_tasks) +
                             "; wait for some");
  }
}

RemoteTasks::EntryPtr RemoteTasks::makeEntry(const TaskConstPtr& task, KeptBuffers::Draft* draft, Listener listener)
{
  auto entry = std::make_shared<RemoteTask>();
  entry->intake = takeIn(task, *codelets_, draft, [this](size_t bytes) { return takeMemory(bytes); });
  entry->listener = std::move(listener);
  const std::string refusal = runtime_->refusalOf(entry->intake.request);
  if (!refusal.empty())
  {
    throw std::invalid_argument(refusal);
  }
  return entry;
}

void RemoteTasks::enrol(const EntryPtr& entry, TaskHandle handle)
{
  entry->id = handle.id();
  entry->handle = std::move(handle);
  entries_[entry->id] = entry;
  ++open_;
}

RemoteTasks::EntryPtr RemoteTasks::start(const TaskConstPtr& task, Listener listener)
{
  KeptBuffers::Draft draft(buffers_);
  const EntryPtr entry = makeEntry(task, &draft, std::move(listener));
  // Its end is processed under the same lock, so it is enrolled by then.
  std::lock_guard<std::mutex> lock(mutex_);
  requireRoom(1);
  draft.commit();
  enrol(entry, runtime_->submit(reports_.requestOf(entry)));
  return entry;
}

void RemoteTasks::run(const TaskConstPtr& task, Listener listener)
{
  try
  {
    start(task, listener);
  }
  catch (const std::exception& error)
  {
    const TaskReportPtr report = boost::make_shared<TaskReport>();
    report->client_key = task->client_key;
    report->outcome = TaskReport::REFUSED;
    report->message = error.what();
    listener(report);
  }
}

RemoteTasks::EntryPtr RemoteTasks::submit(const TaskConstPtr& task)
{
  return start(task, nullptr);
}

std::vector<RemoteTasks::EntryPtr> RemoteTasks::submitGraph(const std::vector<TaskConstPtr>& tasks,
                                                            const std::vector<GraphEdge>& edges)
{
  if (tasks.empty())
  {
    throw std::invalid_argument("the graph has no tasks, must have at least one");
  }
  KeptBuffers::Draft draft(buffers_);
  GraphRequest graph;
  std::vector<EntryPtr> entries;
  for (const TaskConstPtr& task : tasks)
  {
    try
    {
      entries.push_back(makeEntry(task, &draft, nullptr));
    }
    catch (const std::exception& error)
    {
      throw std::runtime_error("task " + std::to_string(entries.size()) + ": " + error.what());
    }
    graph.tasks.push_back(reports_.requestOf(entries.back()));
  }
  for (const GraphEdge& edge : edges)
  {
    graph.edges.push_back(fromMsg(edge));
  }
  std::lock_guard<std::mutex> lock(mutex_);
  requireRoom(tasks.size());
  const std::vector<TaskHandle> handles = runtime_->submitGraph(std::move(graph));
  draft.commit();
  for (size_t i = 0; i < entries.size(); ++i)
  {
    enrol(entries[i], handles[i]);
  }
  return entries;
}

bool RemoteTasks::wait(const std::vector<EntryPtr>& entries, std::chrono::nanoseconds timeout)
{
  const auto ended = [&entries] {
    return std::all_of(entries.begin(), entries.end(), [](const EntryPtr& entry) { return entry->report != nullptr; });
  };
  const auto over = [this, &ended] { return closing_ || ended(); };
  std::unique_lock<std::mutex> lock(mutex_);
  if (timeout.count() == 0)
  {
    changed_.wait(lock, over);
  }
  else
  {
    changed_.wait_for(lock, timeout, over);
  }
  return ended();
}

std::vector<TaskReportConstPtr> RemoteTasks::handOver(const std::vector<EntryPtr>& entries)
{
  std::vector<TaskReportConstPtr> reports;
  std::lock_guard<std::mutex> lock(mutex_);
  for (const EntryPtr& entry : entries)
  {
    reports.push_back(entry->report);
    if (entry->report)
    {
      forgetLocked(entry);
    }
  }
  return reports;
}

RemoteTasks::Answer RemoteTasks::query(uint64_t id)
{
  std::lock_guard<std::mutex> lock(mutex_);
  expireLocked();
  const auto found = entries_.find(id);
  return found != entries_.end() ? Answer{true, found->second->report} : Answer{};
}

bool RemoteTasks::cancel(uint64_t id)
{
  TaskHandle handle;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const auto found = entries_.find(id);
    if (found == entries_.end() || !found->second->handle.valid())
    {
      return false;
    }
    handle = found->second->handle;
  }
  handle.cancel();
  return true;
}

void RemoteTasks::expire()
{
  std::lock_guard<std::mutex> lock(mutex_);
  expireLocked();
}

size_t RemoteTasks::openTasks() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return open_;
}

size_t RemoteTasks::keptReports() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return kept_.size();
}

void RemoteTasks::expireLocked()
{
  const auto oldest = std::chrono::steady_clock::now() - limits_.report_keep;
  while (!kept_.empty() && (kept_.size() > limits_.max_kept_reports || kept_.front()->ended_at < oldest))
  {
    forgetLocked(kept_.front());
  }
}

void RemoteTasks::forgetLocked(const EntryPtr& entry)
{
  const EntryPtr forgotten = entry;  // the parameter may be the element that goes
  entries_.erase(forgotten->id);
  kept_.erase(std::remove(kept_.begin(), kept_.end(), forgotten), kept_.end());
}

/// When a client learns of the end, the report is held by the kept ones alone: it can be given up for what comes next.
void RemoteTasks::finish(EntryPtr entry, TaskReportPtr report)
{
  std::unique_lock<std::mutex> lock(mutex_);
  report->id = entry->id;
  entry->report = report;
  entry->ended_at = std::chrono::steady_clock::now();
  entry->handle = TaskHandle();  // and with it the arguments
  entry->intake.outputs.clear();
  entry->intake.report.reset();
  entry->intake.input_memory.reset();
  --open_;
  if (entry->listener)
  {
    entries_.erase(entry->id);
    changed_.notify_all();
    lock.unlock();
    entry->listener(report);
    return;
  }
  report.reset();
  kept_.push_back(std::move(entry));
  expireLocked();
  changed_.notify_all();
}

}  // namespace pi_runtime
