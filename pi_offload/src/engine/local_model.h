#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>

#include "engine/node.h"

namespace pi_offload
{

/// Estimates how long tasks take on the vehicle and how long a new task waits there.
///
/// Tasks of one kind run one after the other. How much the other kind delays them is learned: it depends on whether
/// both share a processor. Not thread safe.
class LocalModel
{
public:
  /// @param first_s      time of a task at the highest frequency until one is measured [s].
  /// @param highest_ghz  highest frequency of the computer.
  LocalModel(const std::array<double, TASK_KINDS>& first_s, double highest_ghz);

  bool running(uint64_t task) const { return runs_.count(task) != 0; }
  size_t running() const { return runs_.size(); }
  /// @param frequency_ghz  above zero.
  void start(uint64_t task, TaskKind kind, double frequency_ghz, int64_t now_ns);
  /// Ignores a task that does not run. @param work_s  time on the processor [s].
  void done(uint64_t task, double work_s, int64_t now_ns);
  /// The task ended without a measurement.
  void drop(uint64_t task, int64_t now_ns);
  /// Drops runs that started before `started_ns`.
  void dropOlder(int64_t started_ns, int64_t now_ns);

  bool measured(TaskKind kind) const { return times_[index(kind)].measured; }
  /// Mean time at the highest frequency [s].
  double seconds(TaskKind kind) const { return times_[index(kind)].mean_s; }
  double deviation(TaskKind kind) const { return times_[index(kind)].deviation_s; }
  /// Wait of a task that comes now [s].
  double backlog(TaskKind kind, int64_t now_ns) const;

private:
  struct Time
  {
    bool measured = false;
    double mean_s = 0.0;
    double deviation_s = 0.0;  ///< mean absolute deviation
  };
  struct Run
  {
    TaskKind kind = TaskKind::DETECTION;
    int64_t started_ns = 0;
    double expected_s = 0.0;
    double frequency_ghz = 0.0;
    double same_s = 0.0;   ///< expected wait for tasks of its kind
    double other_s = 0.0;  ///< the same for other kinds, if all of them delayed it
  };
  struct Queue
  {
    size_t count = 0;
    double expected_s = 0.0;  ///< of all its tasks
    int64_t begun_ns = 0;     ///< when its first task began
  };

  static size_t index(TaskKind kind) { return static_cast<size_t>(kind); }
  double waiting(size_t kind, int64_t now_ns) const;
  double waitingOthers(size_t kind, int64_t now_ns) const;
  void leave(const Run& run, int64_t now_ns);

  double highest_ghz_;
  std::array<Time, TASK_KINDS> times_;
  std::array<Queue, TASK_KINDS> queues_;
  std::unordered_map<uint64_t, Run> runs_;
  double shared_ = 0.5;  ///< part of the other kinds' time that delays a task
};

}  // namespace pi_offload
