#include "bridge/bridge_status.h"

#include <nlohmann/json.hpp>

namespace pi_os_transport
{
namespace
{

using Json = nlohmann::ordered_json;

constexpr int STATUS_VERSION = 1;

Json statusOf(const Peer& peer, const std::string& identity)
{
  static const char* const STATES[] = {"connecting", "up", "silent", "hung", "down"};
  const Lane& express = peer.lane(Traffic::EXPRESS);
  const Lane& bulk = peer.lane(Traffic::BULK);
  return {{"address", peer.endpoint().toString()},
          {"name", peer.name()},
          {"identity", identity},
          {"state", STATES[static_cast<size_t>(peer.state())]},
          {"rtt_us", bulk.rtt().count()},
          {"window", bulk.window()},
          {"sent_bytes", express.sentBytes() + bulk.sentBytes()},
          {"received_bytes", peer.receivedBytes()}};
}

Json statusOf(const OutgoingStream& stream, const std::string& peer)
{
  const StreamCounters& counters = stream.counters();
  return {{"topic", stream.topic()},
          {"publisher", stream.publisher()},
          {"peer", peer},
          {"subscribers", stream.links().size()},
          {"messages", counters.messages},
          {"bytes", counters.bytes},
          {"superseded", counters.superseded},
          {"rate_limited", counters.rate_limited},
          {"uncompressed", counters.uncompressed},
          {"lost", counters.lost}};
}

Json statusOf(const IncomingLink& link, const std::string& peer)
{
  return {{"topic", link.request.topic},
          {"publisher", link.request.publisher},
          {"subscriber", link.request.subscriber},
          {"peer", peer},
          {"carrying", link.state == IncomingLink::State::CARRYING ? 1 : 0},
          {"messages", link.messages()},
          {"bytes", link.bytes()},
          {"dropped", link.dropped()},
          {"lost", link.lost()},
          {"paused", link.paused ? 1 : 0}};
}

Json statusOf(const Tunnel& tunnel, const std::string& peer)
{
  return {{"target", tunnel.target()},
          {"peer", peer},
          {"state", tunnel.state()},
          {"sent_bytes", tunnel.sentBytes()},
          {"received_bytes", tunnel.receivedBytes()}};
}

}  // namespace

std::string bridgeStatus(const BridgeContext& context, const Sessions& sessions)
{
  Json status{{"version", STATUS_VERSION},
              {"name", context.config.name},
              {"instance", std::to_string(context.instance)},
              {"wire", context.config.wire},
              {"secure", context.config.secure}};
  Json& listen = status["listen"] = Json::array();
  for (const Endpoint& endpoint : context.config.listen)
  {
    const uint16_t port = endpoint.port != 0 ? endpoint.port : context.transport->port();
    listen.push_back(Endpoint{endpoint.address, port}.toString());
  }
  const SlotPool::Usage usage = context.pool->usage();
  status["pool"] = {{"committed", usage.committed}, {"limit", usage.limit}};
  for (size_t reason = 0; reason < Refusals::NAMES.size(); ++reason)
  {
    status["refused"][Refusals::NAMES[reason]] = context.refusals.counter(reason);
  }
  for (const char* const list : {"peers", "outgoing", "incoming", "tunnels"})
  {
    status[list] = Json::array();
  }
  for (const auto& entry : sessions.all())
  {
    const Session& session = *entry.second;
    const std::string address = session.peer->endpoint().toString();
    status["peers"].push_back(statusOf(*session.peer, session.identity));
    const auto append = [&](const char* list, const auto& carried)
    {
      for (const auto& one : carried)
      {
        status[list].push_back(statusOf(*one.second, address));
      }
    };
    append("outgoing", session.outgoing_streams);
    append("incoming", session.incoming);
    append("tunnels", session.tunnels);
  }
  // Names come from other devices: replace invalid UTF-8.
  return status.dump(-1, ' ', true, Json::error_handler_t::replace);
}

}  // namespace pi_os_transport
