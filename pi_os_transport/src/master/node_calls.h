#pragma once

#include <functional>
#include <memory>
#include <string>

#include "master/rpc_decoder.h"

namespace pi_os_transport
{

/// A call of a method of a node's slave API.
struct NodeCall
{
  /// The answer; nullptr if there was none. Called at most once, never from inside call().
  using Done = std::function<void(const RpcResponse* response)>;

  std::shared_ptr<const std::string> body;  ///< XML; shared where the same call goes to many nodes
  std::string subject;                      ///< a newer call of the same subject makes this one needless; "": of none
  Done done;                                ///< may be empty
};

/// Where calls of nodes are handed in. Those to one node are made one after the other, in their order.
class NodeCalls
{
public:
  virtual ~NodeCalls() = default;
  /// Returns at once. @param api  URI of the node.
  virtual void call(const std::string& api, NodeCall call) = 0;
};

}  // namespace pi_os_transport
