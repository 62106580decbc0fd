#pragma once

#include <pi_node/ros/recent_values.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <std_msgs/Header.h>

#include <array>
#include <atomic>
#include <cstdint>

#include "engine/offload_engine.h"

namespace pi_offload
{

/// Numbers the coordinator's tasks, publishes on ~decisions how each one ended, and keeps the latest response times.
class TaskLedger
{
public:
  /// @param speech_local_s  time that the vehicle's recogniser needs for an utterance [s].
  TaskLedger(ros::NodeHandle private_node, double speech_local_s);

  uint64_t newTask() { return next_task_++; }  ///< Any thread.

  // On the engine thread:

  /// @param header  of the picture or utterance. @param dropped  no result was published.
  void publish(const Outcome& outcome, const std_msgs::Header& header, bool dropped);
  /// Quantile of the latest response times [s]. @param part  0 to 1.
  double responseTime(TaskKind kind, double part) const
  {
    return response_s_[static_cast<size_t>(kind)].quantile(part);
  }

private:
  const double speech_local_s_;
  std::atomic<uint64_t> next_task_{1};
  ros::Publisher decisions_;
  std::array<pi_node::RecentValues, TASK_KINDS> response_s_;
};

}  // namespace pi_offload
