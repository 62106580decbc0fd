#pragma once

#include <atomic>
#include <cstdint>
#include <memory>

#include "roscpp/runtime.h"

namespace pi_os_transport
{

/// Lets a thread that waits for callbacks also wait for shared memory.
///
/// In roscpp, the network thread takes messages and wakes a thread in CallbackQueue::callAvailable or callOne. Here,
/// one waiting thread per queue, the leader, is woken by the publisher itself: it takes the message and runs the
/// callback, which saves a thread switch. The leader sleeps on its place on the WakeBoard, where publishers and threads
/// of this process that add callbacks wake it. While it runs callbacks, the network thread takes the messages, so a
/// long callback delays nothing.
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
  ~QueueWaiter();

  /// A link of the queue has a ring. @return the Doorbell for it
  uint32_t join();
  void leave();

  /// Waits until `queue` has callbacks or the time is up.
  /// @return false if the caller has to wait in roscpp: there is a leader already, or there are no links.
  bool wait(ros::CallbackQueue* queue, ros::WallDuration timeout);
  /// The queue has changed: wakes a sleeping leader.
  void notify();

private:
  struct Lead;

  const uint32_t doorbell_;  ///< 0: there is no place for another sleeper
  std::atomic<uint32_t> links_{0};
  std::atomic<bool> led_{false};  ///< a thread is in wait()
};

}  // namespace pi_os_transport
