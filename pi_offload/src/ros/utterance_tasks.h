#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_speech/RecognizeUtterance.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>

#include "client/offload_client.h"
#include "ros/coordinator_ros_options.h"
#include "ros/task_ledger.h"

namespace pi_offload
{

/// Serves recognize_utterance: each call is a task, and is answered by a node or handed back to the recogniser.
///
/// Every call ends by its deadline. A call runs on a thread of its own.
class UtteranceTasks
{
public:
  /// Advertises the service; calls are served from start() on. @param options, client, ledger, warnings  outlive this.
  UtteranceTasks(ros::NodeHandle node, const CoordinatorRosOptions* options, OffloadClient* client, TaskLedger* ledger,
                 pi_node::WarningBoard* warnings);
  void start();
  /// Ends the calls under way with handled=false. The client must still run.
  void stop();

  // On the engine thread:

  void runLocal(const Task& task);
  /// @param reply  the node's answer; null: the recogniser does the task itself.
  void deliver(const Outcome& outcome, const OffloadReply* reply);

private:
  using Service = pi_speech::RecognizeUtterance;
  /// `done` and `response` are guarded by mutex_.
  struct Call
  {
    std_msgs::Header header;
    bool done = false;
    Service::Response response;
  };

  bool recognize(Service::Request& request, Service::Response& response);
  void submit(const std::shared_ptr<Call>& call, const std::shared_ptr<TaskData>& data, int64_t began_ns,
              double deadline_s, int64_t now_ns);
  void answer(uint64_t task, const OffloadReply* reply, const std::string& node);

  const CoordinatorRosOptions* const options_;
  OffloadClient* const client_;
  TaskLedger* const ledger_;
  pi_node::WarningBoard* const warnings_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;  ///< guarded by mutex_
  std::atomic<int> calls_running_{0};
  std::map<uint64_t, std::shared_ptr<Call>> calls_;  ///< of the engine thread
  ros::CallbackQueue queue_;
  ros::ServiceServer server_;
  ros::AsyncSpinner threads_;
};

}  // namespace pi_offload
