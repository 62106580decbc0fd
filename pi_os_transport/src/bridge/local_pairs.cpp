#include "bridge/local_pairs.h"

#include <algorithm>
#include <utility>

#include "event_loop/if_alive.h"

namespace pi_os_transport
{

LocalPairs::LocalPairs(EventLoop* loop, Request on_link, std::function<void(const std::string&)> log)
  : loop_(loop), log_(std::move(log))
{
  auto host = std::make_shared<ProcessPair::Host>();
  host->on_hello = [](const std::shared_ptr<ProcessPair>&, const Packet&) { return false; };
  host->on_request = [on_link](const std::shared_ptr<ProcessPair>& pair, const std::vector<uint8_t>& bytes)
  {
    BridgeRequest request;
    std::string error;
    if (!BridgeRequest::decode(bytes, &request, &error) || request.kind != BridgeRequest::LINK)
    {
      return false;
    }
    on_link(pair, request);
    return true;
  };
  host->on_met = [this](const std::shared_ptr<ProcessPair>& pair)
  {
    for (Known& known : pairs_)
    {
      known.socket_token =
          known.pair == pair && known.socket_token.empty() ? pair->peerToken().toString() : known.socket_token;
    }
  };
  host->want_write = [loop](ProcessPair* pair, bool wanted)
  { loop->change(pair->fd(), wanted ? EPOLLIN | EPOLLOUT : EPOLLIN); };
  host->receive_soon = [this](const std::shared_ptr<ProcessPair>& pair)
  { loop_->defer(ifAlive(pair, [this](const auto& alive) { receive(alive); })); };
  host->on_shortage = [this](const std::string& shortage)
  {
    if (!std::exchange(warned_, true))
    {
      log_(shortage + ". Links that find no room in shared memory stay on TCPROS");
    }
  };
  host_ = host;
}

LocalPairs::~LocalPairs()
{
  while (!pairs_.empty())
  {
    remove(pairs_.back().pair);
  }
}

void LocalPairs::accept(SideChannel channel)
{
  add(std::move(channel), "");
}

std::shared_ptr<ProcessPair> LocalPairs::with(const std::string& socket_token)
{
  const auto known = std::find_if(pairs_.begin(), pairs_.end(),
                                  [&](const Known& other) { return other.socket_token == socket_token; });
  if (known != pairs_.end())
  {
    return known->pair;
  }
  SideChannel channel = SideChannel::connect("pi_os/" + socket_token);
  return channel ? add(std::move(channel), socket_token) : nullptr;
}

std::shared_ptr<ProcessPair> LocalPairs::add(SideChannel channel, const std::string& socket_token)
{
  std::string shortage;
  const std::shared_ptr<ProcessPair> pair = ProcessPair::make(std::move(channel), host_, &shortage);
  if (!pair)
  {
    if (!shortage.empty())
    {
      host_->on_shortage(shortage);
    }
    return nullptr;
  }
  pairs_.push_back(Known{pair, socket_token});
  loop_->add(pair->fd(), EPOLLIN,
             [this, pair](uint32_t events)
             {
               if ((events & EPOLLOUT) != 0)
               {
                 pair->flush();
               }
               receive(pair);
             });
  return pair;
}

void LocalPairs::receive(const std::shared_ptr<ProcessPair>& pair)
{
  if (!pair->ended() && !pair->receive())
  {
    remove(pair);
  }
}

void LocalPairs::remove(const std::shared_ptr<ProcessPair>& removed)
{
  const std::shared_ptr<ProcessPair> pair = removed;  // `removed` may be the entry of the table
  pairs_.erase(std::remove_if(pairs_.begin(), pairs_.end(), [&pair](const Known& known) { return known.pair == pair; }),
               pairs_.end());
  if (!pair->ended())
  {
    loop_->remove(pair->fd());
    pair->end();
  }
}

void LocalPairs::retire(const std::vector<uint32_t>& segments)
{
  for (const Known& known : pairs_)
  {
    known.pair->retire(segments);
  }
}

}  // namespace pi_os_transport
