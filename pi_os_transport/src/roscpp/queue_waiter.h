#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <vector>

#include "roscpp/runtime.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// A link that a thread can serve while it waits for callbacks.
class QueueSource
{
public:
  virtual ~QueueSource() = default;
  /// Delivers what is due; `doorbell` is rung for the next message. Any thread.
  virtual void serve(Doorbell doorbell) = 0;
};

/// Lets a thread that waits for callbacks also wait for shared memory.
///
/// In roscpp, the network thread takes messages and wakes a thread in CallbackQueue::callAvailable or callOne. Here,
/// one waiting thread per queue, the leader, is woken by the publisher itself: it takes the message and runs the
/// callback, which saves a thread switch. The leader waits for the doorbells of the queue's links and for callbacks
/// that other threads add. While it runs callbacks, the network thread takes the messages, so a long callback delays
/// nothing.
///
/// Thread safe.
class QueueWaiter
{
public:
  /// The waiter of `queue`; made by the first call.
  static std::shared_ptr<QueueWaiter> of(ros::CallbackQueue* queue);
  /// Like of(), but null if there is none.
  static std::shared_ptr<QueueWaiter> find(const ros::CallbackQueue* queue);

  QueueWaiter();

  /// @param doorbell  the link's SPINNER doorbell; must stay open until remove().
  void add(const std::shared_ptr<QueueSource>& link, int doorbell);
  void remove(const std::shared_ptr<QueueSource>& link, int doorbell);

  /// Waits until `queue` has callbacks or the time is up.
  /// @return false if the caller has to wait in roscpp: there is a leader already, or there are no links.
  bool wait(ros::CallbackQueue* queue, ros::WallDuration timeout);
  /// The queue has changed: wakes a sleeping leader.
  void notify();

private:
  struct Lead;

  void serveAll(Doorbell doorbell);

  FileDescriptor epoll_;
  FileDescriptor changed_;
  std::atomic<bool> led_{false};       ///< a thread is in wait()
  std::atomic<bool> sleeping_{false};  ///< the leader wants notify() for added callbacks
  std::mutex mutex_;
  std::vector<std::shared_ptr<QueueSource>> links_;
  std::vector<std::shared_ptr<QueueSource>> serving_;  ///< the leader's copy of links_
};

}  // namespace pi_os_transport
