#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "wire/sp_socket.h"
#include "wire/wire_message.h"

namespace pi_offload
{

/// One connection to each node. Used on one thread, which also gets all events in their order.
class NodeLinks
{
public:
  struct Options
  {
    SpRequester::Options link;  ///< without the address
    double unanswered_s = 1.0;  ///< without any answer for longer, the connection is renewed
  };
  struct Callbacks
  {
    std::function<void(const std::string& node, const OffloadReply& reply, int64_t received_ns)> reply;
    std::function<void(const std::string& node, bool up, const std::string& reason)> link;
    std::function<void(const std::string& node, const std::string& problem)> damaged;  ///< a reply that cannot be read
    /// Runs a function on the thread that uses this object. Called from any thread.
    std::function<void(std::function<void()>)> post;
  };
  NodeLinks(const Options& options, Callbacks callbacks);
  ~NodeLinks();  ///< Closes all connections. Events that are still posted do nothing.
  NodeLinks(const NodeLinks&) = delete;
  NodeLinks& operator=(const NodeLinks&) = delete;

  /// Connects to the address if it is a new one. @throws std::invalid_argument for the address.
  void set(const std::string& node, const std::string& address);
  void remove(const std::string& node);
  bool connected(const std::string& node) const;
  /// @return false if it is not connected or too much waits; then nothing is sent.
  bool send(const std::string& node, const OffloadRequest& request, int64_t now_ns);

private:
  struct Link
  {
    std::string address;
    bool up = false;
    int64_t unanswered_since_ns = 0;  ///< 0: no request is unanswered
    std::unique_ptr<SpRequester> requester;
  };
  /// Shared with posted events, which may outlive this object.
  struct Shared;

  const Options options_;
  const Callbacks callbacks_;
  const std::shared_ptr<Shared> shared_;
  std::map<std::string, std::shared_ptr<Link>> links_;
};

}  // namespace pi_offload
