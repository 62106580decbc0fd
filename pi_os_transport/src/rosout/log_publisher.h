#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <memory>
#include <string>
#include <string_view>

#include "event_loop/event_loop.h"
#include "master/listener.h"
#include "master/rpc_value.h"
#include "rosout/tcpros_header.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{

// Own TCPROS: Debian's rosout, with libroscpp, takes 11 MB; all of pi_core takes 3.2 MB.

/// Publishes a topic of rosgraph_msgs/Log over TCPROS. A slow subscriber loses its oldest messages. Must outlive the
/// loop's run.
class LogPublisher
{
public:
  /// @param address  numeric, to listen on; any free port is used. @throws std::runtime_error
  LogPublisher(EventLoop* loop, const std::string& address, std::string node, std::string topic);
  ~LogPublisher();
  LogPublisher(const LogPublisher&) = delete;
  LogPublisher& operator=(const LogPublisher&) = delete;

  uint16_t port() const { return listener_.port(); }
  /// @param message  serialised; gets the sequence number of this publisher.
  void publish(std::string_view message);
  /// Closes all connections; subscribers reconnect.
  void disconnectAll();
  /// The entries of getBusInfo() and getBusStats() for this publication.
  RpcValue::Array busInfo() const;
  RpcValue busStats() const;

private:
  using Frame = std::shared_ptr<const std::string>;
  struct Subscriber
  {
    int32_t id = 0;
    FileDescriptor socket;
    std::string node;  ///< "" until its header was received
    TcprosReader reader{0};
    std::deque<Frame> queue;
    size_t queued_bytes = 0;
    size_t sent = 0;  ///< of the first in the queue
    bool closes = false;
    Timer deadline;
    double bytes = 0;
    int32_t messages = 0;
    std::list<std::shared_ptr<Subscriber>>::iterator place;
  };
  using SubscriberPtr = std::shared_ptr<Subscriber>;

  void add(FileDescriptor socket);
  void onReady(const SubscriberPtr& subscriber, uint32_t events);
  void receive(const SubscriberPtr& subscriber);
  void welcome(const SubscriberPtr& subscriber, const TcprosHeader& header);
  void enqueue(const SubscriberPtr& subscriber, const Frame& frame);
  void send(const SubscriberPtr& subscriber);
  void drop(const SubscriberPtr& subscriber);

  EventLoop* loop_;
  std::string node_;
  std::string topic_;
  std::list<SubscriberPtr> subscribers_;
  uint32_t sequence_ = 0;
  int32_t next_id_ = 0;
  Listener listener_;
};

}  // namespace pi_os_transport
