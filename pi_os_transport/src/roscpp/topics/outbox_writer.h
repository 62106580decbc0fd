#pragma once

#include <ros/transport_subscriber_link.h>

#include <vector>

namespace pi_os_transport
{

/// Lets roscpp's network thread write the messages that publish() has put into the outboxes of links on TCPROS.
///
/// TransportTCP::enableWrite() adds the socket to the poll set before it sets its own flag. If a publishing thread is
/// suspended in between, the network thread finds a writable socket without a flag and spins until the publishing
/// thread runs again: milliseconds on busy cores.
///
/// Thread safe.
class OutboxWriter
{
public:
  /// Puts a message into the outbox, like TransportSubscriberLink::enqueueMessage, and calls add().
  static void enqueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message);
  /// Notes that the outbox of `link` has something to write.
  static void add(ros::TransportSubscriberLink* link);
  /// Wakes the network thread for the links that the calling thread has added.
  static void flush();

private:
  using Links = std::vector<boost::weak_ptr<ros::SubscriberLink>>;

  static Links& added();
};

}  // namespace pi_os_transport
