#include "bridge_client.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <ros/poll_manager.h>
#include <sys/socket.h>

#include <utility>

#include "receive_link.h"
#include "runtime.h"

namespace pi_os_transport
{
namespace
{

constexpr std::chrono::milliseconds RETRY{300};
constexpr int TUNNEL_TIMEOUT_MS = 100;

}  // namespace

BridgeClient& BridgeClient::instance()
{
  static BridgeClient* client = new BridgeClient;
  return *client;
}

void BridgeClient::want(const std::shared_ptr<ReceiveLink>& link)
{
  if (Runtime::instance().options.bridge.empty())
  {
    return;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  wanting_.push_back(link);
  if (!std::exchange(polling_, true))
  {
    // roscpp's network thread comes round at least every 100 ms.
    ros::PollManager::instance()->addPollThreadListener([this]() { poll(); });
  }
}

void BridgeClient::poll()
{
  std::vector<std::weak_ptr<ReceiveLink>> links;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (wanting_.empty() || !Runtime::instance().active())
    {
      return;
    }
    const auto now = std::chrono::steady_clock::now();
    if (now < next_try_)
    {
      return;
    }
    next_try_ = now + RETRY;
    links.swap(wanting_);
  }
  for (size_t index = 0; index < links.size(); ++index)
  {
    const std::shared_ptr<ReceiveLink> link = links[index].lock();
    if (link && !link->askBridge())
    {
      std::lock_guard<std::mutex> lock(mutex_);
      wanting_.insert(wanting_.end(), links.begin() + static_cast<std::ptrdiff_t>(index), links.end());
      return;  // nobody is there; the others need not ask
    }
  }
}

SideChannel BridgeClient::connect(const BridgeRequest& request) const
{
  const std::string& bridge = Runtime::instance().options.bridge;
  SideChannel channel = bridge.empty() ? SideChannel() : SideChannel::connect(BridgeRequest::socketName(bridge));
  const std::vector<uint8_t> packet = request.encode();
  return channel && packet.size() <= BridgeRequest::LONGEST && channel.sendBytes(packet.data(), packet.size())
             ? std::move(channel)
             : SideChannel();
}

FileDescriptor BridgeClient::openTunnel(const std::string& address, uint16_t port, const std::string& service) const
{
  BridgeRequest request;
  request.kind = BridgeRequest::TUNNEL;
  request.address = address;
  request.port = port;
  request.service = service;
  SideChannel channel = connect(request);
  if (!channel)
  {
    return FileDescriptor();
  }
  pollfd answer{channel.fd(), POLLIN, 0};
  Packet packet;
  std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS> descriptors;
  if (::poll(&answer, 1, TUNNEL_TIMEOUT_MS) != 1 ||
      channel.receive(&packet, &descriptors) != SideChannel::Receive::PACKET || packet.type != Packet::OFFER)
  {
    return FileDescriptor();
  }
  return std::move(descriptors[0]);
}

std::string BridgeClient::peerAddress(int socket)
{
  sockaddr_storage storage{};
  socklen_t length = sizeof(storage);
  if (getpeername(socket, reinterpret_cast<sockaddr*>(&storage), &length) != 0)
  {
    return "";
  }
  in_addr address{};
  if (storage.ss_family == AF_INET)
  {
    address = reinterpret_cast<const sockaddr_in&>(storage).sin_addr;
  }
  else if (storage.ss_family == AF_INET6)
  {
    const in6_addr& wide = reinterpret_cast<const sockaddr_in6&>(storage).sin6_addr;
    if (!IN6_IS_ADDR_V4MAPPED(&wide))
    {
      return "";
    }
    std::memcpy(&address, wide.s6_addr + 12, sizeof(address));
  }
  char text[INET_ADDRSTRLEN];
  const bool loopback = ntohl(address.s_addr) >> 24 == IN_LOOPBACKNET;
  return address.s_addr != 0 && !loopback && inet_ntop(AF_INET, &address, text, sizeof(text)) != nullptr ? text : "";
}

}  // namespace pi_os_transport
