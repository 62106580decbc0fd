#include "master/node_caller.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "event_loop/if_alive.h"
#include "event_loop/socket_io.h"

namespace pi_os_transport
{

NodeCaller::NodeCaller(EventLoop* loop, const NodeCallerLimits& limits) : loop_(loop), limits_(limits), resolver_(loop)
{
}

NodeCaller::~NodeCaller()
{
  for (const auto& [api, node] : nodes_)
  {
    disconnect(node);
  }
}

void NodeCaller::call(const std::string& api, NodeCall call)
{
  auto found = nodes_.find(api);
  if (found == nodes_.end())
  {
    auto node = std::make_shared<Node>();
    node->api = api;
    try
    {
      node->at = parseHttpUri(api);
    }
    catch (const std::invalid_argument&)
    {
      loop_->defer(
          [done = std::move(call.done)]
          {
            if (done)
            {
              done(nullptr);
            }
          });
      return;
    }
    found = nodes_.emplace(api, node).first;
    queue(node);
  }
  const NodePtr& node = found->second;
  if (!call.subject.empty())
  {
    const auto older = node->subjects.find(call.subject);
    if (older != node->subjects.end())
    {
      node->calls.erase(older->second);
    }
    node->calls.push_back(std::move(call));
    node->subjects[node->calls.back().subject] = std::prev(node->calls.end());
  }
  else
  {
    node->calls.push_back(std::move(call));
  }
  if (node->step == Step::IDLE && node->calls.size() == 1)
  {
    loop_->defer(ifAlive(node,
                         [this](const NodePtr& idle)
                         {
                           if (idle->step == Step::IDLE && !idle->calls.empty())
                           {
                             sendCall(idle);
                           }
                         }));
  }
}

/// Lets a node with pending calls wait for a connection, which is opened after this round of the loop at the earliest.
void NodeCaller::queue(const NodePtr& node)
{
  node->step = Step::WAITING;
  waiting_.push_back(node);
  startSoon();
}

void NodeCaller::startSoon()
{
  if (!waiting_.empty() && !is_starting_)
  {
    is_starting_ = true;
    loop_->defer(
        [this]
        {
          is_starting_ = false;
          startWaiting();
        });
  }
}

void NodeCaller::startWaiting()
{
  while (!waiting_.empty())
  {
    if (busy_ >= limits_.connections && !makeRoom())
    {
      if (!look_again_.running())
      {
        look_again_.start(loop_, limits_.patience, [this] { startWaiting(); });
      }
      return;
    }
    const NodePtr node = waiting_.front();
    waiting_.pop_front();
    ++busy_;
    connect(node);
  }
}

bool NodeCaller::makeRoom()
{
  NodePtr oldest;
  for (const auto& [api, node] : nodes_)
  {
    if (node->step == Step::IDLE && node->calls.empty())
    {
      forget(NodePtr(node));
      return true;
    }
    if (node->step != Step::WAITING && node->step != Step::IDLE && (oldest == nullptr || node->since < oldest->since))
    {
      oldest = node;
    }
  }
  if (oldest == nullptr || SteadyClock::now() - oldest->since < limits_.patience)
  {
    return false;
  }
  finish(oldest, nullptr);
  return true;
}

void NodeCaller::connect(const NodePtr& node)
{
  node->step = Step::RESOLVING;
  node->is_used = false;
  allow(node, limits_.connect);
  resolver_.resolve(node->at.host, node->at.port,
                    ifAlive(node,
                            [this](const NodePtr& resolved, const SocketAddress& address)
                            {
                              if (resolved->step == Step::RESOLVING)
                              {
                                open(resolved, address);
                              }
                            }));
}

void NodeCaller::open(const NodePtr& node, const SocketAddress& address)
{
  node->socket = beginConnecting(address.get(), address.size);
  if (!node->socket)
  {
    finish(node, nullptr);
    return;
  }
  setOption(node->socket.get(), IPPROTO_TCP, TCP_NODELAY, 1);
  node->step = Step::CONNECTING;
  loop_->add(node->socket.get(), EPOLLOUT,
             ifAlive(node, [this](const NodePtr& ready, uint32_t events) { onReady(ready, events); }));
}

void NodeCaller::onReady(const NodePtr& node, uint32_t events)
{
  switch (node->step)
  {
    case Step::CONNECTING:
      if (connectionError(node->socket.get()) != 0)
      {
        finish(node, nullptr);
      }
      else
      {
        sendCall(node);
      }
      break;
    case Step::CALLING:
      if (events & EPOLLOUT)
      {
        sendRest(node);
      }
      else
      {
        receive(node);
      }
      break;
    case Step::IDLE:
      if (node->calls.empty())
      {
        forget(node);  // the node has closed the connection, or sent unexpected data
      }
      else
      {
        disconnect(node);  // a call was added in this round
        --busy_;
        queue(node);
      }
      break;
    case Step::WAITING:
    case Step::RESOLVING:
      break;  // no socket yet
  }
}

void NodeCaller::sendCall(const NodePtr& node)
{
  const NodeCall& call = node->calls.front();
  const auto subject = node->subjects.find(call.subject);
  if (subject != node->subjects.end() && subject->second == node->calls.begin())
  {
    node->subjects.erase(subject);  // being sent: a newer call must not replace it
  }
  node->step = Step::CALLING;
  node->reader.reset();
  node->out =
      "POST / HTTP/1.1\r\nHost: " + node->at.host + ":" + std::to_string(node->at.port) +
      "\r\nUser-Agent: pi_master\r\nContent-Type: text/xml\r\nContent-Length: " + std::to_string(call.body->size()) +
      "\r\n\r\n" + *call.body;
  node->sent = 0;
  allow(node, limits_.reply);
  sendRest(node);
}

void NodeCaller::sendRest(const NodePtr& node)
{
  switch (pi_os_transport::sendRest(node->socket.get(), node->out, &node->sent))
  {
    case SendResult::BLOCKED:
      loop_->change(node->socket.get(), EPOLLOUT);
      break;
    case SendResult::FAILED:
      onBroken(node);
      break;
    case SendResult::DONE:
      node->out = std::string();
      node->sent = 0;
      loop_->change(node->socket.get(), EPOLLIN);
      break;
  }
}

void NodeCaller::receive(const NodePtr& node)
{
  std::array<char, 4096> chunk;
  const ssize_t size = recv(node->socket.get(), chunk.data(), chunk.size(), 0);
  if (size < 0 && (errno == EAGAIN || errno == EINTR))
  {
    return;
  }
  if (size > 0)
  {
    node->reader.feed(std::string_view(chunk.data(), static_cast<size_t>(size)));
  }
  else if (size == 0 && node->reader.hasBegun())
  {
    node->reader.feedEnd();
  }
  else
  {
    onBroken(node);
    return;
  }
  if (node->reader.state() == HttpReader::State::FAILED)
  {
    finish(node, nullptr);
  }
  else if (node->reader.state() == HttpReader::State::DONE)
  {
    std::optional<RpcResponse> response;
    try
    {
      response = decodeRpcResponse(node->reader.body());
    }
    catch (const RpcDecodeError&)
    {
      // An invalid answer counts as none.
    }
    finish(node, response ? &*response : nullptr);
  }
}

/// The connection has ended before the answer.
void NodeCaller::onBroken(const NodePtr& node)
{
  if (!node->is_used || node->reader.hasBegun())
  {
    finish(node, nullptr);
    return;
  }
  // A kept connection, which the node had closed before this call.
  disconnect(node);
  connect(node);
}

void NodeCaller::finish(const NodePtr& finished, const RpcResponse* response)
{
  const NodePtr node = finished;
  const bool keeps = response != nullptr && node->reader.keepsAlive();
  const NodeCall::Done done = std::move(node->calls.front().done);
  const auto subject = node->subjects.find(node->calls.front().subject);
  if (subject != node->subjects.end() && subject->second == node->calls.begin())
  {
    node->subjects.erase(subject);  // failed before it was sent
  }
  node->calls.pop_front();
  if (!keeps)
  {
    disconnect(node);
  }
  if (done)
  {
    done(response);
  }
  next(node);
}

void NodeCaller::next(const NodePtr& node)
{
  node->is_used = true;
  if (node->socket && !node->calls.empty())
  {
    sendCall(node);
  }
  else if (node->socket)
  {
    node->step = Step::IDLE;
    allow(node, limits_.idle);
  }
  else if (node->calls.empty())
  {
    forget(node);
  }
  else
  {
    node->deadline.stop();
    --busy_;
    queue(node);
  }
}

void NodeCaller::disconnect(const NodePtr& node)
{
  node->deadline.stop();
  if (node->socket)
  {
    loop_->remove(node->socket.get());
    node->socket.reset();
  }
  node->out = std::string();
  node->sent = 0;
  node->reader.reset();
}

void NodeCaller::forget(const NodePtr& forgotten)
{
  const NodePtr node = forgotten;
  disconnect(node);
  nodes_.erase(node->api);
  --busy_;
  startSoon();
}

void NodeCaller::allow(const NodePtr& node, std::chrono::milliseconds time)
{
  node->since = SteadyClock::now();
  node->deadline.start(loop_, time,
                       ifAlive(node,
                               [this](const NodePtr& late)
                               {
                                 if (late->step == Step::IDLE && late->calls.empty())
                                 {
                                   forget(late);
                                 }
                                 else if (late->step != Step::IDLE)
                                 {
                                   finish(late, nullptr);
                                 }
                               }));
}

}  // namespace pi_os_transport
