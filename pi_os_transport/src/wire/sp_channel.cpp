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

ssize_t SpTransport::Channel::receive(const iovec* places, size_t count) const
{
  return tls ? tls->receive(places, count) : SpSocket{socket.get()}.receive(places, count);
}

ssize_t SpTransport::Channel::send(const iovec* pieces, size_t count, bool more) const
{
  return tls ? tls->send(pieces, count, more) : SpSocket{socket.get()}.send(pieces, count, more);
}

CloseReason SpTransport::reasonOfChannel(const Channel& channel, int error)
{
  return channel.tls && error == EPROTO ? CloseReason::UNTRUSTED : reasonOf(error);
}

CloseReason SpTransport::reasonOfChannel(const Channel& channel, const SpReader& reader, const SpReader::Result& result)
{
  if (result.end == SpReader::End::FAILED)
  {
    return reasonOfChannel(channel, result.error);
  }
  const bool protects = result.end == SpReader::End::NO_PEER && !channel.tls &&
                        (reader.firstByte() == TLS_HANDSHAKE || reader.firstByte() == TLS_ALERT);
  return protects ? CloseReason::UNTRUSTED : reasonOf(result);
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
  source->proving = false;
  if (sendSpHeader(*source, SpType::PULL) != 0)
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
                       [&address](const auto& entry)
                       { return entry.second->proving && entry.second->address == address; }) >= static_cast<std::ptrdiff_t>(SP_MAX_UNPROVED);
}

std::string SpTransport::identityOf(SourceId source) const
{
  const auto found = sources_.find(source);
  return found != sources_.end() && found->second->tls ? found->second->tls->identity() : std::string();
}

}  // namespace pi_os_transport
