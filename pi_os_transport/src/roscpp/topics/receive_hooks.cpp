// Replaces the functions of roscpp that connect to publishers and receive messages. Compiled without access control,
// like roscpp_hooks.cpp.

#include "roscpp/hooks.h"

#include <ros/subscription.h>
#include <ros/transport/transport.h>

#include <memory>
#include <string>

#include "roscpp/bridge_client.h"
#include "roscpp/runtime.h"
#include "roscpp/topics/header_offer.h"
#include "roscpp/topics/receive_link.h"

namespace pi_os_transport
{
namespace
{

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
  // Before roscpp's own listener: the rest of the ring is delivered while the link still exists.
  runtime.receive_links.hold(connection, link,
                             [link](ros::Connection::DropReason) { link->disconnect(link->isWanted()); });
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
    fields.getValues()->erase(HEADER_FIELD);  // users and bags see the same header as with TCPROS
  }
  if (!offered && BridgeClient::isRequiredFor(connection))
  {
    const ros::SubscriptionPtr subscription = self->parent_.lock();
    const std::string topic = subscription ? subscription->getName() : "";
    BridgeClient::instance().warnOfRequired(
        topic, "a publisher of " + topic +
                   " on another device is refused, because no bridge can carry it: its node needs "
                   "the library, and PI_OS_INCLUDE and PI_OS_EXCLUDE must not except the topic");
    self->drop();
    return false;
  }
  // The publisher is back: what it sends now comes behind nothing that is still under way from its old connection.
  if (const std::shared_ptr<ReceiveLink> before = runtime.ending_receive_links.find(self))
  {
    before->disconnect(false);
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
  const std::shared_ptr<ReceiveLink> link = runtime.receive_links.find(self->getConnection().get());
  if (link && BridgeClient::isRequiredFor(self->getConnection()))
  {
    const std::string& node = self->getConnection()->getCallerId();
    BridgeClient::instance().warnOfRequired(
        node, "messages of " + node + " on another device come unprotected and are dropped: set it for that node too");
    link->deliverTcp(nullptr, message);
  }
  else if (link)
  {
    link->deliverTcp(self, message);
  }
  else
  {
    runtime.original.handle_message(self, message, serialized, no_copy);
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

}  // namespace

void attachReceiveHooks(PiOsShim* shim)
{
  Originals& original = Runtime::instance().original;
  takeOver(shim, PI_OS_PUBLISHER_INITIALIZE, &original.initialize, initialize);
  takeOver(shim, PI_OS_PUBLISHER_HEADER_RECEIVED, &original.header_received, headerReceived);
  takeOver(shim, PI_OS_PUBLISHER_HANDLE_MESSAGE, &original.handle_message, handleMessage);
  takeOver(shim, PI_OS_PUBLISHER_TRANSPORT_TYPE, &original.publisher_transport_type, publisherTransportType);
  takeOver(shim, PI_OS_PUBLISHER_TRANSPORT_INFO, &original.publisher_transport_info, publisherTransportInfo);
}

}  // namespace pi_os_transport
