// The bytes of SpTransport's connections, protected or not, and the proof of who is at their other end.

#include "wire/sp_transport.h"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>

namespace pi_os_transport
{
namespace
{

/// A fatal alert "protocol_version" of TLS (RFC 8446, section 6).
constexpr std::array<uint8_t, 7> PROTOCOL_ALERT{TLS_ALERT, 3, 3, 0, 2, 2, 70};

}  // namespace

void SpTransport::shut(Channel* channel)
{
  channel->closed = true;
  channel->timer.stop();
  loop_->remove(channel->socket.get());
  channel->socket.reset();
}

ssize_t SpTransport::receiveBytes(Channel* channel, const iovec* places, size_t count)
{
  if (channel->tls)
  {
    return channel->tls->receive(places, count);
  }
  msghdr message{};
  message.msg_iov = const_cast<iovec*>(places);
  message.msg_iovlen = count;
  return recvmsg(channel->socket.get(), &message, MSG_DONTWAIT);
}

ssize_t SpTransport::sendBytes(Channel* channel, const iovec* pieces, size_t count, bool more)
{
  if (channel->tls)
  {
    return channel->tls->send(pieces, count, more);
  }
  msghdr message{};
  message.msg_iov = const_cast<iovec*>(pieces);
  message.msg_iovlen = count;
  return sendmsg(channel->socket.get(), &message, MSG_NOSIGNAL | MSG_DONTWAIT | (more ? MSG_MORE : 0));
}

bool SpTransport::sendGreeting(Channel* channel, const std::array<uint8_t, GREETING_BYTES>& greeting)
{
  // A new connection always has room for the greeting.
  const iovec piece{const_cast<uint8_t*>(greeting.data()), greeting.size()};
  return sendBytes(channel, &piece, 1, false) == static_cast<ssize_t>(greeting.size());
}

CloseReason SpTransport::reasonOfChannel(const Channel& channel, int error)
{
  return channel.tls && error == EPROTO ? CloseReason::UNTRUSTED : reasonOf(error);
}

/// The next step of the proof, on a connection to another bridge.
void SpTransport::prove(const ConnectionPointer& connection)
{
  const int fd = connection->socket.get();
  switch (connection->tls->handshake())
  {
    case TlsSession::Step::AWAITS_DATA:
      loop_->change(fd, EPOLLIN);
      break;
    case TlsSession::Step::AWAITS_SPACE:
      loop_->change(fd, EPOLLIN | EPOLLOUT);
      break;
    case TlsSession::Step::DONE:
      greet(connection);
      break;
    case TlsSession::Step::FAILED:
      fail(connection, connection->tls->problem().empty() ? CloseReason::PEER_CLOSED : CloseReason::UNTRUSTED);
      break;
  }
}

/// The same on a connection of another bridge. @return true if the other end has proved who it is
bool SpTransport::prove(const SourcePointer& source)
{
  switch (source->tls->handshake())
  {
    case TlsSession::Step::AWAITS_DATA:
      loop_->change(source->socket.get(), EPOLLIN);
      return false;
    case TlsSession::Step::AWAITS_SPACE:
      loop_->change(source->socket.get(), EPOLLIN | EPOLLOUT);
      return false;
    case TlsSession::Step::FAILED:
      if (source->tls->isForeign())
      {
        // OpenSSL tells only those who speak TLS.
        ::send(source->socket.get(), PROTOCOL_ALERT.data(), PROTOCOL_ALERT.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
      }
      fail(source, source->tls->problem().empty() ? CloseReason::PEER_CLOSED : CloseReason::UNTRUSTED, "");
      return false;
    case TlsSession::Step::DONE:
      break;
  }
  loop_->change(source->socket.get(), EPOLLIN);
  source->stage = Source::Stage::GREETING;
  if (!sendGreeting(source.get(), PULL_GREETING))
  {
    fail(source, CloseReason::PEER_CLOSED, "");
    return false;
  }
  return true;
}

/// True if a machine has too many connections on which it has not proved who it is.
bool SpTransport::knocksTooOften(const std::string& address) const
{
  return std::count_if(sources_.begin(), sources_.end(),
                       [&address](const auto& entry) {
                         return entry.second->stage == Source::Stage::PROVING && entry.second->address == address;
                       }) >= static_cast<std::ptrdiff_t>(SP_MAX_UNPROVED);
}

std::string SpTransport::identityOf(SourceId source) const
{
  const auto found = sources_.find(source);
  return found != sources_.end() && found->second->tls ? found->second->tls->identity() : std::string();
}

}  // namespace pi_os_transport
