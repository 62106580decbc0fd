#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <mutex>
#include <string>

#include "units/unit_table.h"

namespace pi_runtime
{

/// Decides between the processes of one device whose task runs next on a computing unit (a GPU, a set of CPU cores).
///
/// At most one UnitArbiter of those opened with the same key holds the unit. A free unit goes to whoever asks; a unit
/// that others wait for is handed by release() to the waiter with the earliest deadline, then the highest priority,
/// then the longest wait. It is never taken away: a holder with a long task looks at contended() between slices.
///
/// The table lies in a file of the user in a folder that should be memory (/dev/shm), see UnitTableFile. A waiter looks
/// every CHECK_INTERVAL whether the holder still lives; a unit whose holder was killed goes to the next.
///
/// All methods may be called from any thread. A forked child has no part in the unit: its copy of the object throws
/// std::logic_error when used, and neither its life nor its end has any effect on the unit.
class UnitArbiter
{
public:
  static constexpr int64_t NO_DEADLINE = std::numeric_limits<int64_t>::max();
  static constexpr int64_t NO_BUDGET = std::numeric_limits<int64_t>::max();
  static constexpr std::chrono::milliseconds CHECK_INTERVAL{50};

  /// @param key     identity of the unit, the same text in every process; not empty.
  /// @param folder  where the table lies.
  /// @throws std::runtime_error and others as UnitTableFile. The caller can go on without arbitration.
  explicit UnitArbiter(const std::string& key, const std::string& folder = "/dev/shm");
  /// Releases the unit if it is held. No acquire() may be waiting.
  ~UnitArbiter();
  UnitArbiter(const UnitArbiter&) = delete;
  UnitArbiter& operator=(const UnitArbiter&) = delete;

  /// Takes the unit if it is free. One compare-exchange, no system call. A unit whose holder was killed counts as taken
  /// until somebody calls acquire().
  /// @return false if it is taken, by this object or another, or somebody waits for it.
  bool tryAcquire();

  /// Takes the unit, waiting for it if necessary. One thread at a time; tryAcquire() in another thread is allowed.
  /// @param deadline_ns  when the task has to be done; the clock is the callers' choice, but the same in all processes.
  /// @param priority     higher goes first among equal deadlines.
  /// @return false if the unit did not come within `timeout`, or the wait was cancelled.
  /// @throws std::logic_error if another thread already waits in this object.
  bool acquire(int64_t deadline_ns, int priority, std::chrono::nanoseconds timeout);

  /// Changes what the waiting acquire() asked for. @return false, without effect, if none waits.
  bool updateWaiting(int64_t deadline_ns, int priority);

  /// Makes the waiting acquire() return false, or, if none waits, the next one: a cancellation that comes just before
  /// the wait is not lost. If the unit came at the same moment, acquire() returns true and the cancellation is spent.
  void cancelWait();

  /// Gives the unit to the best waiter, or frees it; then it is one compare-exchange without a system call.
  /// @throws std::logic_error if this object does not hold the unit.
  void release();

  bool held() const;
  /// True if another process waits. One load if nobody does. A waiter that was killed counts until the next release().
  bool contended() const;
  /// Number of other processes that wait, killed ones included until the next release().
  size_t waiters() const;
  /// Earliest deadline of the other processes that wait and live; NO_DEADLINE if there is none.
  int64_t nextDeadline() const;

  /// Tells the others the longest task without a deadline that this process can stand on the unit [ns].
  void setBlockingBudget(int64_t budget_ns);
  /// The smallest budget of the other living processes [ns]; NO_BUDGET if none has set one.
  int64_t blockingBudget() const;

  const std::string& path() const { return file_.path(); }

private:
  UnitTable::Place& ownPlace() const { return file_.table().place[file_.ownPlace()]; }
  int bestWaiter(size_t* waiters) const;
  bool tryHandOver(uint64_t seen);
  bool enterQueue();
  bool waitForUnit(std::chrono::steady_clock::time_point until);
  bool withdraw();
  bool takeIfGranted(uint64_t seen);
  void stopWaiting();

  UnitTableFile file_;
  std::mutex mutex_;      ///< guards waiting_
  bool waiting_ = false;  ///< a thread is in acquire()
  std::atomic<bool> cancelled_{false};
};

}  // namespace pi_runtime
