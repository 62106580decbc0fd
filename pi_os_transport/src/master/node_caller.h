#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <memory>
#include <string>
#include <unordered_map>

#include "event_loop/event_loop.h"
#include "master/host_resolver.h"
#include "master/http_reader.h"
#include "master/network_address.h"
#include "master/node_calls.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{

struct NodeCallerLimits
{
  size_t connections = 256;
  std::chrono::milliseconds connect{10000};  ///< timeout of the TCP connection
  /// Timeout of an answer. Long, so that a node stopped in a debugger gets the waiting call when it continues.
  std::chrono::milliseconds reply{60000};
  std::chrono::milliseconds patience{1000};  ///< timeout of an answer while other nodes wait for a connection
  std::chrono::milliseconds idle{2000};      ///< how long a connection is kept after the last call
};

/// Calls the slave APIs of nodes on a loop: all nodes at the same time, and each node one call after the other over one
/// connection. A hanging or dead node does not delay others. Must outlive the loop's run.
class NodeCaller : public NodeCalls
{
public:
  NodeCaller(EventLoop* loop, const NodeCallerLimits& limits = NodeCallerLimits());
  ~NodeCaller() override;
  NodeCaller(const NodeCaller&) = delete;
  NodeCaller& operator=(const NodeCaller&) = delete;

  void call(const std::string& api, NodeCall call) override;
  /// Nodes with a pending call or an open connection.
  size_t nodes() const { return nodes_.size(); }

private:
  enum class Step
  {
    WAITING,  ///< waits for a free connection
    RESOLVING,
    CONNECTING,
    CALLING,
    IDLE,  ///< connected, without calls
  };
  struct Node
  {
    std::string api;
    HostAndPort at;
    std::list<NodeCall> calls;  ///< the first one is under way
    std::unordered_map<std::string, std::list<NodeCall>::iterator> subjects;
    Step step = Step::WAITING;
    FileDescriptor socket;
    bool is_used = false;  ///< the connection has carried an answer, and may have been closed since
    std::string out;
    size_t sent = 0;
    HttpReader reader{HttpReader::Kind::RESPONSE};
    Timer deadline;
    SteadyTime since;  ///< start of the current step
  };
  using NodePtr = std::shared_ptr<Node>;

  void queue(const NodePtr& node);
  void startSoon();
  void startWaiting();
  bool makeRoom();
  void connect(const NodePtr& node);
  void open(const NodePtr& node, const SocketAddress& address);
  void sendCall(const NodePtr& node);
  void sendRest(const NodePtr& node);
  void onReady(const NodePtr& node, uint32_t events);
  void receive(const NodePtr& node);
  void finish(const NodePtr& node, const RpcResponse* response);
  void next(const NodePtr& node);
  void onBroken(const NodePtr& node);
  void disconnect(const NodePtr& node);
  void forget(const NodePtr& node);
  void allow(const NodePtr& node, std::chrono::milliseconds time);

  EventLoop* loop_;
  NodeCallerLimits limits_;
  HostResolver resolver_;
  std::unordered_map<std::string, NodePtr> nodes_;
  std::deque<NodePtr> waiting_;
  size_t busy_ = 0;  ///< nodes in a step other than WAITING
  Timer look_again_;
  bool is_starting_ = false;
};

}  // namespace pi_os_transport
