#pragma once

#include <ros/transport_subscriber_link.h>

#include <mutex>
#include <vector>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Has roscpp's network thread write what publish() has put into the outboxes of links on TCPROS.
///
/// TransportTCP::enableWrite() adds the socket to the poll set before it notes that it waits for it, and expects no
/// other thread in between. Called by a publishing thread, it lets the network thread find a writable socket that
/// nobody waits for and turn in circles until the publishing thread runs again: for milliseconds on busy cores.
///
/// All functions may be called from any thread.
class OutboxWriter
{
public:
  /// Puts a message into the outbox as TransportSubscriberLink::enqueueMessage does, and calls add().
  static void enqueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message);
  /// Notes that the outbox of `link` has something to write.
  static void add(ros::TransportSubscriberLink* link);
  /// Wakes the network thread for all links that the calling thread has added since its last call.
  static void flush();

private:
  using Links = std::vector<boost::weak_ptr<ros::SubscriberLink>>;

  OutboxWriter();
  static OutboxWriter& instance();
  static Links& added();
  void submit(const Links& links);
  void write();

  FileDescriptor doorbell_;
  std::mutex mutex_;
  Links links_;
};

}  // namespace pi_os_transport
