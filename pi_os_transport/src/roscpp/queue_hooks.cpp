// Replaces functions of roscpp's callback queue: threads that wait for callbacks also wait for shared memory.

#include "roscpp/hooks.h"

#include <cstdint>
#include <memory>
#include <type_traits>

#include "roscpp/queue_waiter.h"
#include "roscpp/runtime.h"

namespace pi_os_transport
{
namespace
{

static_assert(sizeof(ros::WallDuration) == sizeof(uint64_t) && std::is_trivially_copyable<ros::WallDuration>::value,
              "the hooks pass a WallDuration as one register");

void addCallback(ros::CallbackQueue* self, const ros::CallbackInterfacePtr& callback, uint64_t removal_id)
{
  Runtime::instance().original.add_callback(self, callback, removal_id);
  if (const std::shared_ptr<QueueWaiter> waiter = QueueWaiter::find(self))
  {
    waiter->notify();
  }
}

/// @return the time that roscpp's function may still wait
ros::WallDuration waitForCallbacks(ros::CallbackQueue* queue, ros::WallDuration timeout)
{
  const std::shared_ptr<QueueWaiter> waiter =
      Runtime::instance().active() && !timeout.isZero() ? QueueWaiter::find(queue) : nullptr;
  return waiter && waiter->wait(queue, timeout) ? ros::WallDuration() : timeout;
}

void callAvailable(ros::CallbackQueue* self, ros::WallDuration timeout)
{
  Runtime::instance().original.call_available(self, waitForCallbacks(self, timeout));
}

ros::CallbackQueue::CallOneResult callOne(ros::CallbackQueue* self, ros::WallDuration timeout)
{
  return Runtime::instance().original.call_one(self, waitForCallbacks(self, timeout));
}

void disable(ros::CallbackQueue* self)
{
  Runtime::instance().original.disable(self);
  if (const std::shared_ptr<QueueWaiter> waiter = QueueWaiter::find(self))
  {
    waiter->notify();
  }
}

}  // namespace

void attachQueueHooks(PiOsShim* shim)
{
  Originals& original = Runtime::instance().original;
  takeOver(shim, PI_OS_QUEUE_ADD_CALLBACK, &original.add_callback, addCallback);
  takeOver(shim, PI_OS_QUEUE_CALL_AVAILABLE, &original.call_available, callAvailable);
  takeOver(shim, PI_OS_QUEUE_CALL_ONE, &original.call_one, callOne);
  takeOver(shim, PI_OS_QUEUE_DISABLE, &original.disable, disable);
}

}  // namespace pi_os_transport
