// The incoming half of SpTransport.

#include "wire/sp_transport.h"

#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <system_error>
#include <utility>

#include "event_loop/socket_io.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

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
  const auto source = std::make_shared<Source>(listener_);
  source->id = next_source_++;
  source->address = addressText(address);
  source->socket = std::move(socket);
  if (keys_ && knocksTooOften(source->address))
  {
    source->socket.reset();
    listener_->onUntrusted({source->address, 0}, TOO_MANY_DETAIL + std::string(" without a proof"));
    return;
  }
  setSpOptions(source->socket.get(), std::chrono::milliseconds(0));
  if (keys_)
  {
    source->proving = true;
    source->tls = std::make_unique<TlsSession>(keys_.get(), source->socket.get(), TlsSession::Role::SERVER,
                                               [this, address = source->address](const std::string& identity) {
                                                 return listener_->onIdentity({address, 0}, identity);
                                               });
  }
  else if (sendSpHeader(*source, SpType::PULL) != 0)
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
  if (source->closed || (source->proving && !prove(source)))
  {
    return;
  }
  const SpReader::Result result =
      source->reader.receive(*source, buffer_.data(), buffer_.size(), SP_BYTES_PER_TURN, source.get());
  if (source->closed)
  {
    return;
  }
  if (source->reader.greeted())
  {
    source->timer.stop();
  }
  if (result.end != SpReader::End::NONE)
  {
    fail(source, reasonOfChannel(*source, source->reader, result),
         result.end == SpReader::End::NO_PEER ? NO_GREETING_DETAIL : source->fault);
  }
  else if (source->tls && source->tls->hasPending())
  {
    loop_->defer([this, source] { onSourceEvent(source); });  // of these bytes no event tells
  }
}

bool SpTransport::Source::onLength(uint64_t bytes)
{
  fault = faultOfLength(bytes);
  length = static_cast<uint32_t>(bytes - FrameHeader::BYTES);
  return fault.empty();
}

iovec SpTransport::Source::place(size_t missing)
{
  if (missing > length)
  {
    return {head.data(), head.size()};
  }
  return beginPayload() ? iovec{payload, missing} : iovec{};
}

/// The header of a frame is complete. @return false: the frame is refused, or the source was closed.
bool SpTransport::Source::beginPayload()
{
  fault = decodeHeader(head.data(), &header);
  if (!fault.empty())
  {
    return false;
  }
  payload = listener->onHeader(id, header, length);
  fault = payload == nullptr ? FRAME_REFUSED_DETAIL : "";
  return !closed && payload != nullptr;
}

bool SpTransport::Source::onMessage()
{
  if (length == 0 && !beginPayload())
  {
    return false;
  }
  listener->onFrame(id, header, payload, length);
  return !closed;
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
