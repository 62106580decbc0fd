#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "event_loop/event_loop.h"
#include "master/http_server.h"
#include "rosout/log_publisher.h"
#include "rosout/log_subscriber.h"
#include "master/network_address.h"
#include "master/node_calls.h"
#include "rosout/rotating_file.h"
#include "master/rpc_methods.h"

namespace pi_os_transport
{

/// The node /rosout: gathers what all nodes log on /rosout, publishes it on /rosout_agg, and writes it to a file. Has
/// the slave API of a node, by which the master tells it of publishers. Has to outlive the loop's run.
class RosoutNode
{
public:
  static const std::string NAME;
  static const std::string SUBSCRIBED;
  static const std::string PUBLISHED;

  /// What it needs of the process that it is part of.
  struct Environment
  {
    NetworkAddress network;
    std::string master_uri;
    NodeCalls* calls = nullptr;          ///< must outlive the node
    RotatingFile* file = nullptr;        ///< no file if nullptr; must outlive the node
    std::function<bool()> omits_topics;  ///< whether the file goes without the topics of each message's node
  };

  /// @throws std::runtime_error if there is no port to be had
  RosoutNode(EventLoop* loop, Environment environment);
  RosoutNode(const RosoutNode&) = delete;
  RosoutNode& operator=(const RosoutNode&) = delete;

  /// URI of the slave API.
  std::string uri() const;

private:
  void addMethods();
  void onMessage(std::string_view message);
  void setPublishers(const RpcValue& apis);

  Environment environment_;
  RpcMethods methods_;
  LogPublisher publisher_;
  LogSubscriber subscriber_;
  HttpServer server_;
};

}  // namespace pi_os_transport
