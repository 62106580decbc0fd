#include "bridge/service_probe.h"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <utility>

#include "event_loop/if_alive.h"
#include "event_loop/socket_io.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MOST_HEADER_BYTES = 64 * 1024;
constexpr size_t MOST_NAME_BYTES = 255;
/// The server is on this device: only one that is stopped or very busy takes longer.
constexpr std::chrono::milliseconds ANSWER_TIME{300};

}  // namespace

ServiceProbe::ServiceProbe(EventLoop* loop, const std::string& service, Done done)
  : loop_(loop)
  , done_(std::move(done))
  , request_(encodeTcprosHeader(
        {{"callerid", "/pi_os_bridge"}, {"service", service}, {"md5sum", "*"}, {"probe", "1"}, {"persistent", "0"}}))
  , reader_(MOST_HEADER_BYTES)
{
}

ServiceProbe::~ServiceProbe()
{
  loop_->remove(socket_.get());
}

void ServiceProbe::start(const Endpoint& server)
{
  const sockaddr_in address = socketAddress(server.address, server.port);
  socket_ = beginConnecting(reinterpret_cast<const sockaddr*>(&address), sizeof(address));
  if (!socket_)
  {
    loop_->defer([self = shared_from_this()] { self->finish(false); });
    return;
  }
  loop_->add(socket_.get(), EPOLLOUT,
             ifAlive(shared_from_this(),
                     [](const std::shared_ptr<ServiceProbe>& self, uint32_t events) { self->onReady(events); }));
  deadline_.start(loop_, ANSWER_TIME,
                  ifAlive(shared_from_this(), [](const std::shared_ptr<ServiceProbe>& self) { self->finish(false); }));
}

void ServiceProbe::onReady(uint32_t events)
{
  if ((events & EPOLLOUT) == 0)
  {
    receive();
    return;
  }
  if (connectionError(socket_.get()) != 0)
  {
    finish(false);
    return;
  }
  switch (sendRest(socket_.get(), request_, &sent_))
  {
    case SendResult::BLOCKED:
      break;
    case SendResult::FAILED:
      finish(false);
      break;
    case SendResult::DONE:
      loop_->change(socket_.get(), EPOLLIN);
      break;
  }
}

void ServiceProbe::receive()
{
  std::array<char, 4096> chunk;
  const ssize_t size = recv(socket_.get(), chunk.data(), chunk.size(), MSG_DONTWAIT);
  if (size < 0 && (errno == EAGAIN || errno == EINTR))
  {
    return;
  }
  if (size <= 0)
  {
    finish(false);
    return;
  }
  reader_.feed(std::string_view(chunk.data(), static_cast<size_t>(size)));
  if (const std::optional<std::string_view> fields = reader_.next())
  {
    const std::optional<TcprosHeader> header = decodeTcprosHeader(*fields);
    finish(header && header->count("md5sum") != 0 && header->count("error") == 0);
  }
  else if (reader_.isBroken())
  {
    finish(false);
  }
}

void ServiceProbe::finish(bool served)
{
  deadline_.stop();
  loop_->remove(socket_.get());
  socket_.reset();
  if (const Done done = std::exchange(done_, nullptr))
  {
    done(served);
  }
}

bool isGraphName(const std::string& name)
{
  return name.size() > 1 && name.size() <= MOST_NAME_BYTES && name.front() == '/' &&
         std::all_of(name.begin(), name.end(),
                     [](unsigned char c) { return c < 0x80 && (std::isalnum(c) != 0 || c == '_' || c == '/'); });
}

}  // namespace pi_os_transport
