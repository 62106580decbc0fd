#include "ros/runtime_ros.h"
#include "ros/conversions.h"

#include <pi_node/durations.h>
#include <pi_runtime/RuntimeStatus.h>
#include <boost/make_shared.hpp>
#include <utility>

namespace pi_runtime
{
namespace
{

constexpr size_t MEGABYTE = 1024 * 1024;
/// Threads beside those of waiting calls: one for other calls, one for the diagnostics.
constexpr uint32_t SPARE_THREADS = 2;

ros::NodeHandle onQueue(ros::NodeHandle node, ros::CallbackQueue* queue)
{
  node.setCallbackQueue(queue);
  return node;
}

RuntimeRosOptions loadOptions(const ros::NodeHandle& private_node)
{
  std::vector<std::string> unknown;
  RuntimeRosOptions options = RuntimeRosOptions::load(private_node, &unknown);
  for (const std::string& name : unknown)
  {
    ROS_WARN_STREAM_NAMED("runtime", "parameter " << name << " means nothing here; see config/runtime.yaml");
  }
  // The runtime may outlive this object.
  options.runtime.log = [](LogLevel level, const std::string& text)
  {
    if (level == LogLevel::WARNING)
    {
      ROS_WARN_STREAM_NAMED("runtime", text);
    }
    else
    {
      ROS_INFO_STREAM_NAMED("runtime", text);
    }
  };
  return options;
}

RemoteTasks::Limits limitsOf(const RuntimeRosOptions& options)
{
  return {static_cast<size_t>(options.max_tasks), static_cast<size_t>(options.max_task_memory_mb) * MEGABYTE,
          static_cast<size_t>(options.max_kept_reports),
          std::chrono::nanoseconds(pi_node::nanoseconds(options.report_keep_s))};
}

}  // namespace

RuntimeRos::RuntimeRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : node_(onQueue(std::move(node), &queue_))
  , private_node_(onQueue(std::move(private_node), &queue_))
  , options_(loadOptions(private_node_))
  , codelets_(CodeletRegistry::instance())
  , runtime_(Runtime::shared(options_.runtime))
  , buffers_(static_cast<size_t>(options_.max_kept_buffer_mb) * MEGABYTE)
  , tasks_(std::make_unique<RemoteTasks>(runtime_, &codelets_, &buffers_, limitsOf(options_)))
  , diagnostics_(node_, private_node_, runtime_, tasks_.get())
  , spinner_(static_cast<uint32_t>(options_.max_waiting_calls) + SPARE_THREADS, &queue_)
{
  if (options_.runtime.trace_capacity > 0)
  {
    runtime_->trace().keepAtLeast(options_.runtime.trace_capacity);  // another nodelet may have begun the runtime
  }
  const auto queue_size = static_cast<uint32_t>(options_.max_tasks);
  results_ = private_node_.advertise<TaskReport>("results", queue_size);
  status_ = private_node_.advertise<RuntimeStatus>("status", 1);
  tasks_subscriber_ =
      private_node_.subscribe("tasks", queue_size, &RuntimeRos::onTask, this, ros::TransportHints().tcpNoDelay());
  advertiseServices();
  runtime_services_ = std::make_unique<RuntimeServices>(private_node_, runtime_, &codelets_);
  diagnostics_timer_ = node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                             [this](const ros::WallTimerEvent&)
                                             {
                                               tasks_->expire();
                                               diagnostics_.update();
                                               publishStatus();
                                             });
  ROS_INFO_STREAM_NAMED("runtime", "parameters: " << options_.toText());
  for (const UnitStatus& unit : runtime_->units())
  {
    ROS_INFO_STREAM_NAMED("runtime", "unit " << unit.name << ": " << unit.compute_units << " compute units, "
                                             << (unit.device.empty() ? "no OpenCL" : unit.device));
  }
  spinner_.start();
}

RuntimeRos::~RuntimeRos()
{
  tasks_->close();
  spinner_.stop();
  tasks_subscriber_.shutdown();
  services_.clear();
  runtime_services_.reset();
  diagnostics_timer_.stop();
  tasks_.reset();
}

void RuntimeRos::advertiseServices()
{
  const auto advertise = [this](const char* name, auto handler)
  { services_.push_back(private_node_.advertiseService(name, handler, this)); };
  advertise("submit_task", &RuntimeRos::submitTask);
  advertise("submit_graph", &RuntimeRos::submitGraph);
  advertise("query_task", &RuntimeRos::queryTask);
  advertise("cancel_task", &RuntimeRos::cancelTask);
  advertise("get_statistics", &RuntimeRos::getStatistics);
  advertise("drop_buffer", &RuntimeRos::dropBuffer);
}

void RuntimeRos::onTask(const TaskConstPtr& task)
{
  tasks_->run(task, [results = results_](const TaskReportConstPtr& report) { results.publish(report); });
}

void RuntimeRos::publishStatus()
{
  if (status_.getNumSubscribers() == 0)
  {
    return;
  }
  RuntimeStatus status;
  status.stamp = ros::Time::now();
  for (const UnitStatus& unit : runtime_->units())
  {
    status.units.push_back(toMsg(unit));
  }
  for (const StreamStatus& stream : runtime_->streams())
  {
    status.streams.push_back(toMsg(stream));
  }
  status_.publish(status);
}

std::string RuntimeRos::waitFor(const std::vector<RemoteTasks::EntryPtr>& entries, std::chrono::nanoseconds timeout)
{
  std::string problem;
  if (++waiting_calls_ > options_.max_waiting_calls)
  {
    problem = "not waited for: max_waiting_calls = " + std::to_string(options_.max_waiting_calls) +
              " calls wait already; query it later";
  }
  else if (!tasks_->wait(entries, timeout))
  {
    problem = timeout.count() == 0 ? "the runtime node ends" : "not ended within the timeout; query it later";
  }
  --waiting_calls_;
  return problem;
}

bool RuntimeRos::submitTask(SubmitTask::Request& request, SubmitTask::Response& response)
{
  try
  {
    const std::chrono::nanoseconds timeout = toNanoseconds(request.timeout, "timeout");
    // Moved to the heap: the task may outlive the call.
    const RemoteTasks::EntryPtr entry = tasks_->submit(boost::make_shared<Task>(std::move(request.task)));
    response.accepted = true;
    response.id = entry->id;
    if (request.wait)
    {
      response.message = waitFor({entry}, timeout);
      if (const TaskReportConstPtr report = tasks_->handOver({entry}).front())
      {
        response.ended = true;
        response.message.clear();
        response.report = *report;
      }
    }
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  return true;
}

bool RuntimeRos::submitGraph(SubmitGraph::Request& request, SubmitGraph::Response& response)
{
  try
  {
    const std::chrono::nanoseconds timeout = toNanoseconds(request.timeout, "timeout");
    std::vector<TaskConstPtr> tasks;
    for (Task& task : request.tasks)
    {
      tasks.push_back(boost::make_shared<Task>(std::move(task)));
    }
    const std::vector<RemoteTasks::EntryPtr> entries = tasks_->submitGraph(tasks, request.edges);
    response.accepted = true;
    for (const RemoteTasks::EntryPtr& entry : entries)
    {
      response.ids.push_back(entry->id);
    }
    if (request.wait)
    {
      response.message = waitFor(entries, timeout);
      response.ended = response.message.empty();
      if (response.ended)
      {
        for (const TaskReportConstPtr& report : tasks_->handOver(entries))
        {
          response.reports.push_back(*report);
        }
      }
    }
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  return true;
}

bool RuntimeRos::queryTask(QueryTask::Request& request, QueryTask::Response& response)
{
  const RemoteTasks::Answer answer = tasks_->query(request.id);
  response.success = answer.known;
  if (!answer.known)
  {
    response.message = "no task " + std::to_string(request.id) + " is known, or not any more: reports are kept for " +
                       std::to_string(options_.report_keep_s) + " s (report_keep_s), " +
                       std::to_string(options_.max_kept_reports) + " at most (max_kept_reports)";
  }
  response.ended = answer.report != nullptr;
  if (answer.report)
  {
    response.report = *answer.report;
  }
  return true;
}

bool RuntimeRos::cancelTask(CancelTask::Request& request, CancelTask::Response& response)
{
  response.success = tasks_->cancel(request.id);
  if (!response.success)
  {
    response.message = "no task " + std::to_string(request.id) + " is open: it has ended, or never was there";
  }
  return true;
}

bool RuntimeRos::getStatistics(GetStatistics::Request&, GetStatistics::Response& response)
{
  response.statistics = toMsg(runtime_->statistics());
  response.statistics.open_tasks = static_cast<uint32_t>(tasks_->openTasks());
  response.statistics.kept_reports = static_cast<uint32_t>(tasks_->keptReports());
  response.statistics.task_memory_bytes = tasks_->memoryBytes();
  response.statistics.kept_buffers = buffers_.names();
  response.statistics.kept_buffer_bytes = buffers_.bytes();
  return true;
}

bool RuntimeRos::dropBuffer(DropBuffer::Request& request, DropBuffer::Response& response)
{
  response.success = buffers_.drop(request.name);
  if (!response.success)
  {
    response.message = "there is no kept buffer \"" + request.name + "\"";
  }
  return true;
}

}  // namespace pi_runtime
