#pragma once

#include <pi_runtime/AdmitStream.h>
#include <pi_runtime/CancelTask.h>
#include <pi_runtime/DropBuffer.h>
#include <pi_runtime/GetEtc.h>
#include <pi_runtime/GetPolicy.h>
#include <pi_runtime/GetStatistics.h>
#include <pi_runtime/ListCodelets.h>
#include <pi_runtime/ListStreams.h>
#include <pi_runtime/ListUnits.h>
#include <pi_runtime/QueryTask.h>
#include <pi_runtime/RetireStream.h>
#include <pi_runtime/SaveTrace.h>
#include <pi_runtime/SetEtc.h>
#include <pi_runtime/SetPolicy.h>
#include <pi_runtime/SetUnitAvailable.h>
#include <pi_runtime/SubmitGraph.h>
#include <pi_runtime/SubmitTask.h>
#include "core/codelet_registry.h"
#include "core/kept_buffers.h"
#include "ros/remote_tasks.h"
#include "ros/runtime_diagnostics.h"
#include "ros/runtime_ros_options.h"
#include <pi_runtime/runtime.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

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

  bool listUnits(ListUnits::Request& request, ListUnits::Response& response);
  bool listCodelets(ListCodelets::Request& request, ListCodelets::Response& response);
  bool submitTask(SubmitTask::Request& request, SubmitTask::Response& response);
  bool submitGraph(SubmitGraph::Request& request, SubmitGraph::Response& response);
  bool queryTask(QueryTask::Request& request, QueryTask::Response& response);
  bool cancelTask(CancelTask::Request& request, CancelTask::Response& response);
  bool getEtc(GetEtc::Request& request, GetEtc::Response& response);
  bool setEtc(SetEtc::Request& request, SetEtc::Response& response);
  bool getPolicy(GetPolicy::Request& request, GetPolicy::Response& response);
  bool setPolicy(SetPolicy::Request& request, SetPolicy::Response& response);
  bool admitStream(AdmitStream::Request& request, AdmitStream::Response& response);
  bool retireStream(RetireStream::Request& request, RetireStream::Response& response);
  bool listStreams(ListStreams::Request& request, ListStreams::Response& response);
  bool setUnitAvailable(SetUnitAvailable::Request& request, SetUnitAvailable::Response& response);
  bool getStatistics(GetStatistics::Request& request, GetStatistics::Response& response);
  bool dropBuffer(DropBuffer::Request& request, DropBuffer::Response& response);
  bool saveTrace(SaveTrace::Request& request, SaveTrace::Response& response);

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
  ros::Subscriber tasks_subscriber_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer diagnostics_timer_;
  ros::AsyncSpinner spinner_;
};

}  // namespace pi_runtime
