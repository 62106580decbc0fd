#include "ros/report_thread.h"

#include <pthread.h>

#include <boost/make_shared.hpp>
#include <string>

#include "ros/conversions.h"

namespace pi_runtime
{
namespace
{

TaskReportPtr makeReport(const ReportThread::EntryPtr& entry, TaskResult result)
{
  try
  {
    for (const BufferPtr& output : entry->intake.outputs)
    {
      if (output && result.ok())
      {
        output->host(Access::READ);
      }
    }
  }
  catch (const std::exception& error)
  {
    result.outcome = Outcome::UNIT_FAILED;
    result.message = std::string("its results cannot be fetched: ") + error.what();
  }
  const TaskReportPtr report = boost::make_shared<TaskReport>(toMsg(result));
  report->client_key = entry->intake.report->client_key;
  if (result.ok())
  {
    report->outputs = std::move(entry->intake.report->outputs);
  }
  // Else the outputs stay with the buffers: a unit that hangs may still write into them.
  return report;
}

}  // namespace

ReportThread::ReportThread(Finish finish)
  : finish_(std::move(finish)), ended_(std::make_shared<Ended>()), thread_(&ReportThread::loop, this)
{
}

ReportThread::~ReportThread()
{
  stop();
}

void ReportThread::stop()
{
  {
    std::lock_guard<std::mutex> lock(ended_->mutex);
    ended_->closed = true;
    ended_->changed.notify_all();
  }
  if (thread_.joinable())
  {
    thread_.join();
  }
}

TaskRequest ReportThread::requestOf(const EntryPtr& entry) const
{
  TaskRequest request = std::move(entry->intake.request);
  // What has ended is held by the queue alone: its memory is free once it is given up. A plain capture of entry would be
  // const, and copied into the queue.
  request.done = [task = entry, ended = ended_](const TaskResult& result) mutable
  {
    std::lock_guard<std::mutex> lock(ended->mutex);
    if (ended->closed)
    {
      task->handle = TaskHandle();  // which refers to this function, which refers to the entry
      return;
    }
    ended->queue.emplace_back(std::move(task), result);
    ended->changed.notify_one();
  };
  return request;
}

void ReportThread::loop()
{
  pthread_setname_np(pthread_self(), "pi_reports");
  std::unique_lock<std::mutex> lock(ended_->mutex);
  for (;;)
  {
    ended_->changed.wait(lock, [this] { return ended_->closed || !ended_->queue.empty(); });
    if (ended_->queue.empty())
    {
      return;
    }
    auto [entry, result] = std::move(ended_->queue.front());
    ended_->queue.pop_front();
    lock.unlock();
    TaskReportPtr report = makeReport(entry, std::move(result));
    finish_(std::move(entry), std::move(report));
    lock.lock();
  }
}

}  // namespace pi_runtime
