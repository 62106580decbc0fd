#include "wire/nats_socket.h"

#include <pi_node/durations.h>

#include <cstdlib>
#include <utility>

#include "wire/wire_message.h"

namespace pi_offload
{
namespace
{

constexpr char WORKERS[] = "workers";  ///< queue group
constexpr char INBOX[] = "_INBOX.";
constexpr size_t INBOX_LENGTH = sizeof INBOX - 1;
constexpr int64_t TICK_NS = 2000000000;  ///< between two states of a site
constexpr size_t MOST_KNOWN = 65536;     ///< vehicles

}  // namespace

std::string natsSubject(TaskKind kind, const std::string& network)
{
  return std::string("edge.") + toString(kind) + "." + network;
}

NatsRequester::NatsRequester(const Options& options, Callbacks callbacks)
  : options_(options), callbacks_(std::move(callbacks))
{
  requireNatsToken("vehicle", options_.vehicle);
  requireNatsToken("nats/network", options_.network);
  connect();
}

void NatsRequester::connect()
{
  NatsConnection::Callbacks on;
  on.link = callbacks_.link;
  on.problem = callbacks_.problem;
  on.message = [this](NatsConnection::Message message)
  {
    const size_t dot = message.subject.rfind('.');
    const auto id = static_cast<uint32_t>(std::strtoul(message.subject.c_str() + dot + 1, nullptr, 10));
    if (!message.unserved)
    {
      callbacks_.reply(id, std::move(message.body), pi_node::monotonicNs());
    }
    else if (callbacks_.unserved)
    {
      callbacks_.unserved(id);
    }
  };
  const std::string inbox = INBOX + options_.vehicle + "." + NatsConnection::uniqueToken() + ".";
  auto connection = std::make_unique<NatsConnection>(
      options_.connection, std::vector<NatsConnection::Subscription>{{inbox + "*"}}, std::move(on));
  const std::lock_guard<std::mutex> lock(mutex_);
  inbox_ = inbox;
  connection_.swap(connection);
}

bool NatsRequester::send(uint32_t id, const std::vector<uint8_t>& body)
{
  const TaskKind kind = kindOf(body);
  const std::lock_guard<std::mutex> lock(mutex_);
  return connection_->publish(natsSubject(kind, kind == TaskKind::SPEECH ? SPEECH_NETWORK : options_.network),
                              inbox_ + std::to_string(id), body);
}

void NatsRequester::reconnect(const std::string& reason)
{
  callbacks_.link(false, reason);
  connect();
}

bool NatsRequester::connected() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return connection_->connected();
}

NatsReplier::NatsReplier(const Options& options, Callbacks callbacks)
  : options_(options)
  , callbacks_(std::move(callbacks))
  , ticker_("nats_status", {[this] { return next_tick_ns_; }, [this](int64_t now_ns) { tick(now_ns); }, {}})
{
  requireNatsToken("id", options_.site);
  NatsConnection::Options connection;
  connection.nats = options_.nats;
  connection.name = options_.site;
  connection.max_queued_bytes = 64U << 20U;
  std::vector<NatsConnection::Subscription> subscriptions;
  for (const std::string& subject : options_.subjects)
  {
    subscriptions.push_back({subject, WORKERS});
  }
  NatsConnection::Callbacks on;
  on.message = [this](NatsConnection::Message message) { onMessage(std::move(message)); };
  on.link = [this](bool up, const std::string& reason)
  {
    if (!up)
    {
      problem("not connected to NATS: " + reason);
    }
  };
  on.problem = callbacks_.problem;
  connection_ = std::make_unique<NatsConnection>(connection, std::move(subscriptions), std::move(on));
  ticker_.start();
}

NatsReplier::~NatsReplier()
{
  ticker_.stop();
  connection_.reset();
}

void NatsReplier::problem(const std::string& text) const
{
  if (callbacks_.problem)
  {
    callbacks_.problem(text);
  }
}

void NatsReplier::onMessage(NatsConnection::Message message)
{
  const int64_t now_ns = pi_node::monotonicNs();
  const size_t last_dot = message.reply.rfind('.');
  const size_t name_end = message.reply.find('.', INBOX_LENGTH);
  if (message.reply.rfind(INBOX, 0) != 0 || name_end >= last_dot)
  {
    problem("a request on " + message.subject + " wants its reply at \"" + message.reply +
            "\", must be _INBOX.<vehicle>.<connection>.<number>");
    return;
  }
  Peer peer;
  peer.vehicle = message.reply.substr(INBOX_LENGTH, name_end - INBOX_LENGTH);
  peer.address = message.reply;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const std::string key = message.reply.substr(0, last_dot);
    if (known_.size() >= MOST_KNOWN && known_.count(key) == 0)
    {
      return;
    }
    Known& known = known_[key];
    known.number = known.number != 0 ? known.number : ++last_;
    known.used_ns = now_ns;
    peer.connection = known.number;
  }
  callbacks_.request(peer, std::move(message.body), now_ns);
}

bool NatsReplier::reply(const Peer& peer, const std::vector<uint8_t>& body)
{
  return connection_->publish(peer.address, "", body);
}

void NatsReplier::close(uint64_t connection, const std::string&)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  for (auto known = known_.begin(); known != known_.end();)
  {
    known = known->second.number == connection ? known_.erase(known) : std::next(known);
  }
}

size_t NatsReplier::connections() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return known_.size();
}

void NatsReplier::tick(int64_t now_ns)
{
  next_tick_ns_ = now_ns + TICK_NS;
  std::vector<uint64_t> left;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (auto known = known_.begin(); known != known_.end();)
    {
      const bool idle = pi_node::secondsBetween(known->second.used_ns, now_ns) > options_.idle_timeout_s;
      if (idle)
      {
        left.push_back(known->second.number);
      }
      known = idle ? known_.erase(known) : std::next(known);
    }
  }
  for (const uint64_t number : left)
  {
    callbacks_.closed(number, "it asked nothing for " + std::to_string(options_.idle_timeout_s) + " s");
  }
  if (callbacks_.status)
  {
    connection_->publish(STATUS_SUBJECT + options_.site, "", callbacks_.status());
  }
}

}  // namespace pi_offload
