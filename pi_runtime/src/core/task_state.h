#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <pi_runtime/etc_table.h>
#include <pi_runtime/task.h>

namespace pi_runtime
{

struct GraphState;
struct Unit;

constexpr int64_t NO_DEADLINE_NS = std::numeric_limits<int64_t>::max();

/// The end of a time that begins at start_ns; NO_DEADLINE_NS if it never ends.
inline int64_t timeAfter(int64_t start_ns, std::chrono::nanoseconds time)
{
  return time.count() < NO_DEADLINE_NS - start_ns ? start_ns + time.count() : NO_DEADLINE_NS;
}

/// A codelet's row of the ETC table, and the columns where it cannot run.
struct CodeletRecord
{
  CodeletPtr codelet;
  EtcTable::Row* row = nullptr;
  struct Column
  {
    bool blocked = false;   ///< its program does not build there
    bool warm = false;      ///< has run there in this process
    bool on_trial = false;  ///< tryOut() is due or under way
    TaskResult reason;      ///< outcome, code and message if blocked
  };
  std::vector<Column> columns;

  Column& at(EtcTable::Column column)
  {
    if (columns.size() <= column)
    {
      columns.resize(column + 1);
    }
    return columns[column];
  }
};

/// A task from submission to its end. Fields without a note are guarded by the lock of RuntimeCore.
struct TaskState : std::enable_shared_from_this<TaskState>
{
  enum class Phase : uint8_t
  {
    NEW,      ///< not placed yet: has predecessors, or is being planned
    QUEUED,   ///< in the queue of unit
    RUNNING,  ///< handed to unit
    ENDED,
  };
  static constexpr int ANY_EXECUTOR = -1;

  // Constant after submission.
  uint64_t id = 0;
  TaskRequest request;
  int bucket = 0;
  int64_t submitted_ns = 0;
  int64_t deadline_ns = NO_DEADLINE_NS;
  bool calibration = false;
  CodeletRecord* record = nullptr;
  std::weak_ptr<class RuntimeCore> core;

  std::atomic<bool> cancelled{false};
  std::atomic<uint32_t> ended{0};    ///< futex of those who wait; result is constant once it is 1
  std::atomic<uint32_t> waiters{0};  ///< threads that may sleep on it

  Phase phase = Phase::NEW;
  std::shared_ptr<TaskState> self;  ///< keeps it alive until it has ended
  /// Key in a queue: the deadline, or a later time if its stream used more than admitted.
  int64_t urgency_ns = NO_DEADLINE_NS;
  uint64_t sequence = 0;   ///< order among equal keys in a queue; 0: none yet
  bool executing = false;  ///< an executor runs it, even if it counts as hanging
  bool moved = false;      ///< its slices ran on several units
  Unit* unit = nullptr;
  int pinned_executor = ANY_EXECUTOR;  ///< index in the unit, of calibration runs
  int executor = 0;                    ///< index in the unit
  double run_s = 0.0;                  ///< prediction for the whole task on its unit; 0 if nothing is known
  double expected_s = 0.0;             ///< for planning: time of the rest of it, transfers included
  bool measured = false;               ///< run_s comes from runs on this unit
  uint64_t next = 0;                   ///< where the next slice begins
  uint64_t slice_end = 0;              ///< where the running one ends
  int64_t queued_ns = 0;               ///< when it waited only for a unit
  int64_t started_ns = 0;              ///< of the running slice
  int64_t run_ns = 0;                  ///< of all slices so far, without transfers
  TaskResult result;

  std::shared_ptr<GraphState> graph;  ///< null if it has none, and after its successors were told of its end
  uint32_t node = 0;

  bool realTime() const { return deadline_ns != NO_DEADLINE_NS; }
  uint64_t left() const { return request.range - next; }
};

/// A graph under way.
struct GraphState
{
  std::vector<std::shared_ptr<TaskState>> tasks;
  std::vector<std::vector<uint32_t>> successors;
  std::vector<uint32_t> waiting_for;  ///< per node: predecessors, and its level's barrier, that are still to come
  std::vector<Unit*> planned;         ///< per node
  // Only with the barrier of InnerCorePolicy::LEVELS.
  std::vector<std::vector<uint32_t>> levels;
  std::vector<uint32_t> level_of;
  std::vector<uint32_t> level_left;  ///< nodes of a level that have not ended
  std::vector<uint32_t> unsettled;   ///< nodes that have ended, whose successors do not know yet
  bool settling = false;
};

/// Order in which a unit takes tasks: deadlines first, then priorities, then as planned; FIFO: as submitted.
struct TaskOrder
{
  bool fifo = false;
  bool operator()(const TaskState* a, const TaskState* b) const
  {
    if (!fifo && a->urgency_ns != b->urgency_ns)
    {
      return a->urgency_ns < b->urgency_ns;
    }
    if (!fifo && a->request.priority != b->request.priority)
    {
      return a->request.priority > b->request.priority;
    }
    return a->sequence < b->sequence;
  }
};

}  // namespace pi_runtime
