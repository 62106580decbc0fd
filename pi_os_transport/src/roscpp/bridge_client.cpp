#include "roscpp/bridge_client.h"

#include <netinet/in.h>
#include <poll.h>
#include <ros/console.h>
#include <ros/network.h>
#include <ros/poll_manager.h>
#include <sys/socket.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "roscpp/runtime.h"
#include "roscpp/topics/receive_link.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

constexpr std::chrono::milliseconds RETRY{300};
constexpr size_t MOST_WARNINGS = 1000;
constexpr int TUNNEL_TIMEOUT_MS = 600;  // the bridge itself waits 500 ms for the other one
constexpr std::chrono::milliseconds PROBE_TIME{500};
constexpr std::chrono::milliseconds PING_INTERVAL{500};
constexpr std::chrono::milliseconds PING_TIMEOUT{1000};

/// Empty for a loopback address, which cannot be another device.
std::string foreignAddress(const std::string& address)
{
  return parseIpv4(address).value_or(INADDR_ANY) == INADDR_ANY || isLoopbackAddress(address) ? "" : address;
}

}  // namespace

BridgeClient& BridgeClient::instance()
{
  static BridgeClient* client = new BridgeClient;
  return *client;
}

void BridgeClient::want(const std::shared_ptr<ReceiveLink>& link, std::chrono::milliseconds delay)
{
  if (Runtime::instance().options.bridge.empty())
  {
    return;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  wishes_.push_back(Wish{link, std::chrono::steady_clock::now() + delay});
  startPolling();
}

void BridgeClient::guard(const boost::shared_ptr<ros::TransportTCP>& transport)
{
  std::lock_guard<std::mutex> lock(mutex_);
  tunnels_.push_back(transport);
  startPolling();
}

void BridgeClient::startPolling()
{
  if (!std::exchange(polling_, true))
  {
    // roscpp's network thread calls its listeners at least every 100 ms.
    ros::PollManager::instance()->addPollThreadListener([this]() { poll(); });
  }
}

void BridgeClient::poll()
{
  if (Runtime::instance().active())
  {
    pollWishes();
    pollTunnels();
    pollReconnects();
  }
}

void BridgeClient::reconnect(const ros::ConnectionPtr& connection)
{
  const auto transport = boost::dynamic_pointer_cast<ros::TransportTCP>(connection->getTransport());
  Reconnect wish{connection, {}, sizeof(sockaddr_storage), FileDescriptor(), {}};
  if (!transport || getpeername(transport->sock_, reinterpret_cast<sockaddr*>(&wish.address), &wish.length) != 0)
  {
    return;  // the connection has ended already
  }
  std::lock_guard<std::mutex> lock(mutex_);
  reconnects_.push_back(std::move(wish));
  startPolling();
}

void BridgeClient::pollReconnects()
{
  std::vector<Reconnect> wishes;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    wishes.swap(reconnects_);
  }
  const auto now = std::chrono::steady_clock::now();
  for (Reconnect& wish : wishes)
  {
    const ros::ConnectionPtr connection = wish.connection.lock();
    const std::shared_ptr<ReceiveLink> link = Runtime::instance().receive_links.find(connection.get());
    if (!connection || connection->isDropped() || (link && link->active()))
    {
      continue;  // ended, or the bridges carry the same link again
    }
    pollfd ready{wish.probe.get(), POLLOUT, 0};
    if (wish.probe && ::poll(&ready, 1, 0) == 1)
    {
      int error = 0;
      socklen_t length = sizeof(error);
      if (getsockopt(wish.probe.get(), SOL_SOCKET, SO_ERROR, &error, &length) == 0 && error == 0)
      {
        connection->drop(ros::Connection::TransportDisconnect);
        continue;
      }
      wish.probe.reset();
    }
    if (!wish.probe || now > wish.until)
    {
      wish.until = now + PROBE_TIME;
      wish.probe = FileDescriptor(socket(wish.address.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
      if (::connect(wish.probe.get(), reinterpret_cast<const sockaddr*>(&wish.address), wish.length) != 0 &&
          errno != EINPROGRESS)
      {
        wish.probe.reset();  // the network is down: try again soon
      }
    }
    std::lock_guard<std::mutex> lock(mutex_);
    reconnects_.push_back(std::move(wish));
  }
}

void BridgeClient::pollTunnels()
{
  std::vector<boost::weak_ptr<ros::TransportTCP>> tunnels;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    tunnels_.erase(std::remove_if(tunnels_.begin(), tunnels_.end(),
                                  [](const boost::weak_ptr<ros::TransportTCP>& tunnel)
                                  {
                                    const boost::shared_ptr<ros::TransportTCP> transport = tunnel.lock();
                                    return !transport || transport->closed_;
                                  }),
                   tunnels_.end());
    tunnels = tunnels_;
  }
  const auto now = std::chrono::steady_clock::now();
  if (tunnels.empty())
  {
    ping_.close();
    return;
  }
  if (!ping_)
  {
    if (now - ping_time_ >= PING_INTERVAL)
    {
      BridgeRequest request;
      request.kind = BridgeRequest::PING;
      ping_ = connect(request);  // without a bridge the tunnels end anyway
      ping_time_ = now;
    }
    return;
  }
  std::vector<uint8_t> answer;
  SideChannel::Descriptors descriptors;
  if (ping_.receiveBytes(&answer, BridgeRequest::LONGEST, &descriptors) != SideChannel::Receive::NOTHING)
  {
    ping_.close();
    return;
  }
  if (now - ping_time_ > PING_TIMEOUT)
  {
    ping_.close();
    for (const boost::weak_ptr<ros::TransportTCP>& tunnel : tunnels)
    {
      if (const boost::shared_ptr<ros::TransportTCP> transport = tunnel.lock())
      {
        transport->close();
      }
    }
  }
}

void BridgeClient::pollWishes()
{
  std::vector<Wish> due;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const auto now = std::chrono::steady_clock::now();
    if (wishes_.empty() || now < next_try_)
    {
      return;
    }
    next_try_ = now + RETRY;
    const auto first_due =
        std::partition(wishes_.begin(), wishes_.end(), [now](const Wish& wish) { return wish.not_before > now; });
    due.assign(first_due, wishes_.end());
    wishes_.erase(first_due, wishes_.end());
  }
  for (size_t index = 0; index < due.size(); ++index)
  {
    const std::shared_ptr<ReceiveLink> link = due[index].link.lock();
    if (link && !link->askBridge())
    {
      std::lock_guard<std::mutex> lock(mutex_);
      wishes_.insert(wishes_.end(), due.begin() + static_cast<std::ptrdiff_t>(index), due.end());
      return;  // no bridge runs; the others need not ask
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

FileDescriptor BridgeClient::openTunnel(const std::string& host, uint16_t port, const std::string& service) const
{
  BridgeRequest request;
  request.kind = BridgeRequest::TUNNEL;
  if (!Runtime::instance().options.bridge.empty() && host != ros::network::getHost())
  {
    request.address = foreignAddress(hostAddress(host).value_or(""));
  }
  if (request.address.empty())
  {
    return FileDescriptor();
  }
  request.port = port;
  request.service = service;
  SideChannel channel = connect(request);
  if (!channel)
  {
    return FileDescriptor();
  }
  pollfd answer{channel.fd(), POLLIN, 0};
  Packet packet;
  SideChannel::Descriptors descriptors;
  if (::poll(&answer, 1, TUNNEL_TIMEOUT_MS) != 1 ||
      channel.receive(&packet, &descriptors) != SideChannel::Receive::PACKET || packet.type != Packet::OFFER)
  {
    return FileDescriptor();
  }
  return std::move(descriptors[0]);
}

bool BridgeClient::isRequiredFor(const ros::ConnectionPtr& connection)
{
  const Runtime& runtime = Runtime::instance();
  if (!runtime.active() || !runtime.options.require_bridge)
  {
    return false;
  }
  const auto tcp = boost::dynamic_pointer_cast<ros::TransportTCP>(connection->getTransport());
  sockaddr_storage own{};
  sockaddr_storage other{};
  socklen_t own_length = sizeof(own);
  socklen_t other_length = sizeof(other);
  if (!tcp || getsockname(tcp->sock_, reinterpret_cast<sockaddr*>(&own), &own_length) != 0 ||
      getpeername(tcp->sock_, reinterpret_cast<sockaddr*>(&other), &other_length) != 0)
  {
    return true;  // it cannot be told
  }
  const std::string address = peerAddress(tcp->sock_);
  if (!address.empty())
  {
    return !isLocalAddress(address);
  }
  // A loopback address, or one of IPv6: on one device both ends have the same.
  return own.ss_family == AF_INET6 &&
         std::memcmp(&reinterpret_cast<const sockaddr_in6&>(own).sin6_addr,
                     &reinterpret_cast<const sockaddr_in6&>(other).sin6_addr, sizeof(in6_addr)) != 0;
}

bool BridgeClient::isRequiredFor(const std::string& host)
{
  const Runtime& runtime = Runtime::instance();
  if (!runtime.active() || !runtime.options.require_bridge || host == ros::network::getHost())
  {
    return false;
  }
  const std::optional<std::string> address = hostAddress(host);
  return !address || !(isLoopbackAddress(*address) || isLocalAddress(*address));
}

void BridgeClient::warnOfRequired(const std::string& subject, const std::string& text)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (warned_.size() < MOST_WARNINGS && warned_.insert(subject).second)
  {
    ROS_WARN("pi_os_transport: PI_OS_REQUIRE_BRIDGE is set: %s", text.c_str());
  }
}

std::string BridgeClient::peerAddress(int socket)
{
  sockaddr_storage storage{};
  socklen_t length = sizeof(storage);
  if (getpeername(socket, reinterpret_cast<sockaddr*>(&storage), &length) != 0)
  {
    return "";
  }
  sockaddr_in address{};
  if (storage.ss_family == AF_INET)
  {
    address = reinterpret_cast<const sockaddr_in&>(storage);
  }
  else if (storage.ss_family == AF_INET6)
  {
    const in6_addr& wide = reinterpret_cast<const sockaddr_in6&>(storage).sin6_addr;
    if (!IN6_IS_ADDR_V4MAPPED(&wide))
    {
      return "";
    }
    std::memcpy(&address.sin_addr, wide.s6_addr + 12, sizeof(address.sin_addr));
  }
  return foreignAddress(addressText(address));
}

}  // namespace pi_os_transport
