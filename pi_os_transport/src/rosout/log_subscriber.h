#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>

#include "event_loop/event_loop.h"
#include "master/host_resolver.h"
#include "master/node_calls.h"
#include "master/rpc_value.h"
#include "rosout/tcpros_header.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Subscribes to a topic of rosgraph_msgs/Log over TCPROS, with one connection to each publisher. Reconnects while the
/// master lists the publisher. Must outlive the loop's run.
class LogSubscriber
{
public:
  /// @param message  serialised
  using Received = std::function<void(std::string_view message)>;

  /// @param calls  for requestTopic() of publishers; must outlive this object.
  LogSubscriber(EventLoop* loop, NodeCalls* calls, std::string node, std::string topic, Received received);
  ~LogSubscriber();
  LogSubscriber(const LogSubscriber&) = delete;
  LogSubscriber& operator=(const LogSubscriber&) = delete;

  /// Sets the current publishers; connections to others are closed. @param apis  URIs of their slave APIs
  void setPublishers(const std::set<std::string>& apis);
  /// The entries of getBusInfo() and getBusStats() for this subscription.
  RpcValue::Array busInfo() const;
  RpcValue busStats() const;

private:
  struct Publisher
  {
    int32_t id = 0;
    std::string api;
    FileDescriptor socket;
    bool is_connected = false;  ///< headers were exchanged
    std::string out;            ///< rest of the header to send
    TcprosReader reader{0};
    int failures = 0;  ///< since the last connection
    Timer timer;
    double bytes = 0;
    int32_t messages = 0;
  };
  using PublisherPtr = std::shared_ptr<Publisher>;

  void ask(const PublisherPtr& publisher);
  void onAnswer(const PublisherPtr& publisher, const RpcResponse* response);
  void connect(const PublisherPtr& publisher, const SocketAddress& address);
  void onReady(const PublisherPtr& publisher, uint32_t events);
  void introduce(const PublisherPtr& publisher);
  void receive(const PublisherPtr& publisher);
  bool takeParts(const PublisherPtr& publisher);
  void tryAgain(const PublisherPtr& publisher);
  void close(const PublisherPtr& publisher);

  EventLoop* loop_;
  NodeCalls* calls_;
  HostResolver resolver_;
  std::string node_;
  std::string topic_;
  Received received_;
  std::map<std::string, PublisherPtr> publishers_;
  int32_t next_id_ = 0;
};

}  // namespace pi_os_transport
