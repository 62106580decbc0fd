#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "event_loop/event_loop.h"
#include "master/http_server.h"
#include "master/network_address.h"
#include "master/node_calls.h"
#include "master/rpc_methods.h"
#include "rosout/log_publisher.h"
#include "rosout/log_subscriber.h"
#include "rosout/rotating_file.h"

namespace pi_os_transport
{

/// The node /rosout: receives the log of all nodes on /rosout, publishes it on /rosout_agg, and writes it to a file.
/// Its slave API gets publishers from the master. Must outlive the loop's run.
class RosoutNode
{
public:
  static const std::string NAME;
  static const std::string SUBSCRIBED;
  static const std::string PUBLISHED;

  /// What the node needs from its process.
  struct Environment
  {
    NetworkAddress network;
    std::string master_uri;
    NodeCalls* calls = nullptr;          ///< must outlive the node
    RotatingFile* file = nullptr;        ///< null: no file; must outlive the node
    std::function<bool()> omits_topics;  ///< true: the file omits the topics of nodes
  };

  /// @throws std::runtime_error if no port is free
  RosoutNode(EventLoop* loop, Environment environment);
  RosoutNode(const RosoutNode&) = delete;
  RosoutNode& operator=(const RosoutNode&) = delete;

  /// URI of the slave API.
  std::string uri() const;

private:
  void addMethods();
  RpcValue answerTopicRequest(const RpcValue& topic, const RpcValue& protocols) const;
  void onMessage(std::string_view message);
  void setPublishers(const RpcValue& apis);

  Environment environment_;
  RpcMethods methods_;
  LogPublisher publisher_;
  LogSubscriber subscriber_;
  HttpServer server_;
};

}  // namespace pi_os_transport
