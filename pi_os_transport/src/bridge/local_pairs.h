#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bridge/bridge_request.h"
#include "event_loop/event_loop.h"
#include "shm/process_pair.h"

namespace pi_os_transport
{

/// A link of the bridge to a process of this device: calls functions.
class LocalLink : public PairLink
{
public:
  std::function<void(const Packet& packet, SideChannel::Descriptors* descriptors)> on_packet;
  std::function<void()> on_pair_ended;
  std::function<void()> on_news;

  void onPacket(const Packet& packet, SideChannel::Descriptors* descriptors) override
  {
    on_packet(packet, descriptors);
  }
  void onPairEnded() override { on_pair_ended(); }
  void serve() override
  {
    if (on_news)
    {
      on_news();
    }
  }
};

/// The connections of a bridge to the processes of its device, see ProcessPair.
class LocalPairs
{
public:
  using Request = std::function<void(const std::shared_ptr<ProcessPair>& pair, const BridgeRequest& request)>;

  /// @param on_link  a process asks for a link from another device
  LocalPairs(EventLoop* loop, Request on_link, std::function<void(const std::string&)> log);
  ~LocalPairs();

  /// A process has connected to this bridge.
  void accept(SideChannel channel);
  /// The connection to the process behind a socket, made if there is none. @return null if it cannot be reached
  std::shared_ptr<ProcessPair> with(const std::string& socket_token);
  /// Tells all processes about segments of this bridge that are not used any more.
  void retire(const std::vector<uint32_t>& segments);

private:
  std::shared_ptr<ProcessPair> add(SideChannel channel, const std::string& socket_token);
  void receive(const std::shared_ptr<ProcessPair>& pair);
  void remove(const std::shared_ptr<ProcessPair>& pair);

  EventLoop* const loop_;
  const std::function<void(const std::string&)> log_;
  std::shared_ptr<const ProcessPair::Host> host_;
  bool warned_ = false;
  struct Known
  {
    std::shared_ptr<ProcessPair> pair;
    std::string socket_token;  ///< of the process; empty until it has introduced itself
  };
  std::vector<Known> pairs_;
};

}  // namespace pi_os_transport
