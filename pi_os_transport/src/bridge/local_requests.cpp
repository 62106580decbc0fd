#include "bridge/local_requests.h"

#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "shm/shared_memory.h"

namespace pi_os_transport
{
namespace
{

/// How long no process is accepted after there was no descriptor for one.
constexpr std::chrono::milliseconds ACCEPT_AGAIN{1000};

}  // namespace

LocalRequests::~LocalRequests()
{
  for (const auto& client : clients_)
  {
    loop_->remove(client.first);
  }
  stop();
}

void LocalRequests::listen(const std::string& name)
{
  const std::string socket = BridgeRequest::socketName(name);
  listener_ = SideChannel::listen(socket);
  if (!listener_)
  {
    throw std::runtime_error("the local socket \"" + socket + "\" cannot be opened: " + std::strerror(errno) +
                             ". Is another bridge of this user running? Give this one another --socket");
  }
}

void LocalRequests::start()
{
  loop_->add(listener_.fd(), EPOLLIN, [this](uint32_t) { accept(); });
}

void LocalRequests::stop()
{
  if (listener_)
  {
    if (!accept_again_.running())
    {
      loop_->remove(listener_.fd());
    }
    accept_again_.stop();
    listener_.close();
  }
}

void LocalRequests::accept()
{
  while (SideChannel accepted = listener_.accept())
  {
    const auto client = std::make_shared<SideChannel>(std::move(accepted));
    clients_[client->fd()] = client;
    loop_->add(client->fd(), EPOLLIN, [this, client](uint32_t) { onRequest(client); });
  }
  const std::string shortage = describeShortage(errno);
  if (!shortage.empty())
  {
    // The socket stays readable, and the bridge must not spin.
    if (!std::exchange(warned_, true))
    {
      handlers_.log("cannot accept a process of this device: " + shortage);
    }
    loop_->remove(listener_.fd());
    accept_again_.start(loop_, ACCEPT_AGAIN, [this]() { start(); });
  }
}

void LocalRequests::onRequest(const std::shared_ptr<SideChannel>& client)
{
  uint32_t version = 0;
  if (recv(client->fd(), &version, sizeof(version), MSG_PEEK | MSG_DONTWAIT) == sizeof(version) &&
      version == PROTOCOL_VERSION)
  {
    const int pair = client->fd();
    loop_->remove(pair);
    handlers_.accept_pair(std::move(*client));
    clients_.erase(pair);
    return;
  }
  std::vector<uint8_t> packet;
  SideChannel::Descriptors descriptors;
  const SideChannel::Receive received = client->receiveBytes(&packet, BridgeRequest::LONGEST, &descriptors);
  if (received == SideChannel::Receive::NOTHING)
  {
    return;
  }
  const int fd = client->fd();
  loop_->remove(fd);
  SideChannel channel = std::move(*client);
  clients_.erase(fd);
  if (received == SideChannel::Receive::PACKET)
  {
    handle(std::move(channel), packet);
  }
}

void LocalRequests::handle(SideChannel channel, const std::vector<uint8_t>& packet)
{
  BridgeRequest request;
  std::string error;
  if (!BridgeRequest::decode(packet, &request, &error))
  {
    handlers_.log("a process of this device sent a request that cannot be read (" + error +
                  "): it is of another build");
    return;
  }
  switch (request.kind)
  {
    case BridgeRequest::LINK:
      break;  // comes through a ProcessPair
    case BridgeRequest::TUNNEL:
      handlers_.open_tunnel(std::move(channel), request);
      break;
    case BridgeRequest::STATUS:
      answerStatus(&channel);
      break;
    case BridgeRequest::PING:
      channel.sendBytes(packet.data(), packet.size());
      break;
  }
}

void LocalRequests::answerStatus(SideChannel* channel) const
{
  const std::string text = handlers_.status();
  const FileDescriptor memory(memfd_create("pi_os_status", MFD_CLOEXEC));
  if (!memory || write(memory.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()))
  {
    return;
  }
  lseek(memory.get(), 0, SEEK_SET);
  const std::vector<uint8_t> packet = BridgeRequest().encode();
  channel->sendBytes(packet.data(), packet.size(), {memory.get()});
}

}  // namespace pi_os_transport
