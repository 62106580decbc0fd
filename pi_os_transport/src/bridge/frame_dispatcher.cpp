#include "bridge/frame_dispatcher.h"

#include <algorithm>

#include "wire/ipv4.h"
#include "wire/sp_transport.h"

namespace pi_os_transport
{
namespace
{

constexpr uint32_t MAX_HELLO = 1024;  ///< [B]

}  // namespace

void FrameDispatcher::onConnected(FrameTransport::ConnectionId connection)
{
  if (Session* const session = sessions_->withConnection(connection))
  {
    session->peer->onConnected(connection);
  }
}

void FrameDispatcher::onWritable(FrameTransport::ConnectionId connection)
{
  if (Session* const session = sessions_->withConnection(connection))
  {
    session->peer->pump();
  }
}

void FrameDispatcher::onClosed(FrameTransport::ConnectionId connection, CloseReason reason)
{
  if (Session* const session = sessions_->withConnection(connection))
  {
    session->peer->onClosed(connection, reason);
  }
}

bool FrameDispatcher::onAccept(const std::string& address)
{
  if (context_->config.allows(address))
  {
    return true;
  }
  context_->refusals.count(Refusals::UNKNOWN_PEER, address + " is not allowed to connect");
  return false;
}

Verdict FrameDispatcher::onIdentity(const Endpoint& at, const std::string& identity)
{
  const BridgeConfig& config = context_->config;
  const TrustOptions* const trust = config.trustOf(identity);
  if (trust != nullptr && !trust->allow)
  {
    return {"\"" + identity + "\" is revoked by trust", true};
  }
  if (trust == nullptr && !config.trust.empty())
  {
    return {"\"" + identity + "\" is not in trust", false};
  }
  const auto expected = config.peer_names.find(at);
  if (expected != config.peer_names.end() && expected->second != identity)
  {
    return {"its name is \"" + identity + "\", not \"" + expected->second + "\" as in peers", false};
  }
  if (Session* const session = at.port != 0 ? sessions_->find(at) : nullptr)
  {
    session->identity = identity;
  }
  return {};
}

void FrameDispatcher::onUntrusted(const Endpoint& at, const std::string& reason)
{
  const std::string subject = (at.port != 0 ? "the bridge at " : "a connection from ") + at.address;
  context_->refusals.count(Refusals::UNTRUSTED, subject, subject + " is not trusted: " + reason);
}

uint8_t* FrameDispatcher::onHeader(FrameTransport::SourceId source, const FrameHeader& header, uint32_t length)
{
  if (header.type == FrameType::HELLO)
  {
    if (length > MAX_HELLO)
    {
      context_->refusals.count(Refusals::MALFORMED);
      return nullptr;
    }
  }
  else if (sessions_->withSecret(header.session) == nullptr || (header.lane & ~ACK_NOW) >= TRAFFIC_CLASSES)
  {
    context_->refusals.count(Refusals::BAD_SESSION);
    return nullptr;
  }
  else if (header.type == FrameType::FRAGMENT)
  {
    return fragmentPlace(source, header, length);
  }
  std::vector<uint8_t>& buffer = payloads_[source];
  buffer.resize(std::max<size_t>(buffer.size(), std::max<uint32_t>(length, 1)));
  return buffer.data();
}

uint8_t* FrameDispatcher::fragmentPlace(FrameTransport::SourceId source, const FrameHeader& header, uint32_t length)
{
  const auto& streams = sessions_->withSecret(header.session)->incoming_streams;
  const auto stream = streams.find(header.id);
  const std::shared_ptr<uint8_t> memory =
      stream != streams.end() ? stream->second->fragmentMemory(header, length) : nullptr;
  if (!memory)
  {
    context_->refusals.count(Refusals::MALFORMED);
  }
  fragments_[source] = memory;
  return memory.get();
}

void FrameDispatcher::onFrame(FrameTransport::SourceId source, const FrameHeader& header, uint8_t* payload,
                              uint32_t length)
{
  if (header.type == FrameType::HELLO)
  {
    onHello(source, payload, length);
    return;
  }
  Session* const session = sessions_->withSecret(header.session);
  if (session == nullptr)
  {
    context_->refusals.count(Refusals::BAD_SESSION);
    context_->transport->closeSource(source);
    return;
  }
  const std::shared_ptr<Peer> peer = session->peer;
  if (header.type == FrameType::FRAGMENT)
  {
    fragments_.erase(source);
  }
  if (!dispatch(session, header, payload, length))
  {
    context_->refusals.count(Refusals::MALFORMED, "an impossible frame from " + peer->endpoint().toString() +
                                                      " was refused (type " +
                                                      std::to_string(static_cast<int>(header.type)) + ")");
    context_->transport->closeSource(source);
    peer->restart();
    return;
  }
  if (Lane::isCounted(header.type))
  {
    peer->acknowledge(static_cast<Traffic>(header.lane & ~ACK_NOW), length + static_cast<uint32_t>(FrameHeader::BYTES),
                      (header.lane & ACK_NOW) != 0);
  }
}

void FrameDispatcher::onHello(FrameTransport::SourceId source, const uint8_t* payload, uint32_t length)
{
  Hello hello;
  if (!Hello::decode(payload, length, &hello))
  {
    context_->refusals.count(Refusals::MALFORMED, "a greeting that cannot be read");
    context_->transport->closeSource(source);
    return;
  }
  if (hello.instance == context_->instance)
  {
    context_->transport->closeSource(source);  // this bridge itself, through another of its addresses
    return;
  }
  if (Session* const known = sessions_->withSecret(hello.echo))
  {
    greet(source, known, hello);
    return;
  }
  const std::optional<Endpoint> endpoint = endpointOf(source, hello);
  if (!endpoint)
  {
    context_->transport->closeSource(source);
  }
  else if (context_->config.allow.empty() && !context_->config.isSecure() && !sessions_->knows(endpoint->address))
  {
    awaitGraph(source, *endpoint, hello);
  }
  else
  {
    greet(source, sessions_->at(*endpoint), hello);
  }
}

/// Where the bridge that sent a greeting can be reached. Nothing if the greeting is refused.
std::optional<Endpoint> FrameDispatcher::endpointOf(FrameTransport::SourceId source, const Hello& hello)
{
  // A bridge behind a tunnel says where it can be reached. Any other is where it sends from.
  const std::string seen = context_->transport->addressOf(source);
  const std::string address = hello.fixed || seen.empty() ? hello.address : seen;
  if (hello.port == 0 || !parseIpv4(address))
  {
    context_->refusals.count(Refusals::MALFORMED, "a bridge that says no address: give it one with advertise");
    return std::nullopt;
  }
  if (!context_->config.allows(address))
  {
    context_->refusals.count(Refusals::UNKNOWN_PEER, "a bridge at " + address + " is not allowed here");
    return std::nullopt;
  }
  return Endpoint{address, hello.port};
}

void FrameDispatcher::awaitGraph(FrameTransport::SourceId source, const Endpoint& endpoint, const Hello& hello)
{
  if (!unknown_.insert_or_assign(std::make_pair(source, endpoint), hello).second)
  {
    return;  // asked already
  }
  const auto decide = [this, source, endpoint](const std::string& refusal)
  {
    const auto waiting = unknown_.extract(std::make_pair(source, endpoint));
    if (waiting.empty())
    {
      return;  // its connection has ended
    }
    if (refusal.empty())
    {
      greet(source, sessions_->at(endpoint), waiting.mapped());
      return;
    }
    context_->refusals.count(Refusals::UNKNOWN_PEER, "the bridge at " + endpoint.address + " is not allowed here: " +
                                                         refusal + ". Name its address in allow or peers");
    context_->transport->closeSource(source);
  };
  context_->graph->findDevice(endpoint.address, decide);
}

/// @param session  null if there are too many
void FrameDispatcher::greet(FrameTransport::SourceId source, Session* session, const Hello& hello)
{
  // Of two devices with keys, none speaks for the other.
  const bool is_same = session != nullptr && (context_->shares_keys || session->identity.empty() ||
                                              session->identity == context_->transport->identityOf(source));
  if (is_same && session->peer->onHello(hello))
  {
    return;
  }
  if (session != nullptr)
  {
    context_->refusals.count(Refusals::BAD_SESSION);
  }
  context_->transport->closeSource(source);
}

bool FrameDispatcher::dispatch(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  switch (header.type)
  {
    case FrameType::HELLO:
      return false;
    case FrameType::PING:
      session->peer->onPing();
      return true;
    case FrameType::ACK:
      if (!session->peer->onAck(header))
      {
        return false;
      }
      session->peer->pump();
      return true;
    case FrameType::LINK_READY:
    case FrameType::LINK_START:
      incoming_->onLinkFrame(session, header);
      return true;
    case FrameType::LINK_OPEN:
    case FrameType::LINK_PROVED:
    case FrameType::LINK_PAUSE:
    case FrameType::LINK_RESUME:
      return outgoing_->onLinkFrame(session, header, payload, length);
    case FrameType::LINK_CLOSE:
      if ((header.count & FROM_SUBSCRIBER) != 0)
      {
        return outgoing_->onLinkFrame(session, header, payload, length);
      }
      incoming_->onLinkFrame(session, header);
      return true;
    case FrameType::MESSAGE:
    case FrameType::BEGIN:
    case FrameType::FRAGMENT:
    case FrameType::ATTACH:
      return incoming_->onStreamFrame(session, header, payload, length);
    case FrameType::TUNNEL_OPEN:
    case FrameType::TUNNEL_READY:
    case FrameType::TUNNEL_DATA:
    case FrameType::TUNNEL_CREDIT:
    case FrameType::TUNNEL_CLOSE:
      return tunnels_->onFrame(session, header, payload, length);
  }
  return false;
}

void FrameDispatcher::onSourceClosed(FrameTransport::SourceId source, CloseReason reason, const std::string& detail)
{
  if (source != 0)
  {
    payloads_.erase(source);
    fragments_.erase(source);
    unknown_.erase(unknown_.lower_bound({source, Endpoint{}}), unknown_.lower_bound({source + 1, Endpoint{}}));
  }
  if (reason != CloseReason::MALFORMED)
  {
    return;
  }
  switch (faultOf(detail))
  {
    case SourceFault::OVERSIZED:
      context_->refusals.count(Refusals::OVERSIZED, "an oversized frame was refused");
      break;
    case SourceFault::WRONG_VERSION:
      context_->refusals.count(Refusals::WRONG_VERSION, "a bridge of another version was refused: " + detail);
      break;
    case SourceFault::MALFORMED:
      context_->refusals.count(Refusals::MALFORMED, "a connection that is not from a bridge was refused: " + detail);
      break;
    case SourceFault::REFUSED:
      break;  // counted where it was refused
  }
}

}  // namespace pi_os_transport
