// The outgoing half of SpTransport.

#include "wire/sp_transport.h"

#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <stdexcept>
#include <utility>

#include "event_loop/socket_io.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{

SpTransport::~SpTransport()
{
  for (const auto& connection : connections_)
  {
    shut(connection.second.get());
  }
  for (const auto& acceptor : acceptors_)
  {
    loop_->remove(acceptor->socket.get());
  }
  for (const auto& source : sources_)
  {
    shut(source.second.get());
  }
}

FrameTransport::ConnectionId SpTransport::connect(const Endpoint& endpoint)
{
  const auto connection = std::make_shared<Connection>();
  connection->id = next_connection_++;
  connection->at = endpoint;
  connections_[connection->id] = connection;
  if (!parseIpv4(endpoint.address))
  {
    failLater(connection, CloseReason::UNREACHABLE);
    return connection->id;
  }
  connection->socket = FileDescriptor(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  const int fd = connection->socket.get();
  if (fd < 0)
  {
    failLater(connection, reasonOf(errno));
    return connection->id;
  }
  const sockaddr_in address = socketAddress(endpoint.address, endpoint.port);
  setSpOptions(fd, SP_ACKNOWLEDGE_TIME);
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 && errno != EINPROGRESS)
  {
    failLater(connection, reasonOf(errno));
    return connection->id;
  }
  // Callers open two connections at a time, which get the same timeout.
  setTimer(connection, attempts_++ / 2 % 3 == 2 ? SP_CONNECT_TIME_FAR : SP_CONNECT_TIME);
  loop_->add(fd, EPOLLOUT, [this, connection](uint32_t events) { onConnectionEvent(connection, events); });
  return connection->id;
}

void SpTransport::close(ConnectionId connection)
{
  const auto found = connections_.find(connection);
  if (found != connections_.end())
  {
    shut(found->second.get());
    connections_.erase(found);
  }
}

std::optional<std::chrono::microseconds> SpTransport::roundTrip(ConnectionId connection) const
{
  const auto found = connections_.find(connection);
  tcp_info info{};
  socklen_t length = sizeof(info);
  if (found == connections_.end() ||
      getsockopt(found->second->socket.get(), IPPROTO_TCP, TCP_INFO, &info, &length) != 0 || info.tcpi_rtt == 0)
  {
    return std::nullopt;
  }
  return std::chrono::microseconds(info.tcpi_rtt);
}

bool SpTransport::writable(ConnectionId connection) const
{
  const auto found = connections_.find(connection);
  return found != connections_.end() && found->second->state == Connection::State::OPEN && found->second->writer.idle();
}

bool SpTransport::send(ConnectionId id, const FrameHeader& header, const iovec* payload, size_t pieces, bool more)
{
  if (!writable(id))
  {
    return false;
  }
  const ConnectionPointer connection = connections_.at(id);
  if (pieces > SpWriter::MAX_PIECES - 1)
  {
    throw std::invalid_argument("a frame of " + std::to_string(pieces) + " pieces, must be in [0, " +
                                std::to_string(SpWriter::MAX_PIECES - 1) + "]");
  }
  uint64_t body = FrameHeader::BYTES;
  std::array<iovec, SpWriter::MAX_PIECES> all;
  all[0] = {connection->head.data(), connection->head.size()};
  for (size_t piece = 0; piece < pieces; ++piece)
  {
    all[piece + 1] = payload[piece];
    body += payload[piece].iov_len;
  }
  if (body > FrameHeader::BYTES + MAX_PAYLOAD)
  {
    throw std::invalid_argument("payload of " + std::to_string(body - FrameHeader::BYTES) + " bytes, must be in [0, " +
                                std::to_string(MAX_PAYLOAD) + "]");
  }
  storeBigEndian(connection->head.data(), body);
  const auto encoded = header.encode();
  std::copy(encoded.begin(), encoded.end(), connection->head.begin() + SP_LENGTH_BYTES);

  const int error = connection->writer.begin(*connection, all.data(), pieces + 1, more);
  if (error != 0)
  {
    failLater(connection, reasonOfChannel(*connection, error));
    return false;
  }
  if (!connection->writer.idle())
  {
    loop_->change(connection->socket.get(), EPOLLIN | EPOLLOUT);
  }
  return true;
}

void SpTransport::onConnectionEvent(const ConnectionPointer& connection, uint32_t events)
{
  using State = Connection::State;
  if (connection->closed || connection->state == State::BROKEN)
  {
    return;
  }
  if (connection->state == State::CONNECTING)
  {
    onTcpConnected(connection);
    return;
  }
  if (connection->state == State::PROVING)
  {
    prove(connection);
    return;
  }
  if ((events & ~static_cast<uint32_t>(EPOLLOUT)) != 0)
  {
    readGreeting(connection);
  }
  if (connection->closed || connection->writer.idle() || (events & EPOLLOUT) == 0)
  {
    return;
  }
  const int error = connection->writer.resume(*connection);
  if (error != 0)
  {
    fail(connection, reasonOfChannel(*connection, error));
  }
  else if (connection->writer.idle())
  {
    loop_->change(connection->socket.get(), EPOLLIN);
    listener_->onWritable(connection->id);
  }
}

void SpTransport::onTcpConnected(const ConnectionPointer& connection)
{
  const int fd = connection->socket.get();
  const int error = connectionError(fd);
  if (error != 0)
  {
    fail(connection, reasonOf(error));
    return;
  }
  if (!keys_)
  {
    setTimer(connection, SP_ANSWER_TIME);
    greet(connection);
    return;
  }
  connection->state = Connection::State::PROVING;
  setTimer(connection, 2 * SP_ANSWER_TIME);  // it takes two round trips more
  connection->tls = std::make_unique<TlsSession>(keys_.get(), fd, TlsSession::Role::CLIENT,
                                                 [this, at = connection->at](const std::string& identity)
                                                 { return listener_->onIdentity(at, identity); });
  prove(connection);
}

void SpTransport::greet(const ConnectionPointer& connection)
{
  const bool greeted = sendSpHeader(*connection, SpType::PUSH) == 0;
  connection->state = Connection::State::GREETING;
  loop_->change(connection->socket.get(), EPOLLIN);
  readGreeting(connection);  // a protected answer, or the reason of a refusal, may have come already
  if (!greeted && !connection->closed)
  {
    fail(connection, CloseReason::PEER_CLOSED);
  }
}

/// A PULL socket sends nothing after its SP header, so a readable socket means that the connection has ended.
void SpTransport::readGreeting(const ConnectionPointer& connection)
{
  std::array<uint8_t, SP_HEADER_BYTES> scratch;
  const SpReader::Result result = connection->reader.receive(*connection, scratch.data(), scratch.size(),
                                                             SP_BYTES_PER_TURN, connection.get());
  if (connection->state == Connection::State::GREETING && connection->reader.greeted())
  {
    connection->timer.stop();
    connection->state = Connection::State::OPEN;
    listener_->onConnected(connection->id);
  }
  if (connection->closed)
  {
    return;
  }
  if (result.end != SpReader::End::NONE)
  {
    fail(connection, reasonOfChannel(*connection, connection->reader, result));
  }
  else if (connection->reader.greeted() && !connection->reader.betweenMessages())
  {
    fail(connection, CloseReason::MALFORMED);
  }
}

void SpTransport::setTimer(const ConnectionPointer& connection, std::chrono::milliseconds time)
{
  connection->timer.start(loop_, time,
                          [this, connection]
                          {
                            fail(connection, connection->state == Connection::State::CONNECTING
                                                 ? CloseReason::UNREACHABLE
                                                 : CloseReason::SILENT);
                          });
}

void SpTransport::failLater(const ConnectionPointer& connection, CloseReason reason)
{
  connection->state = Connection::State::BROKEN;
  loop_->defer(
      [this, connection, reason]
      {
        if (!connection->closed)
        {
          fail(connection, reason);
        }
      });
}

void SpTransport::fail(const ConnectionPointer& connection, CloseReason reason)
{
  shut(connection.get());
  connections_.erase(connection->id);
  if (reason == CloseReason::UNTRUSTED)
  {
    listener_->onUntrusted(connection->at, connection->tls ? connection->tls->problem() : ONLY_OTHER_PROTECTS);
  }
  listener_->onClosed(connection->id, reason);
}

std::unique_ptr<FrameTransport> makeSpTransport(EventLoop* loop, FrameTransport::Listener* listener)
{
  return makeProtectedTransport(loop, listener, nullptr);
}

std::unique_ptr<FrameTransport> makeProtectedTransport(EventLoop* loop, FrameTransport::Listener* listener,
                                                       std::shared_ptr<const TlsKeys> keys)
{
  return std::make_unique<SpTransport>(loop, listener, std::move(keys));
}

}  // namespace pi_os_transport
