#include "bridge/sessions.h"

#include <algorithm>

namespace pi_os_transport
{
namespace
{

constexpr size_t MAX_SESSIONS = 64;
constexpr std::chrono::seconds STALE_AFTER{10};  ///< age of a session that carries nothing and never connected

}  // namespace

void Sessions::start()
{
  for (const Endpoint& endpoint : context_->config.peers)
  {
    at(endpoint);
  }
  removeStale();
}

Session* Sessions::at(const Endpoint& endpoint)
{
  std::unique_ptr<Session>& session = table_[endpoint];
  if (!session)
  {
    if (table_.size() > MAX_SESSIONS)
    {
      table_.erase(endpoint);
      return nullptr;
    }
    session = std::make_unique<Session>();
    session->peer = std::make_shared<Peer>(context_->loop, context_->transport.get(), listener_, endpoint);
    session->peer->start();
  }
  return session.get();
}

Session* Sessions::ofDevice(const std::string& address)
{
  Endpoint endpoint{address, BRIDGE_PORT};
  for (const Endpoint& configured : context_->config.peers)
  {
    endpoint.port = configured.address == address ? configured.port : endpoint.port;
  }
  return context_->config.allows(address) ? at(endpoint) : nullptr;
}

Session* Sessions::of(const Peer* peer) const
{
  return find(peer->endpoint());
}

Session* Sessions::find(const Endpoint& endpoint) const
{
  const auto found = table_.find(endpoint);
  return found != table_.end() ? found->second.get() : nullptr;
}

Session* Sessions::withSecret(uint64_t secret) const
{
  const auto found =
      std::find_if(table_.begin(), table_.end(),
                   [secret](const auto& entry) { return secret != 0 && entry.second->peer->secret() == secret; });
  return found != table_.end() ? found->second.get() : nullptr;
}

Session* Sessions::withConnection(FrameTransport::ConnectionId connection) const
{
  const auto found = std::find_if(table_.begin(), table_.end(),
                                  [connection](const auto& entry) { return entry.second->peer->owns(connection); });
  return found != table_.end() ? found->second.get() : nullptr;
}

bool Sessions::knows(const std::string& address) const
{
  const auto is_there = [&address](const Endpoint& endpoint) { return endpoint.address == address; };
  return std::any_of(context_->config.peers.begin(), context_->config.peers.end(), is_there) ||
         std::any_of(table_.begin(), table_.end(), [&](const auto& entry) { return is_there(entry.first); });
}

void Sessions::removeStale()
{
  stale_timer_.start(context_->loop, STALE_AFTER, [this]() { removeStale(); });
  const SteadyTime now = SteadyClock::now();
  const std::vector<Endpoint>& configured = context_->config.peers;
  for (auto entry = table_.begin(); entry != table_.end();)
  {
    const Session& session = *entry->second;
    const bool stale = std::find(configured.begin(), configured.end(), entry->first) == configured.end() &&
                       !session.peer->up() && now - session.peer->createdAt() > STALE_AFTER &&
                       session.incoming.empty() && session.outgoing.empty() && session.tunnels.empty();
    entry = stale ? table_.erase(entry) : std::next(entry);
  }
}

}  // namespace pi_os_transport
