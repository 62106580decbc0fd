// Replaces the functions of roscpp that publish, accept subscribers and queue messages. Compiled without access
// control, like roscpp_hooks.cpp.

#include "roscpp/hooks.h"

#include <ros/publication.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "event_loop/if_alive.h"
#include "roscpp/bridge_client.h"
#include "roscpp/runtime.h"
#include "roscpp/topics/header_offer.h"
#include "roscpp/topics/outbox_writer.h"
#include "roscpp/topics/transmit_link.h"
#include "shm/topic_mark.h"

namespace pi_os_transport
{
namespace
{

/// Descriptor::serial of the message that this thread publishes; 0 for a message to a single link.
thread_local uint64_t publish_serial = 0;

void* allocateFromPool(size_t bytes)
{
  return Runtime::instance().pool().allocate(bytes);
}

/// While this object lives, serialisation allocates its buffer in the pool.
class PoolCapture
{
public:
  explicit PoolCapture(bool wanted) : wanted_(wanted)
  {
    if (wanted_)
    {
      Runtime::instance().shim->set_capture(allocateFromPool);
    }
  }
  ~PoolCapture()
  {
    if (wanted_)
    {
      Runtime::instance().shim->set_capture(nullptr);
    }
  }
  PoolCapture(const PoolCapture&) = delete;
  PoolCapture& operator=(const PoolCapture&) = delete;

private:
  const bool wanted_;
};

bool anyActiveLink(ros::Publication* publication)
{
  Runtime& runtime = Runtime::instance();
  if (runtime.active_transmit_links == 0)
  {
    return false;
  }
  boost::mutex::scoped_lock lock(publication->subscriber_links_mutex_);
  for (const ros::SubscriberLinkPtr& link : publication->subscriber_links_)
  {
    const auto* transport = dynamic_cast<const ros::TransportSubscriberLink*>(link.get());
    const std::shared_ptr<TransmitLink> state =
        transport != nullptr ? runtime.transmit_links.find(transport->connection_.get()) : nullptr;
    if (state && state->active())
    {
      return true;
    }
  }
  return false;
}

/// Passes the message as a pointer to the subscribers in this process.
void deliverInProcess(ros::Publication* publication, ros::SerializedMessage* message)
{
  boost::mutex::scoped_lock lock(publication->subscriber_links_mutex_);
  for (const ros::SubscriberLinkPtr& link : publication->subscriber_links_)
  {
    if (link->isIntraprocess())
    {
      link->enqueueMessage(*message, false, true);
    }
  }
  message->message.reset();
}

/// Replaces TopicManager::publish with three differences: the buffer may be in the pool, the calling thread itself
/// passes the message to all links, and advertised_topics_mutex_ is not held meanwhile, so that large messages of one
/// topic do not delay small ones of another.
void publish(ros::TopicManager* self, const std::string& topic,
             const boost::function<ros::SerializedMessage()>& serialize_message, ros::SerializedMessage& message)
{
  Runtime& runtime = Runtime::instance();
  if (!runtime.active() || !runtime.options.enable)
  {
    runtime.original.publish(self, topic, serialize_message, message);
    return;
  }
  ros::PublicationPtr publication;
  {
    boost::recursive_mutex::scoped_lock lock(self->advertised_topics_mutex_);
    if (self->isShuttingDown())
    {
      return;
    }
    publication = self->lookupPublicationWithoutLock(topic);
  }
  if (!publication)
  {
    return;
  }
  if (!publication->hasSubscribers() && !publication->isLatching())
  {
    publication->incrementSequence();
    return;
  }
  bool no_copy = false;
  bool serialize = false;
  if (message.type_info != nullptr && message.message)
  {
    publication->getPublishTypes(serialize, no_copy, *message.type_info);
  }
  else
  {
    serialize = true;
  }
  if (!no_copy)
  {
    message.message.reset();
    message.type_info = nullptr;
  }
  if (serialize || publication->isLatching())
  {
    PoolCapture capture(anyActiveLink(publication.get()));
    const ros::SerializedMessage serialized = serialize_message();
    message.buf = serialized.buf;
    message.num_bytes = serialized.num_bytes;
    message.message_start = serialized.message_start;
  }
  if (message.message)
  {
    deliverInProcess(publication.get(), &message);
  }
  if (message.buf)
  {
    static std::atomic<uint64_t> last_serial{0};
    publish_serial = ++last_serial;
    publication->enqueueMessage(message);
    publish_serial = 0;
    OutboxWriter::flush();
  }
  if (runtime.active_transmit_links != 0)
  {
    runtime.announceRetired();
  }
}

bool handleHeader(ros::TransportSubscriberLink* self, const ros::Header& header)
{
  Runtime& runtime = Runtime::instance();
  ros::Header& fields = const_cast<ros::Header&>(header);
  std::string topic;
  std::string version;
  const bool required = BridgeClient::isRequiredFor(self->connection_);
  const auto refuse = [&]
  {
    fields.getValue("topic", topic);
    BridgeClient::instance().warnOfRequired(
        topic, "a subscriber of " + topic +
                   " on another device is refused, because no bridge can carry it: its node "
                   "needs the library, and PI_OS_INCLUDE and PI_OS_EXCLUDE must not except the topic");
    self->connection_->sendHeaderError("the publisher sends to other devices through bridges only");
    return false;
  };
  if (!runtime.active() || !fields.getValue(HEADER_FIELD, version) || version != std::to_string(PROTOCOL_VERSION) ||
      !fields.getValue("topic", topic) || !runtime.options.carries(topic))
  {
    return required ? refuse() : runtime.original.handle_header(self, header);
  }
  const auto link = std::make_shared<TransmitLink>(
      topic, boost::static_pointer_cast<ros::TransportSubscriberLink>(self->shared_from_this()), self->connection_);
  const std::string offer = runtime.expect(
      link->token(),
      ifAlive(link,
              [topic](const auto& expected, const std::shared_ptr<ProcessPair>& pair, const Packet& hello)
              {
                const uint64_t mark = hello.values[2];  // 0: not a bridge
                if (mark == 0 || mark == topicMark(expected->token(), topic))
                {
                  expected->meet(pair, hello);
                }
                else
                {
                  pair->send(Packet::ended(hello.link, LinkEnd::REFUSED));
                }
              }));
  if (offer.empty())
  {
    return required ? refuse() : runtime.original.handle_header(self, header);
  }
  if (required)
  {
    link->requireBridge();
  }
  runtime.transmit_links.hold(self->connection_, link, [link](ros::Connection::DropReason) { link->disconnect(); });
  OfferScope scope(offer);
  return runtime.original.handle_header(self, header);
}

void enqueueMessage(ros::TransportSubscriberLink* self, const ros::SerializedMessage& message, bool serialized,
                    bool no_copy)
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<TransmitLink> link =
      runtime.active() && serialized ? runtime.transmit_links.find(self->connection_.get()) : nullptr;
  if (link)
  {
    link->enqueue(self, message, publish_serial);
  }
  else if (publish_serial != 0 && serialized)
  {
    OutboxWriter::enqueue(self, message);
  }
  else
  {
    runtime.original.enqueue_message(self, message, serialized, no_copy);
  }
}

std::string subscriberTransportType(ros::TransportSubscriberLink* self)
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<TransmitLink> link = runtime.transmit_links.find(self->connection_.get());
  return link && link->active() ? link->transportName() : runtime.original.subscriber_transport_type(self);
}

std::string subscriberTransportInfo(ros::TransportSubscriberLink* self)
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<TransmitLink> link = runtime.transmit_links.find(self->connection_.get());
  const std::string tcp = runtime.original.subscriber_transport_info(self);
  return link && link->active() ? link->info() + " beside " + tcp : tcp;
}

}  // namespace

void attachTransmitHooks(PiOsShim* shim)
{
  Originals& original = Runtime::instance().original;
  takeOver(shim, PI_OS_TOPIC_MANAGER_PUBLISH, &original.publish, publish);
  takeOver(shim, PI_OS_SUBSCRIBER_HANDLE_HEADER, &original.handle_header, handleHeader);
  takeOver(shim, PI_OS_SUBSCRIBER_ENQUEUE_MESSAGE, &original.enqueue_message, enqueueMessage);
  takeOver(shim, PI_OS_SUBSCRIBER_TRANSPORT_TYPE, &original.subscriber_transport_type, subscriberTransportType);
  takeOver(shim, PI_OS_SUBSCRIBER_TRANSPORT_INFO, &original.subscriber_transport_info, subscriberTransportInfo);
}

}  // namespace pi_os_transport
