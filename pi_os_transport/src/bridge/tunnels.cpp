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

}  // namespace

void Tunnels::open(SideChannel* channel, const BridgeRequest& request)
{
  Session* const session =
      isLocalAddress(request.address) || context_->draining ? nullptr : sessions_->ofDevice(request.address);
  FileDescriptor ours;
  FileDescriptor theirs;
  if (session == nullptr || !session->peer->up() || session->tunnels.size() >= MAX_TUNNELS ||
      !makeTcpPair(&theirs, &ours))
  {
    channel->send(Packet::ended(0, LinkEnd::REFUSED));
    return;
  }
  const uint32_t id = context_->next_id++ & ~Tunnel::SERVER_BIT;
  if (channel->send(Packet::of(Packet::OFFER, 0), {theirs.get()}))
  {
    session->peer->control(FrameHeader::of(FrameType::TUNNEL_OPEN, id, request.port), encodeText(request.address));
    add(session, Tunnel::Side::CLIENT, id, std::move(ours),
        request.service + " at " + request.address + ":" + std::to_string(request.port));
  }
}

bool Tunnels::onFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  if (header.type == FrameType::TUNNEL_OPEN)
  {
    return accept(session, header, payload, length);
  }
  const auto found = session->tunnels.find(header.id);
  if (found == session->tunnels.end())
  {
    return true;  // the tunnel has ended here meanwhile
  }
  const std::shared_ptr<Tunnel> tunnel = found->second;
  switch (header.type)
  {
    case FrameType::TUNNEL_READY:
      return true;
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
  const std::string address = in.getString();
  if (!in.ok() || (header.id & Tunnel::SERVER_BIT) != 0 || header.count == 0 || header.count > 65535)
  {
    return false;
  }
  if (session->tunnels.count(header.id) != 0)
  {
    return true;  // the frame came again after an interruption
  }
  const uint16_t port = static_cast<uint16_t>(header.count);
  const std::string target = address + ":" + std::to_string(port);
  FileDescriptor socket = connectToServer(session, address, port);
  if (!socket)
  {
    session->peer->control(FrameHeader::of(FrameType::TUNNEL_CLOSE, header.id | Tunnel::SERVER_BIT, 1),
                           encodeText(target + " cannot be reached"));
    return true;
  }
  add(session, Tunnel::Side::SERVER, header.id, std::move(socket), target);
  return true;
}

/// Begins to connect. Only to what this device offers to others: a bridge must lead neither into the network behind it
/// nor to programs that listen on the loopback interface alone.
FileDescriptor Tunnels::connectToServer(Session* session, const std::string& address, uint16_t port) const
{
  if (!isLocalAddress(address) || isLoopbackAddress(address) || session->tunnels.size() >= MAX_TUNNELS ||
      context_->draining)
  {
    return FileDescriptor();
  }
  const sockaddr_in destination = socketAddress(address, port);
  return beginConnecting(reinterpret_cast<const sockaddr*>(&destination), sizeof(destination));
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
  const auto tunnels = std::exchange(session->tunnels, {});
  for (const auto& tunnel : tunnels)
  {
    tunnel.second->finish();
  }
}

}  // namespace pi_os_transport
