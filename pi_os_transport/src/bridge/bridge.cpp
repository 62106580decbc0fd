#include "bridge/bridge.h"

#include <unistd.h>

#include <algorithm>
#include <climits>
#include <cstdlib>
#include <stdexcept>
#include <utility>

#include "bridge/bridge_status.h"
#include "wire/ipv4.h"
#include "wire/tls_keys.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MAX_CODEC_QUEUE = 256;  ///< images that wait for conversion: one per stream and direction
constexpr std::chrono::milliseconds DRAIN_TIME{500};

/// The codec lies beside the program that runs.
std::string codecProgram()
{
  char path[PATH_MAX];
  const ssize_t length = readlink("/proc/self/exe", path, sizeof(path) - 1);
  const std::string self(path, length > 0 ? static_cast<size_t>(length) : 0);
  return self.substr(0, self.rfind('/') + 1) + "pi_os_image_codec";
}

std::string keysFolder(const BridgeConfig& config)
{
  const char* const home = std::getenv("HOME");
  return !config.keys.empty() ? config.keys : std::string(home != nullptr ? home : "") + "/.config/pi_os/keys";
}

BridgeContext makeContext(EventLoop* loop, BridgeConfig config, std::function<void(const std::string&)> log)
{
  BridgeContext context{loop, std::move(config), std::move(log), Token::random().high | 1};
  context.pool = std::make_unique<SlotPool>(context.config.pool_limit_mb << 20);
  ImageCodec::Options codec;
  codec.program = codecProgram();
  codec.max_bytes = uint64_t{context.config.max_message_mb} << 20;
  codec.queue_limit = MAX_CODEC_QUEUE;
  context.codec = std::make_unique<ImageCodec>(loop, codec);
  context.graph = std::make_unique<RosGraph>(loop, context.config.master);
  return context;
}

std::string nameOf(const Peer& peer)
{
  return peer.name() + " (" + peer.endpoint().toString() + ")";
}

}  // namespace

Bridge::Bridge(EventLoop* loop, BridgeConfig config, std::function<void(const std::string&)> log)
  : context_(makeContext(loop, std::move(config), std::move(log)))
  , sessions_(&context_, static_cast<Peer::Listener*>(this))
  , pairs_(
        loop,
        [this](const std::shared_ptr<ProcessPair>& pair, const BridgeRequest& request)
        { incoming_.open(pair, request); },
        context_.log)
  , incoming_(&context_, &sessions_, &pairs_, [this]() { finishDraining(); })
  , outgoing_(&context_, &pairs_, [this]() { finishDraining(); })
  , tunnels_(&context_, &sessions_)
  , dispatcher_(&context_, &sessions_, &incoming_, &outgoing_, &tunnels_)
  , requests_(loop, {[this](SideChannel channel) { pairs_.accept(std::move(channel)); },
                     [this](SideChannel channel, const BridgeRequest& request)
                     { tunnels_.open(std::move(channel), request); },
                     [this]() { return status(); }, context_.log})
{
  if (context_.config.isSecure())
  {
    const auto keys = std::make_shared<const TlsKeys>(keysFolder(context_.config));
    context_.log("protected by TLS as \"" + keys->identity() + (keys->areShared() ? "\", a shared key" : "\""));
    context_.shares_keys = keys->areShared();
    context_.transport = makeProtectedTransport(loop, &dispatcher_, keys);
  }
  else
  {
    context_.transport = context_.config.wire == "nanomsg" ? makeNanomsgTransport(loop, &dispatcher_)
                                                           : makeSpTransport(loop, &dispatcher_);
  }
}

Bridge::~Bridge()
{
  context_.codec.reset();
  while (Session* const session = sessions_.first())
  {
    const Endpoint endpoint = session->peer->endpoint();
    onLost(session->peer.get(), false);
    sessions_.remove(endpoint);
  }
}

void Bridge::start()
{
  requests_.listen(context_.config.socket);
  for (const Endpoint& endpoint : context_.config.listen)
  {
    std::string error;
    if (!context_.transport->listen(endpoint, &error))
    {
      throw std::runtime_error("cannot listen on " + endpoint.toString() + ": " + error +
                               ". Give another address or port with --listen");
    }
  }
  requests_.start();
  sessions_.start();
}

Hello Bridge::describe(const Endpoint& towards)
{
  const BridgeConfig& config = context_.config;
  Hello hello;
  hello.instance = context_.instance;
  hello.port = config.advertise.port != 0 ? config.advertise.port : port();
  hello.fixed = !config.advertise.address.empty();
  // A peer with libnanomsg cannot see where frames come from.
  hello.address = hello.fixed ? config.advertise.address : addressTowards(towards.address, towards.port);
  hello.max_message_bytes = config.max_message_mb << 20;
  hello.name = config.name;
  return hello;
}

void Bridge::onUp(Peer* peer, bool resumed)
{
  context_.log(resumed ? "link to " + nameOf(*peer) + " is back" : "connected to " + nameOf(*peer));
  Session* const session = sessions_.of(peer);
  incoming_.openWaiting(session);
  for (const auto& stream : session->outgoing_streams)
  {
    peer->offer(stream.second);
  }
  for (const auto& tunnel : session->tunnels)
  {
    peer->offer(tunnel.second);
  }
}

void Bridge::onInterrupted(Peer* peer)
{
  context_.log("link to " + nameOf(*peer) + " is interrupted");
  Session* const session = sessions_.of(peer);
  const auto streams = session->outgoing_streams;  // a link that is no longer needed may end its stream
  for (const auto& stream : streams)
  {
    stream.second->rewind();
  }
  for (const auto& stream : session->incoming_streams)
  {
    stream.second->interrupt();
  }
  for (const auto& tunnel : session->tunnels)
  {
    tunnel.second->rewind();
  }
}

bool Bridge::holdsLast(const Peer* peer) const
{
  const Session* const session = sessions_.of(peer);
  return session != nullptr && std::any_of(session->outgoing.begin(), session->outgoing.end(),
                                           [](const auto& link) { return link.second->publisher_gone; });
}

void Bridge::onLost(Peer* peer, bool hung)
{
  Session* const session = sessions_.of(peer);
  if (session == nullptr)
  {
    return;
  }
  if (!session->outgoing.empty() || !session->incoming.empty())
  {
    context_.log("bridge " + nameOf(*peer) + (hung ? " does not answer" : " has ended") +
                 "; its links go back to TCPROS");
  }
  outgoing_.abandon(session);
  incoming_.abandon(session, hung);
  Tunnels::abandon(session);
}

void Bridge::drain(std::function<void()> done)
{
  on_drained_ = std::move(done);
  context_.draining = true;
  drain_deadline_ = SteadyClock::now() + DRAIN_TIME;
  requests_.stop();
  for (const auto& session : sessions_.all())
  {
    outgoing_.drain(session.second.get());
    incoming_.drain(session.second.get());
  }
  context_.loop->at(drain_deadline_, [this]() { finishDraining(); });
  finishDraining();
}

bool Bridge::drained() const
{
  return std::all_of(sessions_.all().begin(), sessions_.all().end(),
                     [](const auto& entry)
                     { return entry.second->outgoing.empty() && entry.second->incoming.empty(); });
}

void Bridge::finishDraining()
{
  if (on_drained_ && (drained() || SteadyClock::now() >= drain_deadline_))
  {
    context_.loop->defer(std::exchange(on_drained_, nullptr));
  }
}

std::string Bridge::status() const
{
  return bridgeStatus(context_, sessions_);
}

}  // namespace pi_os_transport
