#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bridge/bridge_request.h"
#include "event_loop/event_loop.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

/// Accepts processes of this device, reads what each asks for, and passes the request on.
class LocalRequests
{
public:
  /// What a request leads to. PING is answered here.
  struct Handlers
  {
    std::function<void(SideChannel channel)> accept_pair;  ///< a ProcessPair, with its first packet unread
    std::function<void(SideChannel channel, const BridgeRequest& request)> open_tunnel;
    std::function<std::string()> status;  ///< as JSON
    std::function<void(const std::string&)> log;
  };

  LocalRequests(EventLoop* loop, Handlers handlers) : loop_(loop), handlers_(std::move(handlers)) {}
  ~LocalRequests();

  /// @param name  of the bridge. @throws std::runtime_error if the name is taken
  void listen(const std::string& name);
  /// Begins to accept.
  void start();
  /// Accepts no more.
  void stop();

private:
  void accept();
  void onRequest(const std::shared_ptr<SideChannel>& client);
  void handle(SideChannel channel, const std::vector<uint8_t>& packet);
  void answerStatus(SideChannel* channel) const;

  EventLoop* const loop_;
  const Handlers handlers_;
  SideChannel listener_;
  Timer accept_again_;  ///< runs while there are no descriptors to accept with
  bool warned_ = false;
  std::map<int, std::shared_ptr<SideChannel>> clients_;  ///< connected, without a request yet; by descriptor
};

}  // namespace pi_os_transport
