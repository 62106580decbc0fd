// Replaces the functions of roscpp that send a latched message and that give it to new subscribers. Compiled without
// access control, like roscpp_hooks.cpp.

#include <ros/publication.h>
#include <ros/publisher.h>

#include <mutex>

#include "roscpp/hooks.h"
#include "roscpp/runtime.h"

namespace pi_os_transport
{
namespace
{

/// Held while a latched message is sent and remembered, and while a subscriber of a latched topic is added and gets the
/// remembered one. So a subscriber is there before the message is sent, or after it is remembered: it gets the message
/// once. roscpp remembers it after sending, and a subscriber that comes in between gets nothing.
///
/// One for all topics, and recursive, like roscpp's advertised_topics_mutex_: then a serialiser or callback queue of
/// the user's own that publishes again cannot lock two of them in two orders.
class LatchLock
{
public:
  explicit LatchLock(bool latched)
  {
    const Runtime& runtime = Runtime::instance();
    if (latched && runtime.active() && runtime.options.enable)
    {
      lock_ = std::unique_lock<std::recursive_mutex>(mutex());
    }
  }

private:
  static std::recursive_mutex& mutex()
  {
    static auto* mutex = new std::recursive_mutex;  // never destroyed: static destructors may publish
    return *mutex;
  }

  std::unique_lock<std::recursive_mutex> lock_;
};

void publish(const ros::Publisher* self, const boost::function<ros::SerializedMessage()>& serialize_message,
             ros::SerializedMessage& message)
{
  const LatchLock lock(self->impl_ && self->impl_->latch_);
  Runtime::instance().original.publisher_publish(self, serialize_message, message);
}

void addSubscriberLink(ros::Publication* self, const ros::SubscriberLinkPtr& link)
{
  const LatchLock lock(self->isLatching());
  Runtime::instance().original.add_subscriber_link(self, link);
}

}  // namespace

void attachLatchHooks(PiOsShim* shim)
{
  Originals& original = Runtime::instance().original;
  takeOver(shim, PI_OS_PUBLISHER_PUBLISH, &original.publisher_publish, publish);
  takeOver(shim, PI_OS_PUBLICATION_ADD_LINK, &original.add_subscriber_link, addSubscriberLink);
}

}  // namespace pi_os_transport
