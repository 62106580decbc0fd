#pragma once

#include "engine/node.h"

#include <array>
#include <cstdint>
#include <unordered_map>

namespace pi_offload
{

/// How long tasks take on the vehicle, and how long one that comes now waits there. Tasks of one kind are taken to run
/// one after the other. How much those of the other kind are in the way (one processor for both, or one each) is
/// learned from what tasks waited. Not thread safe.
class LocalModel
{
public:
  /// @param first_s  time of a task at the highest frequency, until one was measured.
  /// @param highest_ghz  to which times are related.
  LocalModel(const std::array<double, TASK_KINDS>& first_s, double highest_ghz);

  bool running(uint64_t task) const { return runs_.count(task) != 0; }
  size_t running() const { return runs_.size(); }
  /// @param frequency_ghz  above zero.
  void start(uint64_t task, TaskKind kind, double frequency_ghz, int64_t now_ns);
  /// @param work_s  time on the processor. A task that does not run is ignored.
  void done(uint64_t task, double work_s, int64_t now_ns);
  /// It ended without being measured.
  void drop(uint64_t task, int64_t now_ns);
  /// Drops runs that were started before.
  void dropOlder(int64_t started_ns, int64_t now_ns);

  bool measured(TaskKind kind) const { return times_[index(kind)].measured; }
  /// At the highest frequency [s].
  double seconds(TaskKind kind) const { return times_[index(kind)].mean_s; }
  double deviation(TaskKind kind) const { return times_[index(kind)].deviation_s; }
  /// Until a task that comes now can begin [s].
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
    double same_s = 0.0;   ///< expected wait for its own kind
    double other_s = 0.0;  ///< for the other kinds, were they all in the way
  };
  struct Queue
  {
    size_t count = 0;
    double expected_s = 0.0;  ///< of all in it
    int64_t begun_ns = 0;     ///< when the first of it was taken up
  };

  static size_t index(TaskKind kind) { return static_cast<size_t>(kind); }
  double waiting(size_t kind, int64_t now_ns) const;
  double waitingOthers(size_t kind, int64_t now_ns) const;
  void leave(const Run& run, int64_t now_ns);

  double highest_ghz_;
  std::array<Time, TASK_KINDS> times_;
  std::array<Queue, TASK_KINDS> queues_;
  std::unordered_map<uint64_t, Run> runs_;
  double shared_ = 0.5;  ///< part of the other kinds' time that a task waits
};

}  // namespace pi_offload
