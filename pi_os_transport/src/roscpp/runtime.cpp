#include "roscpp/runtime.h"

#include <poll.h>
#include <ros/console.h>
#include <ros/poll_manager.h>
#include <ros/transport/transport_tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <utility>
#include <vector>

#include "roscpp/process_state.h"
#include "roscpp/topics/header_offer.h"
#include "shm/shared_memory.h"

namespace pi_os_transport
{
namespace
{

/// Sends this process's state. Sends nothing if the peer has left or there is no memory.
void answerQuery(SideChannel* channel)
{
  const std::string state = describeProcess();
  std::string error;
  const FileDescriptor memory = makeSharedMemory("pi_os_state", state.size(), &error);
  if (memory && pwrite(memory.get(), state.data(), state.size(), 0) == static_cast<ssize_t>(state.size()))
  {
    channel->send(Packet::of(Packet::STATE, state.size()), {memory.get()});
  }
}

void releaseToPool(void* payload)
{
  Runtime::instance().pool().release(static_cast<const uint8_t*>(payload));
}

}  // namespace

void dropIfSilent(const ros::ConnectionPtr& connection)
{
  if (!connection || connection->isDropped())
  {
    return;
  }
  const auto transport = boost::dynamic_pointer_cast<ros::TransportTCP>(connection->getTransport());
  char byte;
  if (transport && recv(transport->sock_, &byte, 1, MSG_PEEK | MSG_DONTWAIT) < 0 && errno == EAGAIN)
  {
    connection->drop(ros::Connection::TransportDisconnect);
  }
}

Runtime& Runtime::instance()
{
  static Runtime* runtime = new Runtime;
  return *runtime;
}

SlotPool& Runtime::pool()
{
  std::call_once(pool_made_,
                 [this]()
                 {
                   pool_ = std::make_unique<SlotPool>(options.pool_limit_mb << 20);
                   pool_->setReclaim([this]() { collectReleased(); });
                   shim->set_pool(pool_->base(), pool_->reserved(), releaseToPool);
                 });
  return *pool_;
}

void Runtime::watch(int fd, const boost::function<void(int)>& ready)
{
  ros::PollSet& poll_set = ros::PollManager::instance()->getPollSet();
  poll_set.addSocket(fd, ready);
  poll_set.addEvents(fd, POLLIN);
}

void Runtime::unwatch(int fd)
{
  ros::PollManager::instance()->getPollSet().delSocket(fd);
}

bool Runtime::listen()
{
  std::lock_guard<std::mutex> lock(listen_mutex_);
  return listenLocked();
}

bool Runtime::listenLocked()
{
  if (listener_)
  {
    return true;
  }
  socket_token_ = Token::random();
  listener_ = SideChannel::listen(HeaderOffer::socketName(socket_token_));
  if (!listener_)
  {
    ROS_WARN_ONCE(
        "pi_os_transport: cannot open a local socket for shared memory (%s); topics and services of this "
        "node stay on TCPROS. Raise its limit of open files (ulimit -n)",
        std::strerror(errno));
    return false;
  }
  watch(listener_.fd(), [this](int) { acceptAll(); });
  return true;
}

std::string Runtime::expect(const Token& link, Claim claim)
{
  std::lock_guard<std::mutex> lock(listen_mutex_);
  if (!listenLocked())
  {
    return "";
  }
  expected_[link] = std::move(claim);
  return HeaderOffer{socket_token_, link}.toString();
}

void Runtime::forget(const Token& link)
{
  std::lock_guard<std::mutex> lock(listen_mutex_);
  expected_.erase(link);
}

void Runtime::acceptAll()
{
  while (SideChannel accepted = listener_.accept())
  {
    auto channel = std::make_shared<SideChannel>(std::move(accepted));
    const int fd = channel->fd();
    watch(fd,
          [this, channel, fd](int)
          {
            Packet packet;
            SideChannel::Descriptors descriptors;
            const SideChannel::Receive result = channel->receive(&packet, &descriptors);
            if (result == SideChannel::Receive::NOTHING)
            {
              return;
            }
            unwatch(fd);
            if (result == SideChannel::Receive::PACKET && packet.type == Packet::QUERY)
            {
              answerQuery(channel.get());
            }
            Claim claim;
            const bool bridge = packet.values[2] != 0;
            if (result == SideChannel::Receive::PACKET && packet.type == Packet::HELLO &&
                !(bridge && options.bridge.empty()))
            {
              std::lock_guard<std::mutex> lock(listen_mutex_);
              const auto found = expected_.find(Token{packet.values[0], packet.values[1]});
              if (found != expected_.end())
              {
                claim = found->second;  // not erased: a bridge may connect again
              }
            }
            if (claim)
            {
              claim(std::move(*channel), packet, &descriptors);
            }
            channel->close();
          });
  }
}

void Runtime::addChannel(const std::shared_ptr<PoolLink>& link)
{
  std::lock_guard<std::mutex> lock(channels_mutex_);
  channels_.insert(link);
}

void Runtime::removeChannel(const std::shared_ptr<PoolLink>& link)
{
  {
    std::lock_guard<std::mutex> lock(channels_mutex_);
    channels_.erase(link);
    if (!channels_.empty())
    {
      return;
    }
  }
  pool().trim();  // no subscriber is left
}

std::vector<std::shared_ptr<PoolLink>> Runtime::channels() const
{
  std::lock_guard<std::mutex> lock(channels_mutex_);
  return std::vector<std::shared_ptr<PoolLink>>(channels_.begin(), channels_.end());
}

void Runtime::collectReleased()
{
  for (const std::shared_ptr<PoolLink>& link : channels())
  {
    link->collectReleased();
  }
}

void Runtime::announceRetired()
{
  const std::vector<uint32_t> retired = pool().takeRetired();
  if (!retired.empty())
  {
    for (const std::shared_ptr<PoolLink>& link : channels())
    {
      link->retire(retired);
    }
  }
}

}  // namespace pi_os_transport
