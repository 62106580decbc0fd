// libpi_os_transport_roscpp.so: what stands in for the hooked functions of roscpp. This file is compiled without access
// control, since the hooks are members of roscpp's classes in all but name.

#include <dlfcn.h>
#include <ros/console.h>
#include <ros/param.h>
#include <ros/publication.h>
#include <ros/subscription.h>
#include <ros/this_node.h>
#include <ros/transport/transport.h>

#include <climits>
#include <cstdlib>
#include <cstring>

#include "header_offer.h"
#include "held_leases.h"
#include "outbox_writer.h"
#include "queue_waiter.h"
#include "receive_link.h"
#include "roscpp_version.h"
#include "runtime.h"
#include "service_hooks.h"
#include "transmit_link.h"

namespace pi_os_transport
{
namespace
{

/// Descriptor::serial of what this thread is publishing; 0 if a message goes to single links.
thread_local uint64_t publish_serial = 0;

void* allocateFromPool(size_t bytes)
{
  return Runtime::instance().pool().allocate(bytes);
}

/// Lets the serialisation that runs during its life allocate its buffer in the pool.
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

void loadParameters(Options* options)
{
  std::vector<std::string> errors;
  for (const std::string& group : {std::string("/pi_os"), ros::this_node::getName() + "/pi_os"})
  {
    XmlRpc::XmlRpcValue values;
    if (!ros::param::get(group, values) || values.getType() != XmlRpc::XmlRpcValue::TypeStruct)
    {
      continue;
    }
    options->load(
        [&values](const std::string& name) -> std::optional<std::string>
        {
          if (!values.hasMember(name))
          {
            return std::nullopt;
          }
          XmlRpc::XmlRpcValue& value = values[name];
          switch (value.getType())
          {
            case XmlRpc::XmlRpcValue::TypeString:
              return static_cast<std::string>(value);
            case XmlRpc::XmlRpcValue::TypeInt:
              return std::to_string(static_cast<int>(value));
            case XmlRpc::XmlRpcValue::TypeBoolean:
              return static_cast<bool>(value) ? "1" : "0";
            default:
              return value.toXml();
          }
        },
        [&group](const std::string& name) { return group + "/" + name; }, &errors);
  }
  options->loadEnvironment(&errors);
  for (const std::string& error : errors)
  {
    ROS_ERROR("pi_os_transport: %s", error.c_str());
  }
}

void start(ros::TopicManager* self)
{
  Runtime& runtime = Runtime::instance();
  runtime.original.start(self);
  if (runtime.active())
  {
    static std::once_flag once;
    std::call_once(once,
                   [&runtime]()
                   {
                     loadParameters(&runtime.options);
                     runtime.listen();
                   });
  }
}

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

/// TopicManager::publish, with two differences: the buffer may lie in the pool, and the message is handed to all links
/// by the calling thread instead of waking the network thread for it. advertised_topics_mutex_ is not held while the
/// message is serialised and handed out, so large messages of one topic do not hold up small ones of another.
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
    boost::mutex::scoped_lock lock(publication->subscriber_links_mutex_);
    for (const ros::SubscriberLinkPtr& link : publication->subscriber_links_)
    {
      if (link->isIntraprocess())
      {
        link->enqueueMessage(message, false, true);
      }
    }
    message.message.reset();
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

void writeHeader(ros::Connection* self, const ros::M_string& fields, const ros::WriteFinishedFunc& written)
{
  Runtime& runtime = Runtime::instance();
  ros::M_string extended = fields;
  runtime.original.write_header(self, OfferScope::extend(&extended) ? extended : fields, written);
}

bool handleHeader(ros::TransportSubscriberLink* self, const ros::Header& header)
{
  Runtime& runtime = Runtime::instance();
  ros::Header& fields = const_cast<ros::Header&>(header);
  std::string topic;
  std::string version;
  if (!runtime.active() || !fields.getValue(HEADER_FIELD, version) || version != std::to_string(PROTOCOL_VERSION) ||
      !fields.getValue("topic", topic) || !runtime.options.carries(topic))
  {
    return runtime.original.handle_header(self, header);
  }
  const auto link = std::make_shared<TransmitLink>(
      topic, boost::static_pointer_cast<ros::TransportSubscriberLink>(self->shared_from_this()), self->connection_);
  const std::string offer = runtime.expect(
      link->token(),
      [weak = std::weak_ptr<TransmitLink>(link)](SideChannel channel, const Packet& hello, Runtime::Descriptors*)
      {
        if (const std::shared_ptr<TransmitLink> expected = weak.lock())
        {
          expected->meet(std::move(channel), hello.values[2] != 0);
        }
      });
  if (offer.empty())
  {
    return runtime.original.handle_header(self, header);
  }
  ros::Connection* const connection = self->connection_.get();
  runtime.transmit_links.insert(connection, link);
  connection->addDropListener(
      [link, connection](const ros::ConnectionPtr&, ros::Connection::DropReason)
      {
        Runtime::instance().transmit_links.erase(connection);
        link->disconnect();
      });
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

bool initialize(ros::TransportPublisherLink* self, const ros::ConnectionPtr& connection)
{
  Runtime& runtime = Runtime::instance();
  const ros::SubscriptionPtr subscription = self->parent_.lock();
  if (!runtime.active() || !subscription || !connection->getTransport()->requiresHeader() ||
      !runtime.options.carries(subscription->getName()))
  {
    return runtime.original.initialize(self, connection);
  }
  const auto link = std::make_shared<ReceiveLink>(
      boost::static_pointer_cast<ros::TransportPublisherLink>(self->shared_from_this()), connection);
  ros::Connection* const key = connection.get();
  runtime.receive_links.insert(key, link);
  // Before roscpp's own listener: what the publisher left in the ring is delivered while the link still stands.
  connection->addDropListener(
      [link, key](const ros::ConnectionPtr&, ros::Connection::DropReason reason)
      {
        Runtime::instance().receive_links.erase(key);
        link->disconnect(reason == ros::Connection::TransportDisconnect);
      });
  OfferScope scope(std::to_string(PROTOCOL_VERSION));
  return runtime.original.initialize(self, connection);
}

bool headerReceived(ros::TransportPublisherLink* self, const ros::ConnectionPtr& connection, const ros::Header& header)
{
  Runtime& runtime = Runtime::instance();
  std::string offer;
  ros::Header& fields = const_cast<ros::Header&>(header);
  const bool offered = fields.getValue(HEADER_FIELD, offer);
  if (offered)
  {
    fields.getValues()->erase(HEADER_FIELD);  // users and bags see the header that TCPROS would have given them
  }
  const bool accepted = runtime.original.header_received(self, connection, header);
  const std::shared_ptr<ReceiveLink> link =
      accepted && offered && runtime.active() ? runtime.receive_links.find(connection.get()) : nullptr;
  if (link)
  {
    link->meet(offer);
  }
  return accepted;
}

void handleMessage(ros::TransportPublisherLink* self, const ros::SerializedMessage& message, bool serialized,
                   bool no_copy)
{
  Runtime& runtime = Runtime::instance();
  const auto deliver = [&]() { runtime.original.handle_message(self, message, serialized, no_copy); };
  const std::shared_ptr<ReceiveLink> link = runtime.receive_links.find(self->getConnection().get());
  if (link)
  {
    link->deliverTcp(deliver);
  }
  else
  {
    deliver();
  }
}

std::string publisherTransportType(ros::TransportPublisherLink* self)
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<ReceiveLink> link = runtime.receive_links.find(self->getConnection().get());
  return link && link->active() ? link->transportName() : runtime.original.publisher_transport_type(self);
}

std::string publisherTransportInfo(ros::TransportPublisherLink* self)
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<ReceiveLink> link = runtime.receive_links.find(self->getConnection().get());
  const std::string tcp = runtime.original.publisher_transport_info(self);
  return link && link->active() ? link->info() + " beside " + tcp : tcp;
}

void addCallback(ros::CallbackQueue* self, const ros::CallbackInterfacePtr& callback, uint64_t removal_id)
{
  Runtime::instance().original.add_callback(self, callback, removal_id);
  if (const std::shared_ptr<QueueWaiter> waiter = QueueWaiter::find(self))
  {
    waiter->notify();
  }
}

/// @return what is left to wait for roscpp's own part of the call.
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

/// True if `path` is the libroscpp that this file was compiled for: private members are reached through its headers.
bool isKnownRoscpp(const char* path)
{
  char resolved[PATH_MAX];
  if (realpath(path, resolved) == nullptr)
  {
    return false;
  }
  const char* slash = std::strrchr(resolved, '/');
  return std::strcmp(slash != nullptr ? slash + 1 : resolved, ROSCPP_FILE_NAME) == 0;
}

static_assert(sizeof(ros::WallDuration) == sizeof(uint64_t) && std::is_trivially_copyable<ros::WallDuration>::value,
              "the hooks pass a WallDuration as one register");

int attach(PiOsShim* shim)
{
  if (shim->version != PI_OS_SHIM_VERSION)
  {
    ROS_WARN(
        "pi_os_transport: libpi_os_transport.so and libpi_os_transport_roscpp.so are of different builds; topics of "
        "this node stay on TCPROS. Install both from one build");
    return 1;
  }
  if (!isKnownRoscpp(shim->roscpp_path))
  {
    ROS_WARN(
        "pi_os_transport: this node runs with %s, but the library was built for %s; topics of this node stay on "
        "TCPROS. Build pi_os_transport against the installed roscpp",
        shim->roscpp_path, ROSCPP_FILE_NAME);
    return 1;
  }
  Runtime& runtime = Runtime::instance();
  runtime.shim = shim;
  Originals& original = runtime.original;
  shim->zero_copy = &HeldLeases::api();
  takeOver(shim, PI_OS_TOPIC_MANAGER_START, &original.start, start);
  takeOver(shim, PI_OS_TOPIC_MANAGER_PUBLISH, &original.publish, publish);
  takeOver(shim, PI_OS_CONNECTION_WRITE_HEADER, &original.write_header, writeHeader);
  takeOver(shim, PI_OS_SUBSCRIBER_HANDLE_HEADER, &original.handle_header, handleHeader);
  takeOver(shim, PI_OS_SUBSCRIBER_ENQUEUE_MESSAGE, &original.enqueue_message, enqueueMessage);
  takeOver(shim, PI_OS_SUBSCRIBER_TRANSPORT_TYPE, &original.subscriber_transport_type, subscriberTransportType);
  takeOver(shim, PI_OS_SUBSCRIBER_TRANSPORT_INFO, &original.subscriber_transport_info, subscriberTransportInfo);
  takeOver(shim, PI_OS_PUBLISHER_INITIALIZE, &original.initialize, initialize);
  takeOver(shim, PI_OS_PUBLISHER_HEADER_RECEIVED, &original.header_received, headerReceived);
  takeOver(shim, PI_OS_PUBLISHER_HANDLE_MESSAGE, &original.handle_message, handleMessage);
  takeOver(shim, PI_OS_PUBLISHER_TRANSPORT_TYPE, &original.publisher_transport_type, publisherTransportType);
  takeOver(shim, PI_OS_PUBLISHER_TRANSPORT_INFO, &original.publisher_transport_info, publisherTransportInfo);
  takeOver(shim, PI_OS_QUEUE_ADD_CALLBACK, &original.add_callback, addCallback);
  takeOver(shim, PI_OS_QUEUE_CALL_AVAILABLE, &original.call_available, callAvailable);
  takeOver(shim, PI_OS_QUEUE_CALL_ONE, &original.call_one, callOne);
  takeOver(shim, PI_OS_QUEUE_DISABLE, &original.disable, disable);
  attachServiceHooks(shim);
  return 0;
}

}  // namespace
}  // namespace pi_os_transport

extern "C" __attribute__((visibility("default"))) int pi_os_transport_attach(PiOsShim* shim)
{
  return pi_os_transport::attach(shim);
}
