#pragma once

#include <functional>
#include <memory>
#include <string>

#include "master/rpc_decoder.h"

namespace pi_os_transport
{

/// A call of a node's slave API.
struct NodeCall
{
  /// Gets the answer, or null if there was none. Called at most once, after call() has returned.
  using Done = std::function<void(const RpcResponse* response)>;

  std::shared_ptr<const std::string> body;  ///< XML; shared if many nodes get the same call
  std::string subject;                      ///< a newer call of the same subject replaces this one; "": none
  Done done;                                ///< may be empty
};

/// Makes calls of nodes. Calls of the same node are made one after the other, in order.
class NodeCalls
{
public:
  virtual ~NodeCalls() = default;
  /// Returns at once. @param api  URI of the node.
  virtual void call(const std::string& api, NodeCall call) = 0;
};

}  // namespace pi_os_transport
