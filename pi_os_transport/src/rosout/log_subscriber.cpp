#include "rosout/log_subscriber.h"

#include <sys/epoll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <optional>
#include <utility>

#include "event_loop/if_alive.h"
#include "event_loop/socket_io.h"
#include "master/rpc_encoder.h"
#include "rosout/log_message.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t CHUNK_BYTES = 16 * 1024;
constexpr size_t MOST_MESSAGE_BYTES = 16 * 1024 * 1024;  // a longer message ends the connection
constexpr std::chrono::milliseconds CONNECTING{20000};   // until the header was received
constexpr std::chrono::milliseconds FIRST_PAUSE{100};    // before the next attempt; doubled after each failure
constexpr std::chrono::milliseconds LONGEST_PAUSE{20000};

}  // namespace

LogSubscriber::LogSubscriber(EventLoop* loop, NodeCalls* calls, std::string node, std::string topic, Received received)
  : loop_(loop)
  , calls_(calls)
  , resolver_(loop)
  , node_(std::move(node))
  , topic_(std::move(topic))
  , received_(std::move(received))
{
}

LogSubscriber::~LogSubscriber()
{
  for (const auto& [api, publisher] : publishers_)
  {
    close(publisher);
  }
}

void LogSubscriber::setPublishers(const std::set<std::string>& apis)
{
  for (auto at = publishers_.begin(); at != publishers_.end();)
  {
    if (apis.count(at->first) == 0)
    {
      close(at->second);
      at = publishers_.erase(at);
    }
    else
    {
      ++at;
    }
  }
  for (const std::string& api : apis)
  {
    PublisherPtr& publisher = publishers_[api];
    if (publisher == nullptr)
    {
      publisher = std::make_shared<Publisher>();
      publisher->api = api;
      publisher->id = next_id_++;
      ask(publisher);
    }
  }
}

/// Asks the publisher for the port of its TCPROS server.
void LogSubscriber::ask(const PublisherPtr& publisher)
{
  const auto body = std::make_shared<const std::string>(
      encodeRpcCall("requestTopic", {node_, topic_, RpcValue::Array{RpcValue(RpcValue::Array{RpcValue("TCPROS")})}}));
  calls_->call(publisher->api, {body, "",
                                ifAlive(publisher, [this](const PublisherPtr& asked, const RpcResponse* response)
                                        { onAnswer(asked, response); })});
}

void LogSubscriber::onAnswer(const PublisherPtr& publisher, const RpcResponse* response)
{
  // [1, message, ["TCPROS", host, port]]
  const RpcValue::Array* const answer = response != nullptr ? response->value.array() : nullptr;
  const RpcValue::Array* const protocol = answer != nullptr && answer->size() == 3 ? answer->back().array() : nullptr;
  if (protocol == nullptr || protocol->size() != 3 || !(*protocol)[1].is<std::string>() ||
      !(*protocol)[2].is<int32_t>())
  {
    tryAgain(publisher);
    return;
  }
  publisher->timer.start(loop_, CONNECTING, ifAlive(publisher, [this](const PublisherPtr& late) { tryAgain(late); }));
  resolver_.resolve((*protocol)[1].as<std::string>(), static_cast<uint16_t>((*protocol)[2].as<int32_t>()),
                    ifAlive(publisher,
                            [this](const PublisherPtr& found, const SocketAddress& address)
                            {
                              if (!found->socket)
                              {
                                connect(found, address);
                              }
                            }));
}

void LogSubscriber::connect(const PublisherPtr& publisher, const SocketAddress& address)
{
  publisher->socket = beginConnecting(address.get(), address.size);
  if (!publisher->socket)
  {
    tryAgain(publisher);
    return;
  }
  setOption(publisher->socket.get(), SOL_SOCKET, SO_KEEPALIVE, 1);
  publisher->reader = TcprosReader(MOST_MESSAGE_BYTES);
  publisher->out = encodeTcprosHeader({{"callerid", node_},
                                       {"topic", topic_},
                                       {"type", LogType::name()},
                                       {"md5sum", LogType::md5sum()},
                                       {"tcp_nodelay", "0"}});
  loop_->add(publisher->socket.get(), EPOLLOUT,
             ifAlive(publisher, [this](const PublisherPtr& ready, uint32_t events) { onReady(ready, events); }));
}

void LogSubscriber::onReady(const PublisherPtr& publisher, uint32_t events)
{
  if (!publisher->out.empty() && (events & (EPOLLERR | EPOLLHUP)) == 0)
  {
    introduce(publisher);
  }
  else
  {
    receive(publisher);
  }
}

void LogSubscriber::introduce(const PublisherPtr& publisher)
{
  size_t sent = 0;
  const SendResult result = sendRest(publisher->socket.get(), publisher->out, &sent);
  publisher->out.erase(0, sent);
  if (result == SendResult::FAILED)
  {
    tryAgain(publisher);
  }
  else if (result == SendResult::DONE)
  {
    loop_->change(publisher->socket.get(), EPOLLIN);
  }
}

void LogSubscriber::receive(const PublisherPtr& publisher)
{
  std::array<char, CHUNK_BYTES> chunk;
  const ssize_t size = recv(publisher->socket.get(), chunk.data(), chunk.size(), 0);
  if (size < 0 && (errno == EAGAIN || errno == EINTR))
  {
    return;
  }
  if (size > 0)
  {
    publisher->reader.feed(std::string_view(chunk.data(), static_cast<size_t>(size)));
  }
  if (size <= 0 || !takeParts(publisher))
  {
    tryAgain(publisher);
  }
}

/// @return false if the publisher refuses this subscriber, or sends invalid data.
bool LogSubscriber::takeParts(const PublisherPtr& publisher)
{
  while (const std::optional<std::string_view> part = publisher->reader.next())
  {
    if (publisher->is_connected)
    {
      publisher->bytes += static_cast<double>(part->size());
      ++publisher->messages;
      received_(*part);
      continue;
    }
    const std::optional<TcprosHeader> header = decodeTcprosHeader(*part);
    if (!header || header->count("error") != 0)
    {
      return false;
    }
    publisher->is_connected = true;
    publisher->failures = 0;
    publisher->timer.stop();
  }
  return !publisher->reader.isBroken();
}

void LogSubscriber::tryAgain(const PublisherPtr& publisher)
{
  close(publisher);
  const auto pause = std::min(FIRST_PAUSE * (1 << std::min(publisher->failures, 10)), LONGEST_PAUSE);
  ++publisher->failures;
  publisher->timer.start(loop_, pause, ifAlive(publisher, [this](const PublisherPtr& again) { ask(again); }));
}

void LogSubscriber::close(const PublisherPtr& publisher)
{
  publisher->timer.stop();
  if (publisher->socket)
  {
    loop_->remove(publisher->socket.get());
    publisher->socket.reset();
  }
  publisher->is_connected = false;
}

RpcValue::Array LogSubscriber::busInfo() const
{
  RpcValue::Array info;
  for (const auto& [api, publisher] : publishers_)
  {
    info.emplace_back(
        RpcValue::Array{publisher->id, publisher->api, "i", "TCPROS", topic_, publisher->is_connected ? 1 : 0});
  }
  return info;
}

RpcValue LogSubscriber::busStats() const
{
  RpcValue::Array links;
  for (const auto& [api, publisher] : publishers_)
  {
    links.emplace_back(
        RpcValue::Array{publisher->id, publisher->bytes, publisher->messages, 0, publisher->is_connected ? 1 : 0});
  }
  return RpcValue::Array{topic_, std::move(links)};
}

}  // namespace pi_os_transport
