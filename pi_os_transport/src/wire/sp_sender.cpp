// The outgoing half of SpTransport.

#include "wire/sp_transport.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
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
  setCommonOptions(fd);
  setOption(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, static_cast<int>(SP_ACKNOWLEDGE_TIME.count()));
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
  return found != connections_.end() && found->second->state == Connection::State::OPEN &&
         found->second->next_piece == found->second->pieces_end;
}

bool SpTransport::send(ConnectionId id, const FrameHeader& header, const iovec* payload, size_t pieces, bool more)
{
  if (!writable(id))
  {
    return false;
  }
  const ConnectionPointer connection = connections_.at(id);
  if (pieces > connection->pieces.size() - 1)
  {
    throw std::invalid_argument("a frame of " + std::to_string(pieces) + " pieces, must be in [0, 2]");
  }
  uint64_t body = FrameHeader::BYTES;
  connection->pieces[0] = {connection->head.data(), connection->head.size()};
  for (size_t piece = 0; piece < pieces; ++piece)
  {
    connection->pieces[piece + 1] = payload[piece];
    body += payload[piece].iov_len;
  }
  if (body > FrameHeader::BYTES + MAX_PAYLOAD)
  {
    throw std::invalid_argument("payload of " + std::to_string(body - FrameHeader::BYTES) + " bytes, must be in [0, " +
                                std::to_string(MAX_PAYLOAD) + "]");
  }
  for (size_t byte = 0; byte < LENGTH_BYTES; ++byte)
  {
    connection->head[byte] = static_cast<uint8_t>(body >> (8 * (LENGTH_BYTES - 1 - byte)));
  }
  const auto encoded = header.encode();
  std::copy(encoded.begin(), encoded.end(), connection->head.begin() + LENGTH_BYTES);
  connection->next_piece = 0;
  connection->pieces_end = pieces + 1;
  connection->more = more;

  const int error = sendPieces(connection.get());
  if (error != 0)
  {
    failLater(connection, reasonOf(error));
    return false;
  }
  if (connection->next_piece != connection->pieces_end)
  {
    loop_->change(connection->socket.get(), EPOLLIN | EPOLLOUT);
  }
  return true;
}

/// Sends as much as the socket takes. @return error number, 0 for none.
int SpTransport::sendPieces(Connection* connection)
{
  msghdr message{};
  message.msg_iov = &connection->pieces[connection->next_piece];
  message.msg_iovlen = connection->pieces_end - connection->next_piece;
  const ssize_t result =
      sendmsg(connection->socket.get(), &message, MSG_NOSIGNAL | MSG_DONTWAIT | (connection->more ? MSG_MORE : 0));
  if (result < 0)
  {
    return isTemporary(errno) ? 0 : errno;
  }
  auto sent = static_cast<size_t>(result);
  while (connection->next_piece != connection->pieces_end && sent >= connection->pieces[connection->next_piece].iov_len)
  {
    sent -= connection->pieces[connection->next_piece++].iov_len;
  }
  if (connection->next_piece != connection->pieces_end)
  {
    iovec& piece = connection->pieces[connection->next_piece];
    piece = {static_cast<uint8_t*>(piece.iov_base) + sent, piece.iov_len - sent};
  }
  return 0;
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
  if (connection->state == State::GREETING)
  {
    readGreeting(connection);
    return;
  }
  if ((events & ~static_cast<uint32_t>(EPOLLOUT)) != 0)
  {
    readEnd(connection);
  }
  if (connection->closed || connection->next_piece == connection->pieces_end || (events & EPOLLOUT) == 0)
  {
    return;
  }
  const int error = sendPieces(connection.get());
  if (error != 0)
  {
    fail(connection, reasonOf(error));
  }
  else if (connection->next_piece == connection->pieces_end)
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
  if (!sendGreeting(fd, PUSH_GREETING))
  {
    fail(connection, CloseReason::PEER_CLOSED);
    return;
  }
  connection->state = Connection::State::GREETING;
  setTimer(connection, SP_ANSWER_TIME);
  loop_->change(fd, EPOLLIN);
}

void SpTransport::readGreeting(const ConnectionPointer& connection)
{
  const ssize_t count = recv(connection->socket.get(), &connection->greeting[connection->greeting_bytes],
                             GREETING_BYTES - connection->greeting_bytes, MSG_DONTWAIT);
  if (count <= 0)
  {
    if (count == 0 || !isTemporary(errno))
    {
      fail(connection, count == 0 ? CloseReason::PEER_CLOSED : reasonOf(errno));
    }
    return;
  }
  connection->greeting_bytes += static_cast<size_t>(count);
  if (std::memcmp(connection->greeting.data(), PULL_GREETING.data(), connection->greeting_bytes) != 0)
  {
    fail(connection, CloseReason::MALFORMED);
    return;
  }
  if (connection->greeting_bytes == GREETING_BYTES)
  {
    connection->timer.stop();
    connection->state = Connection::State::OPEN;
    listener_->onConnected(connection->id);
  }
}

/// A PULL socket sends nothing after its header, so a readable socket means that the connection has ended.
void SpTransport::readEnd(const ConnectionPointer& connection)
{
  uint8_t byte;
  const ssize_t count = recv(connection->socket.get(), &byte, 1, MSG_DONTWAIT);
  if (count >= 0)
  {
    fail(connection, count == 0 ? CloseReason::PEER_CLOSED : CloseReason::MALFORMED);
  }
  else if (!isTemporary(errno))
  {
    fail(connection, reasonOf(errno));
  }
}

void SpTransport::setTimer(const ConnectionPointer& connection, std::chrono::milliseconds time)
{
  connection->timer.start(loop_, time,
                          [this, connection]
                          {
                            fail(connection, connection->state == Connection::State::GREETING
                                                 ? CloseReason::SILENT
                                                 : CloseReason::UNREACHABLE);
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
  listener_->onClosed(connection->id, reason);
}

void SpTransport::shut(Channel* channel)
{
  channel->closed = true;
  channel->timer.stop();
  loop_->remove(channel->socket.get());
  channel->socket.reset();
}

std::unique_ptr<FrameTransport> makeSpTransport(EventLoop* loop, FrameTransport::Listener* listener)
{
  return std::make_unique<SpTransport>(loop, listener);
}

}  // namespace pi_os_transport
