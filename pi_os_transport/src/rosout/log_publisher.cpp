#include "rosout/log_publisher.h"

#include <sys/epoll.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <optional>
#include <utility>

#include "event_loop/if_alive.h"
#include "event_loop/socket_io.h"
#include "pi_os_transport/little_endian.h"
#include "rosout/log_message.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MOST_HEADER_BYTES = 64 * 1024;
constexpr size_t MOST_SUBSCRIBERS = 256;
constexpr size_t MOST_QUEUED_BYTES = 4 * 1024 * 1024;  // for one subscriber
constexpr std::chrono::milliseconds INTRODUCTION{10000};

std::string valueOf(const TcprosHeader& header, const char* name)
{
  const auto found = header.find(name);
  return found == header.end() ? std::string() : found->second;
}

}  // namespace

LogPublisher::LogPublisher(EventLoop* loop, const std::string& address, std::string node, std::string topic)
  : loop_(loop), node_(std::move(node)), topic_(std::move(topic)), listener_(loop, address, 0)
{
  listener_.start([this](FileDescriptor socket) { add(std::move(socket)); }, [] { return false; });
}

LogPublisher::~LogPublisher()
{
  disconnectAll();
}

void LogPublisher::disconnectAll()
{
  while (!subscribers_.empty())
  {
    drop(subscribers_.front());
  }
}

void LogPublisher::add(FileDescriptor socket)
{
  if (subscribers_.size() >= MOST_SUBSCRIBERS)
  {
    return;  // closes the socket; the subscriber tries again
  }
  auto subscriber = std::make_shared<Subscriber>();
  subscriber->id = next_id_++;
  subscriber->socket = std::move(socket);
  subscriber->reader = TcprosReader(MOST_HEADER_BYTES);
  subscriber->place = subscribers_.insert(subscribers_.end(), subscriber);
  loop_->add(subscriber->socket.get(), EPOLLIN,
             [this, subscriber = subscriber.get()](uint32_t events) { onReady(*subscriber->place, events); });
  subscriber->deadline.start(loop_, INTRODUCTION,
                             ifAlive(subscriber, [this](const SubscriberPtr& late) { drop(late); }));
}

void LogPublisher::onReady(const SubscriberPtr& watched, uint32_t events)
{
  const SubscriberPtr subscriber = watched;
  if (events & (EPOLLIN | EPOLLHUP | EPOLLERR))
  {
    receive(subscriber);
  }
  if (subscriber->socket && (events & EPOLLOUT))
  {
    send(subscriber);
  }
}

void LogPublisher::receive(const SubscriberPtr& subscriber)
{
  std::array<char, 4096> chunk;
  const ssize_t size = recv(subscriber->socket.get(), chunk.data(), chunk.size(), 0);
  if (size < 0 && (errno == EAGAIN || errno == EINTR))
  {
    return;
  }
  // A subscriber sends nothing after its header.
  if (size <= 0 || !subscriber->node.empty() || subscriber->closes)
  {
    drop(subscriber);
    return;
  }
  subscriber->reader.feed(std::string_view(chunk.data(), static_cast<size_t>(size)));
  if (const std::optional<std::string_view> part = subscriber->reader.next())
  {
    welcome(subscriber, decodeTcprosHeader(*part).value_or(TcprosHeader()));
  }
  else if (subscriber->reader.isBroken())
  {
    drop(subscriber);
  }
}

void LogPublisher::welcome(const SubscriberPtr& subscriber, const TcprosHeader& header)
{
  const std::string topic = valueOf(header, "topic");
  const std::string md5sum = valueOf(header, "md5sum");
  const std::string node = valueOf(header, "callerid");
  std::string error;
  if (topic != topic_)
  {
    error = "received a connection for a nonexistent topic [" + topic + "]; " + topic_ + " is published here";
  }
  else if (md5sum != "*" && md5sum != LogType::md5sum())
  {
    error = "Client [" + node + "] wants topic " + topic_ + " to have datatype/md5sum [" + valueOf(header, "type") +
            "/" + md5sum + "], but our version has [" + LogType::name() + "/" + LogType::md5sum() +
            "]. Dropping connection.";
  }
  const TcprosHeader answer = error.empty() ? TcprosHeader{{"callerid", node_},
                                                           {"topic", topic_},
                                                           {"type", LogType::name()},
                                                           {"md5sum", LogType::md5sum()},
                                                           {"message_definition", LogType::definition()},
                                                           {"latching", "0"}}
                                            : TcprosHeader{{"error", error}};
  subscriber->closes = !error.empty();
  if (error.empty())
  {
    subscriber->deadline.stop();
    subscriber->node = node.empty() ? "unknown" : node;
  }
  enqueue(subscriber, std::make_shared<const std::string>(encodeTcprosHeader(answer)));
}

void LogPublisher::publish(std::string_view message)
{
  constexpr size_t LENGTH_BYTES = 4;
  ++sequence_;
  std::array<uint8_t, 2 * LENGTH_BYTES> start;
  if (message.size() < LENGTH_BYTES || subscribers_.empty())
  {
    return;
  }
  storeLittleEndian(start.data(), static_cast<uint32_t>(message.size()));
  storeLittleEndian(start.data() + LENGTH_BYTES, sequence_ - 1);
  auto frame = std::make_shared<std::string>(start.begin(), start.end());
  frame->append(message.substr(LENGTH_BYTES));
  for (auto at = subscribers_.begin(); at != subscribers_.end();)
  {
    const SubscriberPtr subscriber = *at++;  // sending may drop the subscriber
    if (!subscriber->node.empty())
    {
      ++subscriber->messages;
      subscriber->bytes += static_cast<double>(message.size());
      enqueue(subscriber, frame);
    }
  }
}

void LogPublisher::enqueue(const SubscriberPtr& subscriber, const Frame& frame)
{
  subscriber->queue.push_back(frame);
  subscriber->queued_bytes += frame->size();
  while (subscriber->queued_bytes > MOST_QUEUED_BYTES && subscriber->queue.size() > 2)
  {
    const auto oldest = subscriber->queue.begin() + 1;  // the first one may be partly sent
    subscriber->queued_bytes -= (*oldest)->size();
    subscriber->queue.erase(oldest);
  }
  if (subscriber->queue.size() == 1)
  {
    send(subscriber);
  }
}

void LogPublisher::send(const SubscriberPtr& subscriber)
{
  while (!subscriber->queue.empty())
  {
    const std::string& frame = *subscriber->queue.front();
    switch (sendRest(subscriber->socket.get(), frame, &subscriber->sent))
    {
      case SendResult::BLOCKED:
        loop_->change(subscriber->socket.get(), EPOLLIN | EPOLLOUT);
        return;
      case SendResult::FAILED:
        drop(subscriber);
        return;
      case SendResult::DONE:
        subscriber->queued_bytes -= frame.size();
        subscriber->queue.pop_front();
        subscriber->sent = 0;
        break;
    }
  }
  if (subscriber->closes)
  {
    drop(subscriber);
    return;
  }
  loop_->change(subscriber->socket.get(), EPOLLIN);
}

void LogPublisher::drop(const SubscriberPtr& dropped)
{
  const SubscriberPtr subscriber = dropped;
  if (!subscriber->socket)
  {
    return;
  }
  subscriber->deadline.stop();
  loop_->remove(subscriber->socket.get());
  subscriber->socket.reset();
  subscribers_.erase(subscriber->place);
}

RpcValue::Array LogPublisher::busInfo() const
{
  RpcValue::Array info;
  for (const SubscriberPtr& subscriber : subscribers_)
  {
    if (!subscriber->node.empty())
    {
      info.emplace_back(RpcValue::Array{subscriber->id, subscriber->node, "o", "TCPROS", topic_, 1});
    }
  }
  return info;
}

RpcValue LogPublisher::busStats() const
{
  RpcValue::Array links;
  double bytes = 0;
  for (const SubscriberPtr& subscriber : subscribers_)
  {
    bytes += subscriber->bytes;
    links.emplace_back(RpcValue::Array{subscriber->id, subscriber->bytes, subscriber->messages, 1});
  }
  return RpcValue::Array{topic_, bytes, std::move(links)};
}

}  // namespace pi_os_transport
