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

/// How long no process is accepted after there was no descriptor for one.
constexpr std::chrono::milliseconds ACCEPT_AGAIN{100};

/// Sends this process's state. Sends nothing if the peer has left or there is no memory.
void answerQuery(SideChannel* channel)
{
  const std::string state = describeProcess();
  std::string error;
  const FileDescriptor memory = makeSharedMemory("pi_os_state", state.size(), &error);
  if (memory && pwrite(memory.get(), state.data(), state.size(), 0) == static_cast<ssize_t>(state.size()))
  {
    channel->send(Packet::of(Packet::STATE, 0, state.size()), {memory.get()});
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
    const std::string shortage = describeShortage(errno);
    warnOfShortage("cannot open a local socket for shared memory: " +
                   (shortage.empty() ? std::string(std::strerror(errno)) : shortage));
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
    const auto channel = std::make_shared<SideChannel>(std::move(accepted));
    watch(channel->fd(), [this, channel](int) { onFirstPacket(channel); });
  }
  const std::string shortage = describeShortage(errno);
  if (!shortage.empty())
  {
    // The socket stays readable, and the network thread must not spin.
    warnOfShortage(shortage);
    unwatch(listener_.fd());
    accept_again_ = std::chrono::steady_clock::now() + ACCEPT_AGAIN;
    static std::once_flag polling;
    // roscpp's network thread calls its listeners at least every 100 ms.
    std::call_once(polling,
                   [this]() { ros::PollManager::instance()->addPollThreadListener([this]() { resumeAccepting(); }); });
  }
}

void Runtime::resumeAccepting()
{
  if (active() && accept_again_.time_since_epoch().count() != 0 && std::chrono::steady_clock::now() >= accept_again_)
  {
    accept_again_ = {};
    watch(listener_.fd(), [this](int) { acceptAll(); });
  }
}

void Runtime::onFirstPacket(const std::shared_ptr<SideChannel>& channel)
{
  Packet packet;
  const ssize_t length = recv(channel->fd(), &packet, sizeof(packet), MSG_PEEK | MSG_DONTWAIT);
  if (length < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR))
  {
    return;
  }
  unwatch(channel->fd());
  const bool known = length == static_cast<ssize_t>(sizeof(packet)) && packet.version == PROTOCOL_VERSION;
  if (known && packet.type == Packet::QUERY)
  {
    SideChannel::Descriptors descriptors;
    channel->receive(&packet, &descriptors);  // an unread packet would reset the connection
    answerQuery(channel.get());
  }
  else if (known && packet.type == Packet::MEET)
  {
    addPair(std::move(*channel), Token{packet.values[0], packet.values[1]}, false);
  }
  channel->close();
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
    const std::shared_ptr<const Pairs> all = pairs();
    for (const std::shared_ptr<ProcessPair>& pair : *all)
    {
      pair->retire(retired);
    }
  }
}

}  // namespace pi_os_transport
