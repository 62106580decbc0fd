#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <mutex>
#include <string>
#include <vector>

#include "units/unit_table.h"

namespace pi_runtime
{

/// Shares a computing unit (a GPU, a set of CPU cores) between the processes of a device.
///
/// At most one UnitArbiter with the same key holds the unit. A free unit goes to the first that asks. release() hands
/// the unit to the waiter with the earliest deadline, then the highest priority, then the longest wait. There is no
/// preemption: a holder with a long task polls contended() between slices.
///
/// The table is a file of the user in a memory folder (/dev/shm), see UnitTableFile. A waiter checks every
/// CHECK_INTERVAL that the holder lives. If the holder was killed, the unit goes to the next waiter.
///
/// All methods may be called from any thread. In a forked child they throw std::logic_error; the child does not affect
/// the unit.
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

  /// Takes the unit if it is free: one compare-exchange, no system call. A unit whose holder was killed counts as taken
  /// until the next acquire(). @return false if it is taken (also by this object), or a process waits for it.
  bool tryAcquire();

  /// Takes the unit, waiting for it if necessary. One thread at a time; tryAcquire() in another thread is allowed.
  /// @param deadline_ns  of the task; all processes must use the same clock.
  /// @param priority     higher goes first among equal deadlines.
  /// @return false if the unit did not come within `timeout`, or the wait was cancelled.
  /// @throws std::logic_error if another thread already waits in this object.
  bool acquire(int64_t deadline_ns, int priority, std::chrono::nanoseconds timeout);

  /// Changes deadline and priority of the waiting acquire(). @return false if none waits.
  bool updateWaiting(int64_t deadline_ns, int priority);

  /// Makes the waiting acquire() return false; if none waits, the next one. If the unit comes at the same moment,
  /// acquire() returns true and the cancellation has no further effect.
  void cancelWait();

  /// Hands the unit to the best waiter, or frees it (one compare-exchange, no system call).
  /// @throws std::logic_error if this object does not hold the unit.
  void release();

  bool held() const;
  /// True if another process waits: one load if none does. A killed waiter counts until the next release().
  bool contended() const;
  /// Number of other processes that wait, killed ones included until the next release().
  size_t waiters() const;
  /// Earliest deadline of the other processes that wait and live; NO_DEADLINE if there is none.
  int64_t nextDeadline() const;

  /// Publishes the streams of this process on the unit, MOST_STREAMS at most. One thread at a time.
  void setStreams(const std::vector<SharedStream>& streams);
  struct OthersStream
  {
    int pid;
    SharedStream stream;
  };
  /// Those of the other living processes.
  std::vector<OthersStream> othersStreams() const;

  /// Publishes the longest task without a deadline that this process tolerates on the unit [ns].
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
