#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <vector>

#include "shm/file_descriptor.h"
#include "roscpp/runtime.h"

namespace pi_os_transport
{

/// What a thread that waits for callbacks can serve meanwhile.
class QueueSource
{
public:
  virtual ~QueueSource() = default;
  /// Hands over what is due, and has `doorbell` rung for what comes next. Any thread.
  virtual void serve(Doorbell doorbell) = 0;
};

/// Lets a thread that waits for callbacks wait for shared memory as well.
///
/// roscpp's network thread takes messages and wakes a thread in CallbackQueue::callAvailable or callOne through a
/// condition variable. While such a thread waits with nothing to do, it may as well be woken by the publisher itself,
/// take the message and run its callback: one change of threads less. One thread per queue does so, the leader; it
/// waits for the doorbells of the queue's links and for callbacks that others add. As soon as it has something to run,
/// the network thread is responsible again, so a long callback holds nothing up.
///
/// All methods may be called from any thread.
class QueueWaiter
{
public:
  /// The waiter of `queue`, made at the first call.
  static std::shared_ptr<QueueWaiter> of(ros::CallbackQueue* queue);
  /// As of(), but null if there is none.
  static std::shared_ptr<QueueWaiter> find(const ros::CallbackQueue* queue);

  QueueWaiter();

  /// @param doorbell  the link's SPINNER doorbell; must stay open until remove().
  void add(const std::shared_ptr<QueueSource>& link, int doorbell);
  void remove(const std::shared_ptr<QueueSource>& link, int doorbell);

  /// Waits until `queue` has callbacks or the time is up.
  /// @return false if the caller has to wait as roscpp does: there is a leader already, or nothing to wait for here.
  bool wait(ros::CallbackQueue* queue, ros::WallDuration timeout);
  /// The queue has changed: a leader that sleeps looks again.
  void notify();

private:
  struct Lead;

  void serveAll(Doorbell doorbell);

  FileDescriptor epoll_;
  FileDescriptor changed_;
  std::atomic<bool> led_{false};       ///< a thread is in wait()
  std::atomic<bool> sleeping_{false};  ///< it wants to hear of added callbacks
  std::mutex mutex_;
  std::vector<std::shared_ptr<QueueSource>> links_;
  std::vector<std::shared_ptr<QueueSource>> serving_;  ///< the leader's copy of links_
};

}  // namespace pi_os_transport
