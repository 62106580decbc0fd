#include "bridge/tunnels.h"

#include <utility>

#include "event_loop/socket_io.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MAX_TUNNELS = 256;              ///< per session
constexpr uint64_t MAX_TUNNEL_BYTES = 64 << 20;  ///< of all peers, waiting for processes that do not read [B]
/// Timeout for the other bridge to find and reach the server. Clients wait a little longer (bridge_client.cpp).
constexpr std::chrono::milliseconds CONNECT_TIME{500};

}  // namespace

void Tunnels::open(SideChannel channel, const BridgeRequest& request)
{
  Session* const session =
      isLocalAddress(request.address) || context_->draining ? nullptr : sessions_->ofDevice(request.address);
  if (session == nullptr || !session->peer->up() || !context_->config.trusts(session->identity, request.service) ||
      session->tunnels.size() + session->tunnel_requests.size() >= MAX_TUNNELS)
  {
    channel.send(Packet::ended(0, LinkEnd::REFUSED));
    return;
  }
  const uint32_t id = context_->next_id++ & ~Tunnel::SERVER_BIT;
  const auto waiting = std::make_shared<TunnelRequest>();
  waiting->channel = std::move(channel);
  waiting->wish = request;
  session->tunnel_requests[id | Tunnel::SERVER_BIT] = waiting;
  waiting->deadline.start(context_->loop, CONNECT_TIME,
                          [this, peer = session->peer, id]
                          {
                            peer->control(FrameHeader::of(FrameType::TUNNEL_CLOSE, id, 1), encodeText("too late"));
                            if (Session* const owner = sessions_->of(peer.get()))
                            {
                              refuse(owner, id | Tunnel::SERVER_BIT, "its bridge does not answer");
                            }
                          });
  PayloadWriter payload;
  payload.putString(request.address);
  payload.putString(request.service);
  session->peer->control(FrameHeader::of(FrameType::TUNNEL_OPEN, id, request.port), payload.take());
}

/// The server is connected: the client gets its end.
void Tunnels::onReady(Session* session, uint32_t id)
{
  const auto found = session->tunnel_requests.extract(id);
  if (found.empty())
  {
    return;  // the frame came again after an interruption
  }
  TunnelRequest& request = *found.mapped();
  FileDescriptor ours;
  FileDescriptor theirs;
  if (!makeTcpPair(&theirs, &ours) || !request.channel.send(Packet::of(Packet::OFFER, 0), {theirs.get()}))
  {
    session->peer->control(FrameHeader::of(FrameType::TUNNEL_CLOSE, id & ~Tunnel::SERVER_BIT, 1),
                           encodeText("the client has gone"));
    return;
  }
  add(session, Tunnel::Side::CLIENT, id & ~Tunnel::SERVER_BIT, std::move(ours),
      request.wish.service + " at " + request.wish.address + ":" + std::to_string(request.wish.port));
}

/// The client goes on without the bridge.
void Tunnels::refuse(Session* session, uint32_t id, const std::string& reason)
{
  const auto found = session->tunnel_requests.extract(id);
  if (!found.empty())
  {
    const std::string subject = "no tunnel to " + found.mapped()->wish.service + " at " + found.mapped()->wish.address;
    context_->refusals.warn(subject, subject + ", which goes on over TCPROS: " + reason);
    found.mapped()->channel.send(Packet::ended(0, LinkEnd::REFUSED));
  }
}

bool Tunnels::onFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  if (header.type == FrameType::TUNNEL_OPEN)
  {
    return accept(session, header, payload, length);
  }
  if (header.type == FrameType::TUNNEL_READY)
  {
    onReady(session, header.id);
    return true;
  }
  const auto found = session->tunnels.find(header.id);
  if (found == session->tunnels.end())
  {
    if (header.type == FrameType::TUNNEL_CLOSE)
    {
      session->tunnel_checks.erase(header.id);
      refuse(session, header.id, PayloadReader(payload, length).getString());
    }
    return true;  // or the tunnel has ended here meanwhile
  }
  const std::shared_ptr<Tunnel> tunnel = found->second;
  switch (header.type)
  {
    case FrameType::TUNNEL_DATA:
      if (waitingBytes() + length > MAX_TUNNEL_BYTES)
      {
        tunnel->finish();
        return true;
      }
      return tunnel->onData(header, payload, length);
    case FrameType::TUNNEL_CREDIT:
      return tunnel->onCredit(header);
    case FrameType::TUNNEL_CLOSE:
      tunnel->onClose(header);
      return true;
    default:
      return false;
  }
}

uint64_t Tunnels::waitingBytes() const
{
  uint64_t bytes = 0;
  for (const auto& session : sessions_->all())
  {
    for (const auto& tunnel : session.second->tunnels)
    {
      bytes += tunnel.second->waitingBytes();
    }
  }
  return bytes;
}

bool Tunnels::accept(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  PayloadReader in(payload, length);
  const Endpoint server{in.getString(), static_cast<uint16_t>(header.count)};
  const std::string service = in.restLength() != 0 ? in.getString() : "";  // none from a bridge of an older build
  if (!in.ok() || in.restLength() != 0 || (header.id & Tunnel::SERVER_BIT) != 0 || header.count == 0 ||
      header.count > 65535)
  {
    return false;
  }
  const uint32_t id = header.id;
  if (session->tunnels.count(id) != 0 || !session->tunnel_checks.insert(id).second)
  {
    return true;  // the frame came again after an interruption
  }
  const auto decide = [this, peer = session->peer, id, service, server](std::string refusal)
  {
    Session* const owner = sessions_->of(peer.get());
    if (owner == nullptr || owner->peer != peer || owner->tunnel_checks.erase(id) == 0)
    {
      return;  // no longer wanted
    }
    if (!refusal.empty())
    {
      const std::string from = "a tunnel from " + peer->endpoint().address;
      context_->refusals.count(Refusals::NO_SERVICE, from,
                               from + " to " + server.toString() + " was refused: " + refusal);
    }
    else
    {
      refusal = connectToServer(owner, id, service, server);
    }
    if (!refusal.empty())
    {
      peer->control(FrameHeader::of(FrameType::TUNNEL_CLOSE, id | Tunnel::SERVER_BIT, 1), encodeText(refusal));
    }
  };
  if (session->tunnels.size() + session->tunnel_checks.size() > MAX_TUNNELS || context_->draining)
  {
    session->tunnel_checks.erase(id);
    session->peer->control(FrameHeader::of(FrameType::TUNNEL_CLOSE, id | Tunnel::SERVER_BIT, 1),
                           encodeText("too many tunnels, or the bridge ends"));
    return true;
  }
  if (!isLocalAddress(server.address) || isLoopbackAddress(server.address))
  {
    decide("that is not an address of this device in the network");
    return true;
  }
  if (!context_->config.trusts(session->identity, service))
  {
    decide("\"" + session->identity + "\" may not call " + service + ", see trust");
    return true;
  }
  context_->graph->findService(service, server, decide);
  return true;
}

/// Begins to connect. @return why that is impossible, or ""
std::string Tunnels::connectToServer(Session* session, uint32_t id, const std::string& service, const Endpoint& server)
{
  const sockaddr_in destination = socketAddress(server.address, server.port);
  FileDescriptor socket = beginConnecting(reinterpret_cast<const sockaddr*>(&destination), sizeof(destination));
  if (!socket)
  {
    return server.toString() + " cannot be reached";
  }
  add(session, Tunnel::Side::SERVER, id, std::move(socket), service + " at " + server.toString());
  return {};
}

void Tunnels::add(Session* session, Tunnel::Side side, uint32_t id, FileDescriptor socket, const std::string& target)
{
  // Frames about the tunnel come with the id of the other side.
  const uint32_t key = side == Tunnel::Side::CLIENT ? id | Tunnel::SERVER_BIT : id;
  const auto remove = [this, peer = session->peer, key]()
  {
    if (Session* const owner = sessions_->of(peer.get()))
    {
      owner->tunnels.erase(key);
    }
  };
  const auto tunnel =
      std::make_shared<Tunnel>(context_->loop, session->peer.get(), id, side, std::move(socket), target, remove);
  session->tunnels[key] = tunnel;
  tunnel->start();
}

void Tunnels::abandon(Session* session)
{
  session->tunnel_checks.clear();
  const auto requests = std::exchange(session->tunnel_requests, {});
  for (const auto& request : requests)
  {
    request.second->channel.send(Packet::ended(0, LinkEnd::REFUSED));
  }
  const auto tunnels = std::exchange(session->tunnels, {});
  for (const auto& tunnel : tunnels)
  {
    tunnel.second->finish();
  }
}

}  // namespace pi_os_transport
