#pragma once

#include <pi_runtime/CancelTask.h>
#include <pi_runtime/DropBuffer.h>
#include <pi_runtime/GetStatistics.h>
#include <pi_runtime/QueryTask.h>
#include <pi_runtime/SubmitGraph.h>
#include <pi_runtime/SubmitTask.h>
#include <pi_runtime/runtime.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include "core/codelet_registry.h"
#include "core/kept_buffers.h"
#include "ros/remote_tasks.h"
#include "ros/runtime_diagnostics.h"
#include "ros/runtime_ros_options.h"
#include "ros/runtime_services.h"

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <vector>

namespace pi_runtime
{

/// The runtime of this process as ROS services, topics and diagnostics.
///
/// It uses Runtime::shared(), so that nodelets of the same manager, which use it too, and callers from elsewhere share
/// one scheduler. If it is there already its own options for the runtime have no effect. All callbacks run on threads
/// of this object, as many as may wait in SubmitTask and SubmitGraph and two more.
class RuntimeRos
{
public:
  /// Starts serving. @throws std::invalid_argument for wrong parameters, std::runtime_error if there is no unit.
  RuntimeRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Ends calls that wait, and cancels the tasks that came through this object.
  ~RuntimeRos();
  RuntimeRos(const RuntimeRos&) = delete;
  RuntimeRos& operator=(const RuntimeRos&) = delete;

private:
  void advertiseServices();
  void onTask(const TaskConstPtr& task);
  void publishStatus();

  bool submitTask(SubmitTask::Request& request, SubmitTask::Response& response);
  bool submitGraph(SubmitGraph::Request& request, SubmitGraph::Response& response);
  bool queryTask(QueryTask::Request& request, QueryTask::Response& response);
  bool cancelTask(CancelTask::Request& request, CancelTask::Response& response);
  bool getStatistics(GetStatistics::Request& request, GetStatistics::Response& response);
  bool dropBuffer(DropBuffer::Request& request, DropBuffer::Response& response);

  /// Waits for the entries as a call asked for. @return what is to be said of it; empty if they have ended.
  std::string waitFor(const std::vector<RemoteTasks::EntryPtr>& entries, std::chrono::nanoseconds timeout);

  ros::CallbackQueue queue_;  ///< of all handles below
  ros::NodeHandle node_;
  ros::NodeHandle private_node_;
  const RuntimeRosOptions options_;
  CodeletRegistry& codelets_;
  const std::shared_ptr<Runtime> runtime_;
  KeptBuffers buffers_;
  std::unique_ptr<RemoteTasks> tasks_;
  RuntimeDiagnostics diagnostics_;
  std::atomic<int> waiting_calls_{0};
  ros::Publisher results_;
  ros::Publisher status_;
  ros::Subscriber tasks_subscriber_;
  std::vector<ros::ServiceServer> services_;
  std::unique_ptr<RuntimeServices> runtime_services_;
  ros::WallTimer diagnostics_timer_;
  ros::AsyncSpinner spinner_;
};

}  // namespace pi_runtime
