#pragma once

#include "wire/sp_socket.h"
#include "wire/wire_message.h"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

namespace pi_offload
{

/// One connection to each node. Used on one thread, to which all events come too, in their order.
class NodeLinks
{
public:
  struct Options
  {
    SpRequester::Options link;  ///< without the address
    double unanswered_s = 1.0;  ///< of requests without any answer, then the connection is made anew
  };
  struct Callbacks
  {
    std::function<void(const std::string& node, const OffloadReply& reply, int64_t received_ns)> reply;
    std::function<void(const std::string& node, bool up, const std::string& reason)> link;
    std::function<void(const std::string& node, const std::string& problem)> damaged;  ///< a reply that is none
    /// Runs a function on the thread that uses this object; called from any.
    std::function<void(std::function<void()>)> post;
  };
  NodeLinks(const Options& options, Callbacks callbacks);
  ~NodeLinks();  ///< Closes all connections; what was posted afterwards does nothing.
  NodeLinks(const NodeLinks&) = delete;
  NodeLinks& operator=(const NodeLinks&) = delete;

  /// Connects, unless it is connected to this address already. @throws std::invalid_argument for the address.
  void set(const std::string& node, const std::string& address);
  void remove(const std::string& node);
  bool connected(const std::string& node) const;
  /// @return false: not connected, or too much waits; nothing of it is sent then.
  bool send(const std::string& node, const OffloadRequest& request, int64_t now_ns);

private:
  struct Link
  {
    std::string address;
    bool up = false;
    int64_t unanswered_since_ns = 0;  ///< 0: nothing is, or the last was answered
    std::unique_ptr<SpRequester> requester;
  };
  /// Outlives this object in what was posted.
  struct Shared;

  const Options options_;
  const Callbacks callbacks_;
  const std::shared_ptr<Shared> shared_;
  std::map<std::string, std::shared_ptr<Link>> links_;
};

}  // namespace pi_offload
