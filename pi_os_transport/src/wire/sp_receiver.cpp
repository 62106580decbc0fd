// The incoming half of SpTransport.

#include "wire/sp_transport.h"

#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <system_error>
#include <utility>

#include "event_loop/socket_io.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

/// After a payload of this size, only the next frame's head is read ahead. More bytes would have to be copied, which
/// costs more than the system call it saves.
constexpr uint32_t LARGE_PAYLOAD = 16 * 1024;
constexpr int ACCEPTED_PER_TURN = 64;
/// Pause after accept() failed for lack of descriptors or memory.
constexpr std::chrono::milliseconds ACCEPT_PAUSE{100};

}  // namespace

bool SpTransport::listen(const Endpoint& endpoint, std::string* error)
{
  const auto failed = [&](const std::string& what)
  {
    *error = endpoint.toString() + ": " + what;
    return false;
  };
  if (!parseIpv4(endpoint.address))
  {
    return failed("not a numeric IPv4 address");
  }
  auto acceptor = std::make_unique<Acceptor>();
  acceptor->socket = FileDescriptor(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  const int fd = acceptor->socket.get();
  if (fd < 0)
  {
    return failed(std::generic_category().message(errno));
  }
  setOption(fd, SOL_SOCKET, SO_REUSEADDR, 1);
  sockaddr_in address = socketAddress(endpoint.address, endpoint.port);
  socklen_t length = sizeof(address);
  if (bind(fd, reinterpret_cast<const sockaddr*>(&address), length) != 0 ||
      ::listen(fd, static_cast<int>(SP_MAX_SOURCES)) != 0 ||
      getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) != 0)
  {
    return failed(std::generic_category().message(errno));
  }
  acceptor->port = ntohs(address.sin_port);
  loop_->add(fd, EPOLLIN, [this, acceptor = acceptor.get()](uint32_t) { onAcceptorEvent(acceptor); });
  acceptors_.push_back(std::move(acceptor));
  return true;
}

void SpTransport::onAcceptorEvent(Acceptor* acceptor)
{
  for (int turn = 0; turn < ACCEPTED_PER_TURN; ++turn)
  {
    sockaddr_in address{};
    socklen_t length = sizeof(address);
    const int fd =
        accept4(acceptor->socket.get(), reinterpret_cast<sockaddr*>(&address), &length, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd >= 0)
    {
      addSource(FileDescriptor(fd), address);
      continue;
    }
    if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM)
    {
      // The caller stays in the queue of the kernel.
      loop_->change(acceptor->socket.get(), 0);
      acceptor->pause.start(loop_, ACCEPT_PAUSE, [this, acceptor] { loop_->change(acceptor->socket.get(), EPOLLIN); });
    }
    return;  // any other error means that the caller has left
  }
}

void SpTransport::addSource(FileDescriptor socket, const sockaddr_in& address)
{
  if (sources_.size() >= SP_MAX_SOURCES)
  {
    socket.reset();
    listener_->onSourceClosed(next_source_++, CloseReason::REFUSED, TOO_MANY_DETAIL);
    return;
  }
  if (!listener_->onAccept(addressText(address)))
  {
    return;
  }
  const auto source = std::make_shared<Source>();
  source->id = next_source_++;
  source->address = addressText(address);
  source->socket = std::move(socket);
  if (keys_ && knocksTooOften(source->address))
  {
    source->socket.reset();
    listener_->onUntrusted({source->address, 0}, TOO_MANY_DETAIL + std::string(" without a proof"));
    return;
  }
  setCommonOptions(source->socket.get());
  if (keys_)
  {
    source->stage = Source::Stage::PROVING;
    source->tls = std::make_unique<TlsSession>(keys_.get(), source->socket.get(), TlsSession::Role::SERVER,
                                               [this, address = source->address](const std::string& identity) {
                                                 return listener_->onIdentity({address, 0}, identity);
                                               });
  }
  else if (!sendGreeting(source.get(), PULL_GREETING))
  {
    return;
  }
  source->timer.start(loop_, keys_ ? SP_PROOF_TIME : SP_GREETING_TIME,
                      [this, source]
                      { fail(source, CloseReason::MALFORMED, std::string(NO_GREETING_DETAIL) + " in time"); });
  sources_[source->id] = source;
  loop_->add(source->socket.get(), EPOLLIN, [this, source](uint32_t) { onSourceEvent(source); });
}

void SpTransport::onSourceEvent(const SourcePointer& source)
{
  if (source->closed || (source->stage == Source::Stage::PROVING && !prove(source)))
  {
    return;
  }
  for (size_t turn_bytes = 0; !source->closed && turn_bytes < SP_BYTES_PER_TURN;)
  {
    // The rest of a payload is read to its final place, bytes after it into the buffer.
    const bool in_payload = source->stage == Source::Stage::PAYLOAD;
    const size_t missing = in_payload ? source->length - source->received : 0;
    const size_t ahead = source->length >= LARGE_PAYLOAD ? HEAD_BYTES : buffer_.size();
    std::array<iovec, 2> places{{{nullptr, 0}, {buffer_.data(), ahead}}};
    if (in_payload)
    {
      places[0] = {source->payload + source->received, missing};
    }
    const ssize_t result =
        in_payload ? receiveBytes(source.get(), places.data(), 2) : receiveBytes(source.get(), &places[1], 1);
    if (result <= 0)
    {
      if (result == 0 || !isTemporary(errno))
      {
        fail(source, result == 0 ? CloseReason::PEER_CLOSED : reasonOfChannel(*source, errno), "");
      }
      return;
    }
    const auto count = static_cast<size_t>(result);
    turn_bytes += count;
    if (in_payload)
    {
      onPayloadBytes(source, std::min(count, missing));
    }
    if (count > missing)
    {
      takeBytes(source, buffer_.data(), count - missing);
    }
    if (count < missing + ahead)
    {
      return;  // everything was read
    }
  }
  if (!source->closed && source->tls && source->tls->hasPending())
  {
    loop_->defer([this, source] { onSourceEvent(source); });  // of these bytes no event tells
  }
}

void SpTransport::takeBytes(const SourcePointer& source, const uint8_t* bytes, size_t count)
{
  while (count != 0 && !source->closed)
  {
    size_t taken;
    if (source->stage == Source::Stage::PAYLOAD)
    {
      taken = std::min<size_t>(count, source->length - source->received);
      std::memcpy(source->payload + source->received, bytes, taken);
      onPayloadBytes(source, taken);
    }
    else
    {
      const size_t stage_bytes = source->stage == Source::Stage::GREETING ? GREETING_BYTES
                                 : source->stage == Source::Stage::LENGTH ? LENGTH_BYTES
                                                                          : FrameHeader::BYTES;
      taken = std::min(count, stage_bytes - source->head_bytes);
      std::memcpy(&source->head[source->head_bytes], bytes, taken);
      source->head_bytes += taken;
      onHeadBytes(source, stage_bytes);
    }
    bytes += taken;
    count -= taken;
  }
}

/// More bytes of the head were received. The head is complete with `stage_bytes`.
void SpTransport::onHeadBytes(const SourcePointer& source, size_t stage_bytes)
{
  using Stage = Source::Stage;
  if (source->stage == Stage::GREETING &&
      std::memcmp(source->head.data(), PUSH_GREETING.data(), source->head_bytes) != 0)
  {
    const bool protects = !source->tls && source->head[0] == TLS_HANDSHAKE;
    fail(source, protects ? CloseReason::UNTRUSTED : CloseReason::MALFORMED, NO_GREETING_DETAIL);
    return;
  }
  if (source->head_bytes < stage_bytes)
  {
    return;
  }
  source->head_bytes = 0;
  if (source->stage == Stage::GREETING)
  {
    source->timer.stop();
    source->stage = Stage::LENGTH;
    return;
  }
  if (source->stage == Stage::LENGTH)
  {
    uint64_t length = 0;
    for (size_t byte = 0; byte < LENGTH_BYTES; ++byte)
    {
      length = length << 8 | source->head[byte];
    }
    const std::string fault = faultOfLength(length);
    if (!fault.empty())
    {
      fail(source, CloseReason::MALFORMED, fault);
      return;
    }
    source->length = static_cast<uint32_t>(length - FrameHeader::BYTES);
    source->stage = Stage::HEADER;
    return;
  }
  onHeader(source);
}

void SpTransport::onHeader(const SourcePointer& source)
{
  const std::string fault = decodeHeader(source->head.data(), &source->header);
  if (!fault.empty())
  {
    fail(source, CloseReason::MALFORMED, fault);
    return;
  }
  source->payload = listener_->onHeader(source->id, source->header, source->length);
  if (source->closed)
  {
    return;
  }
  if (source->payload == nullptr)
  {
    fail(source, CloseReason::MALFORMED, FRAME_REFUSED_DETAIL);
    return;
  }
  source->received = 0;
  source->stage = Source::Stage::PAYLOAD;
  if (source->length == 0)
  {
    onPayloadBytes(source, 0);
  }
}

/// `count` more bytes of the payload were received.
void SpTransport::onPayloadBytes(const SourcePointer& source, size_t count)
{
  source->received += static_cast<uint32_t>(count);
  if (source->received == source->length)
  {
    source->stage = Source::Stage::LENGTH;
    listener_->onFrame(source->id, source->header, source->payload, source->length);
  }
}

void SpTransport::fail(const SourcePointer& source, CloseReason reason, const std::string& detail)
{
  shut(source.get());
  if (reason == CloseReason::UNTRUSTED)
  {
    listener_->onUntrusted({source->address, 0}, source->tls ? source->tls->problem() : ONLY_OTHER_PROTECTS);
  }
  listener_->onSourceClosed(source->id, reason, detail);
  sources_.erase(source->id);  // only now: the listener may ask for the address
}

void SpTransport::closeSource(SourceId source)
{
  const auto found = sources_.find(source);
  if (found != sources_.end() && !found->second->closed)
  {
    shut(found->second.get());
    sources_.erase(found);
  }
}

std::string SpTransport::addressOf(SourceId source) const
{
  const auto found = sources_.find(source);
  return found != sources_.end() ? found->second->address : std::string();
}

}  // namespace pi_os_transport
