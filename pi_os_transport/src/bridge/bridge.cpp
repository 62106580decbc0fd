#include "bridge/bridge.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <cstring>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "bridge/bridge_status.h"
#include "shm/shared_memory.h"
#include "wire/sp_transport.h"

namespace pi_os_transport
{
namespace
{

using std::chrono::milliseconds;

constexpr uint32_t MAX_HELLO = 1024;             ///< [B]
constexpr size_t MAX_SESSIONS = 64;              ///< with other bridges
constexpr size_t MAX_LINKS = 4096;               ///< per session and direction
constexpr size_t MAX_STREAMS = 4096;             ///< per session and direction
constexpr size_t MAX_TUNNELS = 256;              ///< per session
constexpr uint64_t MAX_TUNNEL_BYTES = 64 << 20;  ///< of all peers that wait for processes which do not read [B]
constexpr size_t MAX_CODEC_QUEUE = 256;          ///< images being converted: one per stream and direction
constexpr milliseconds FLUSH_INTERVAL{10};       ///< of messages for subscribers that take no more
constexpr std::chrono::seconds STALE_AFTER{10};  ///< a bridge that only ever introduced itself
constexpr milliseconds DRAIN_TIME{500};
constexpr std::chrono::microseconds FRAGMENT_GAP{100};  ///< usual between two parts of a message on a fast network
constexpr std::chrono::seconds LOG_INTERVAL{60};
constexpr uint64_t SUBSCRIBER_SHARE = 8;  ///< part of the pool that one subscriber may pin

sockaddr_in socketAddress(const std::string& address, uint16_t port)
{
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(port);
  inet_pton(AF_INET, address.c_str(), &result.sin_addr);
  return result;
}

/// True if the address is one of this device: only then can a socket be bound to it.
bool isLocal(const std::string& address)
{
  const FileDescriptor probe(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const sockaddr_in local = socketAddress(address, 0);
  return local.sin_addr.s_addr != INADDR_ANY &&
         bind(probe.get(), reinterpret_cast<const sockaddr*>(&local), sizeof(local)) == 0;
}

bool isLoopback(const std::string& address)
{
  return ntohl(socketAddress(address, 0).sin_addr.s_addr) >> 24 == IN_LOOPBACKNET;
}

/// The address under which this device speaks to another one.
std::string addressTowards(const Endpoint& peer)
{
  const FileDescriptor probe(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const sockaddr_in remote = socketAddress(peer.address, peer.port);
  sockaddr_in local{};
  socklen_t length = sizeof(local);
  char text[INET_ADDRSTRLEN];
  return connect(probe.get(), reinterpret_cast<const sockaddr*>(&remote), sizeof(remote)) == 0 &&
                 getsockname(probe.get(), reinterpret_cast<sockaddr*>(&local), &length) == 0 &&
                 inet_ntop(AF_INET, &local.sin_addr, text, sizeof(text)) != nullptr
             ? text
             : "";
}

/// Two ends of a TCP connection on the loopback interface; roscpp knows no other kind of socket.
bool makeTcpPair(FileDescriptor* one, FileDescriptor* other)
{
  const FileDescriptor listener(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address = socketAddress("127.0.0.1", 0);
  socklen_t length = sizeof(address);
  FileDescriptor client(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (bind(listener.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      listen(listener.get(), 1) != 0 ||
      getsockname(listener.get(), reinterpret_cast<sockaddr*>(&address), &length) != 0 ||
      connect(client.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0)
  {
    return false;
  }
  sockaddr_in expected{};
  length = sizeof(expected);
  getsockname(client.get(), reinterpret_cast<sockaddr*>(&expected), &length);
  sockaddr_in from{};
  length = sizeof(from);
  FileDescriptor accepted(accept4(listener.get(), reinterpret_cast<sockaddr*>(&from), &length, SOCK_CLOEXEC));
  if (!accepted || from.sin_port != expected.sin_port || from.sin_addr.s_addr != expected.sin_addr.s_addr)
  {
    return false;  // somebody else was faster
  }
  *one = std::move(client);
  *other = std::move(accepted);
  return true;
}

std::string codecProgram()
{
  char path[PATH_MAX];
  const ssize_t length = readlink("/proc/self/exe", path, sizeof(path) - 1);
  const std::string self(path, length > 0 ? static_cast<size_t>(length) : 0);
  return self.substr(0, self.rfind('/') + 1) + "pi_os_image_codec";
}

FrameHeader linkHeader(FrameType type, uint32_t link)
{
  FrameHeader header;
  header.type = type;
  header.id = link;
  return header;
}

std::vector<uint8_t> textPayload(const std::string& text)
{
  PayloadWriter payload;
  payload.putString(text);
  return payload.take();
}

}  // namespace

/// A process of this device that has connected and not yet said what it wants.
struct Bridge::Client
{
  SideChannel channel;
};

Bridge::Bridge(EventLoop* loop, BridgeConfig config, std::function<void(const std::string&)> log)
  : loop_(loop), config_(std::move(config)), log_(std::move(log)), instance_(Token::random().high | 1)
{
  pool_ = std::make_unique<SlotPool>(config_.pool_limit_mb << 20);
  pool_->setReclaim(
      [this]()
      {
        for (const auto& session : sessions_)
        {
          for (const auto& link : session.second->incoming)
          {
            if (link.second->ring)
            {
              link.second->ring->collect();
            }
          }
        }
      });
  transport_ = config_.wire == "nanomsg" ? makeNanomsgTransport(loop_, this) : makeSpTransport(loop_, this);
  ImageCodec::Options codec;
  codec.program = codecProgram();
  codec.max_bytes = uint64_t{config_.max_message_mb} << 20;
  codec.queue_limit = MAX_CODEC_QUEUE;
  codec_ = std::make_unique<ImageCodec>(loop_, codec);
}

Bridge::~Bridge()
{
  loop_->cancel(blocked_timer_);
  loop_->cancel(stale_timer_);
  codec_.reset();
  for (const auto& client : clients_)
  {
    loop_->remove(client.first);
  }
  while (!sessions_.empty())
  {
    Session* const session = sessions_.begin()->second.get();
    onLost(session->peer.get(), false);
    sessions_.erase(sessions_.begin());
  }
  if (listener_)
  {
    loop_->remove(listener_.fd());
  }
}

void Bridge::start()
{
  const std::string name = BridgeRequest::socketName(config_.socket);
  listener_ = SideChannel::listen(name);
  if (!listener_)
  {
    throw std::runtime_error("the local socket \"" + name + "\" cannot be opened: " + std::strerror(errno) +
                             ". Is another bridge of this user running? Give this one another --socket");
  }
  for (const Endpoint& endpoint : config_.listen)
  {
    std::string error;
    if (!transport_->listen(endpoint, &error))
    {
      throw std::runtime_error("cannot listen on " + endpoint.toString() + ": " + error +
                               ". Give another address or port with --listen");
    }
  }
  loop_->add(listener_.fd(), EPOLLIN, [this](uint32_t) { acceptClients(); });
  for (const Endpoint& endpoint : config_.peers)
  {
    sessionFor(endpoint);
  }
  removeStalePeers();
}

// Nodes of this device.

void Bridge::acceptClients()
{
  while (SideChannel accepted = listener_.accept())
  {
    auto client = std::make_shared<Client>();
    client->channel = std::move(accepted);
    clients_[client->channel.fd()] = client;
    loop_->add(client->channel.fd(), EPOLLIN, [this, client](uint32_t) { onClient(client); });
  }
}

void Bridge::onClient(const std::shared_ptr<Client>& client)
{
  std::vector<uint8_t> packet;
  std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS> descriptors;
  const SideChannel::Receive received = client->channel.receiveBytes(&packet, BridgeRequest::LONGEST, &descriptors);
  if (received == SideChannel::Receive::NOTHING)
  {
    return;
  }
  const int fd = client->channel.fd();
  loop_->remove(fd);
  SideChannel channel = std::move(client->channel);
  clients_.erase(fd);
  BridgeRequest request;
  std::string error;
  if (received != SideChannel::Receive::PACKET)
  {
    return;
  }
  if (!BridgeRequest::decode(packet, &request, &error))
  {
    log_("a process of this device sent a request that cannot be read (" + error + "): it is of another build");
    return;
  }
  switch (request.kind)
  {
    case BridgeRequest::LINK:
      openIncoming(std::move(channel), request);
      break;
    case BridgeRequest::TUNNEL:
      openTunnel(&channel, request);
      break;
    case BridgeRequest::STATUS:
      answerStatus(&channel);
      break;
    case BridgeRequest::PING:
      channel.sendBytes(packet.data(), packet.size());
      break;
  }
}

void Bridge::answerStatus(SideChannel* channel)
{
  const std::string text = status();
  FileDescriptor memory(memfd_create("pi_os_status", MFD_CLOEXEC));
  if (!memory || write(memory.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()))
  {
    return;
  }
  lseek(memory.get(), 0, SEEK_SET);
  BridgeRequest answer;
  const std::vector<uint8_t> packet = answer.encode();
  channel->sendBytes(packet.data(), packet.size(), {memory.get()});
}

void Bridge::openTunnel(SideChannel* channel, const BridgeRequest& request)
{
  Packet answer;
  answer.type = Packet::ENDED;
  answer.values[0] = static_cast<uint64_t>(LinkEnd::REFUSED);
  Session* const session = isLocal(request.address) || on_drained_ ? nullptr : findSession(request.address);
  FileDescriptor ours;
  FileDescriptor theirs;
  if (session != nullptr && session->peer->up() && session->tunnels.size() < MAX_TUNNELS && makeTcpPair(&theirs, &ours))
  {
    answer.type = Packet::OFFER;
    const uint32_t id = next_id_++ & ~Tunnel::SERVER_BIT;
    if (channel->send(answer, {theirs.get()}))
    {
      FrameHeader header = linkHeader(FrameType::TUNNEL_OPEN, id);
      header.count = request.port;
      session->peer->control(header, textPayload(request.address));
      addTunnel(session, Tunnel::Side::CLIENT, id, std::move(ours),
                request.service + " at " + request.address + ":" + std::to_string(request.port));
    }
    return;
  }
  channel->send(answer);
}

void Bridge::openIncoming(SideChannel channel, const BridgeRequest& request)
{
  Session* const session = isLocal(request.address) || on_drained_ || !config_.topic(request.topic).forward
                               ? nullptr
                               : findSession(request.address);
  if (session == nullptr || session->incoming.size() >= MAX_LINKS)
  {
    Packet answer;
    answer.type = Packet::ENDED;
    answer.values[0] = static_cast<uint64_t>(LinkEnd::REFUSED);
    channel.send(answer);
    return;
  }
  const uint32_t id = next_id_++;
  auto link = std::make_shared<IncomingLink>(id, request, std::move(channel));
  link->on_blocked = [this]() { pauseBlocked(); };
  session->incoming[id] = link;
  loop_->add(link->fd(), EPOLLIN, [this, session, link](uint32_t) { onSubscriber(session, link); });
  if (session->peer->up())
  {
    link->state = IncomingLink::State::OPENING;
    LinkOpen open{request.socket_token, request.link_token, request.topic,
                  request.type,         request.publisher,  request.subscriber};
    session->peer->control(linkHeader(FrameType::LINK_OPEN, id), open.encode());
  }
}

void Bridge::onSubscriber(Session* session, const std::shared_ptr<IncomingLink>& link)
{
  for (;;)
  {
    Packet packet;
    std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS> descriptors;
    const SideChannel::Receive received = link->channel().receive(&packet, &descriptors);
    if (received == SideChannel::Receive::NOTHING)
    {
      return;
    }
    if (received == SideChannel::Receive::PACKET && link->ring && link->ring->isProof(packet))
    {
      if (link->state == IncomingLink::State::OFFERED)
      {
        link->state = IncomingLink::State::CARRYING;
        session->peer->control(linkHeader(FrameType::LINK_PROVED, link->id));
      }
      continue;
    }
    endIncoming(session, link, LinkEnd::CLOSED, link->state != IncomingLink::State::WANTED);
    return;
  }
}

void Bridge::offerTo(Session* session, const std::shared_ptr<IncomingLink>& link)
{
  if (link->state != IncomingLink::State::OPENING)
  {
    return;  // came again after an interruption
  }
  auto ring = std::make_unique<RingSender>(pool_.get(), pool_token_, (config_.pool_limit_mb << 20) / SUBSCRIBER_SHARE);
  std::string error;
  if (!ring->open(std::move(link->client), &error))
  {
    if (!error.empty())
    {
      log_("no shared memory for " + link->request.subscriber + ": " + error);
    }
    endIncoming(session, link, LinkEnd::REFUSED, true);
    return;
  }
  link->ring = std::move(ring);
  link->state = IncomingLink::State::OFFERED;
}

void Bridge::endIncoming(Session* session, const std::shared_ptr<IncomingLink>& ended, LinkEnd reason, bool tell_peer)
{
  const std::shared_ptr<IncomingLink> link = ended;  // which may be the one in the table
  if (session->incoming.erase(link->id) == 0)
  {
    return;
  }
  if (tell_peer)
  {
    FrameHeader header = linkHeader(FrameType::LINK_CLOSE, link->id);
    header.count = FROM_SUBSCRIBER;
    session->peer->control(header, textPayload("the subscriber left"));
  }
  link->flush();
  Packet packet;
  packet.type = Packet::ENDED;
  packet.values[0] = static_cast<uint64_t>(reason);
  link->channel().send(packet);
  loop_->remove(link->fd());
  link->client.close();
  link->ring.reset();
  link->state = IncomingLink::State::WANTED;
  const bool any = std::any_of(sessions_.begin(), sessions_.end(),
                               [](const auto& other) { return !other.second->incoming.empty(); });
  if (!any)
  {
    pool_->trim();
  }
  finishDraining();
}

void Bridge::pauseBlocked()
{
  bool any = false;
  for (const auto& entry : sessions_)
  {
    for (const auto& link : entry.second->incoming)
    {
      any = !link.second->flush() || any;
      if (link.second->blocked() != link.second->paused)
      {
        link.second->paused = link.second->blocked();
        entry.second->peer->control(
            linkHeader(link.second->paused ? FrameType::LINK_PAUSE : FrameType::LINK_RESUME, link.first));
      }
    }
  }
  if (any && blocked_timer_ == 0)
  {
    blocked_timer_ = loop_->after(FLUSH_INTERVAL,
                                  [this]()
                                  {
                                    blocked_timer_ = 0;
                                    pauseBlocked();
                                  });
  }
}

// Publishers of this device.

std::shared_ptr<OutgoingStream> Bridge::streamFor(Session* session, const LinkOpen& open)
{
  std::shared_ptr<OutgoingStream>& stream = session->outgoing_streams[open.socket_token + " " + open.topic];
  if (stream)
  {
    return stream;
  }
  const TopicOptions& options = config_.topic(open.topic);
  OutgoingStream::Compress compress;
  if (!options.compression.empty() && open.type == "sensor_msgs/Image")
  {
    const auto kind = options.compression == "png" ? ImageCodec::Compression::PNG : ImageCodec::Compression::JPEG;
    compress = [this, kind, quality = options.quality, topic = open.topic](const uint8_t* bytes, size_t length,
                                                                           const OutgoingStream::Compressed& done)
    {
      return codec_->encode(
          kind, quality, bytes, length,
          [this, done, topic](ImageCodec::Result result, std::vector<uint8_t> message, const std::string& detail)
          {
            if (result != ImageCodec::Result::CONVERTED)
            {
              refuse(nullptr, topic + " goes uncompressed: " + detail);
            }
            done(std::move(message));
          });
    };
  }
  stream = std::make_shared<OutgoingStream>(next_id_++, session->peer.get(), loop_, options, compress, open.topic,
                                            open.publisher,
                                            std::min(config_.max_message_mb << 20, session->peer->maxMessageBytes()));
  stream->on_link_done = [this, session](const std::shared_ptr<OutgoingLink>& link) { closeOutgoing(session, link); };
  stream->on_too_large = [this, session](const std::shared_ptr<OutgoingLink>& link)
  { endOutgoing(session, link, LinkEnd::REFUSED, "a message is larger than max_message_mb"); };
  return stream;
}

void Bridge::openOutgoing(Session* session, uint32_t id, const LinkOpen& open)
{
  const auto known = session->outgoing.find(id);
  if (known != session->outgoing.end())
  {
    if (known->second->state != OutgoingLink::State::OPENING)
    {
      session->peer->control(linkHeader(FrameType::LINK_READY, id));
    }
    return;
  }
  const auto answerRefused = [session, id](const std::string& why)
  {
    FrameHeader header = linkHeader(FrameType::LINK_CLOSE, id);
    header.count = static_cast<uint32_t>(LinkEnd::REFUSED);
    session->peer->control(header, textPayload(why));
  };
  const std::optional<Token> socket_token = Token::fromString(open.socket_token);
  const std::optional<Token> link_token = Token::fromString(open.link_token);
  if (!socket_token || !link_token || session->outgoing.size() >= MAX_LINKS ||
      session->outgoing_streams.size() >= MAX_STREAMS || on_drained_)
  {
    answerRefused("not acceptable");
    return;
  }
  if (!config_.topic(open.topic).forward)
  {
    answerRefused("its publisher's bridge does not forward this topic");
    return;
  }
  SideChannel channel = SideChannel::connect("pi_os/" + open.socket_token);
  Packet hello;
  hello.type = Packet::HELLO;
  hello.values = {link_token->high, link_token->low, 1};
  if (!channel || !channel.send(hello))
  {
    answerRefused("the publisher cannot be reached by its bridge: it runs as another user, or in another container");
    return;
  }
  auto link = std::make_shared<OutgoingLink>(id, std::make_shared<RingReceiver>(std::move(channel)));
  link->subscriber = open.subscriber;
  session->outgoing[id] = link;
  streamFor(session, open)->add(link);
  loop_->add(link->ring->fd(), EPOLLIN, [this, session, link](uint32_t) { onPublisher(session, link); });
}

void Bridge::onPublisher(Session* session, const std::shared_ptr<OutgoingLink>& link)
{
  const SideChannel::Receive end = link->ring->readPackets();
  if (link->ring->takePublisherWaits())
  {
    link->onPublisherWaits();
  }
  if (link->ring->hasRing() && link->state == OutgoingLink::State::OPENING)
  {
    link->state = OutgoingLink::State::OFFERED;
    try
    {
      loop_->add(link->ring->doorbell(NETWORK_THREAD), EPOLLIN, [this, link](uint32_t) { onDoorbell(link); });
    }
    catch (const std::system_error&)
    {
      // What the publisher sent as its doorbell is something that nobody can wait for.
      endOutgoing(session, link, LinkEnd::REFUSED, "the publisher sent no doorbell");
      return;
    }
    session->peer->control(linkHeader(FrameType::LINK_READY, link->id));
  }
  if (end == SideChannel::Receive::NOTHING)
  {
    return;
  }
  if (link->state != OutgoingLink::State::CARRYING || end == SideChannel::Receive::MALFORMED)
  {
    endOutgoing(session, link, LinkEnd::BACK_TO_TCP, "the publisher ended the link");
    return;
  }
  if (link->ring->ended() == LinkEnd::BACK_TO_TCP)
  {
    endOutgoing(session, link, LinkEnd::BACK_TO_TCP, "the publisher went back to TCPROS");
    return;
  }
  // Its process has ended, or has closed the link. What it left in the ring is still delivered.
  link->publisher_gone = true;
  loop_->remove(link->ring->fd());
  if (link->isDone())
  {
    closeOutgoing(session, link);
    return;
  }
  onDoorbell(link);
}

void Bridge::onDoorbell(const std::shared_ptr<OutgoingLink>& link)
{
  uint64_t rings;
  if (link->ring->doorbell(NETWORK_THREAD) >= 0 &&
      read(link->ring->doorbell(NETWORK_THREAD), &rings, sizeof(rings)) < 0)
  {
    rings = 0;  // whatever rang, looking is harmless
  }
  if (const std::shared_ptr<OutgoingStream> stream = link->stream.lock())
  {
    stream->peer()->offer(stream);
    stream->peer()->pump();
  }
}

/// Ends a link whose messages may still be under way. The publisher goes back to TCPROS when they have arrived.
void Bridge::endOutgoing(Session* session, const std::shared_ptr<OutgoingLink>& link, LinkEnd reason,
                         const std::string& text)
{
  link->state = OutgoingLink::State::CLOSING;
  link->end_reason = reason;
  link->end_text = text;
  if (link->isDone())
  {
    closeOutgoing(session, link);
  }
}

void Bridge::closeOutgoing(Session* session, const std::shared_ptr<OutgoingLink>& link)
{
  FrameHeader header = linkHeader(FrameType::LINK_CLOSE, link->id);
  header.count = static_cast<uint32_t>(link->publisher_gone ? LinkEnd::CLOSED : link->end_reason);
  session->peer->control(header, textPayload(link->end_text));
  forgetOutgoing(session, link);
}

void Bridge::forgetOutgoing(Session* session, const std::shared_ptr<OutgoingLink>& link)
{
  const std::shared_ptr<OutgoingLink> kept = link;
  if (session->outgoing.erase(kept->id) == 0)
  {
    return;
  }
  if (!kept->publisher_gone)
  {
    loop_->remove(kept->ring->fd());
  }
  if (kept->ring->hasRing())
  {
    loop_->remove(kept->ring->doorbell(NETWORK_THREAD));
  }
  kept->ring->channel().close();
  if (const std::shared_ptr<OutgoingStream> stream = kept->stream.lock())
  {
    stream->remove(kept);
    if (stream->links().empty())
    {
      for (auto entry = session->outgoing_streams.begin(); entry != session->outgoing_streams.end(); ++entry)
      {
        if (entry->second == stream)
        {
          session->outgoing_streams.erase(entry);
          break;
        }
      }
    }
  }
  finishDraining();
}

// Other bridges.

Bridge::Session* Bridge::findSession(const std::string& address)
{
  Endpoint endpoint{address, BRIDGE_PORT};
  for (const Endpoint& configured : config_.peers)
  {
    endpoint.port = configured.address == address ? configured.port : endpoint.port;
  }
  return config_.allows(address) ? sessionFor(endpoint) : nullptr;
}

Bridge::Session* Bridge::sessionFor(const Endpoint& endpoint)
{
  std::unique_ptr<Session>& session = sessions_[endpoint];
  if (!session)
  {
    if (sessions_.size() > MAX_SESSIONS)
    {
      sessions_.erase(endpoint);
      return nullptr;
    }
    session = std::make_unique<Session>();
    session->peer = std::make_shared<Peer>(loop_, transport_.get(), static_cast<Peer::Listener*>(this), endpoint);
    session->peer->start();
  }
  return session.get();
}

Bridge::Session* Bridge::sessionOf(const Peer* peer)
{
  const auto found = sessions_.find(peer->endpoint());
  return found != sessions_.end() ? found->second.get() : nullptr;
}

Bridge::Session* Bridge::sessionBySecret(uint64_t secret)
{
  for (const auto& session : sessions_)
  {
    if (secret != 0 && session.second->peer->secret() == secret)
    {
      return session.second.get();
    }
  }
  return nullptr;
}

void Bridge::removeStalePeers()
{
  stale_timer_ = loop_->after(STALE_AFTER, [this]() { removeStalePeers(); });
  const SteadyTime now = SteadyClock::now();
  for (auto entry = sessions_.begin(); entry != sessions_.end();)
  {
    const Session& session = *entry->second;
    const bool configured = std::find(config_.peers.begin(), config_.peers.end(), entry->first) != config_.peers.end();
    const bool stale = !configured && !session.peer->up() && now - session.peer->createdAt() > STALE_AFTER &&
                       session.incoming.empty() && session.outgoing.empty() && session.tunnels.empty();
    entry = stale ? sessions_.erase(entry) : std::next(entry);
  }
}

void Bridge::refuse(uint64_t* counter, const std::string& what)
{
  if (counter != nullptr)
  {
    ++*counter;
  }
  const SteadyTime now = SteadyClock::now();
  if (logged_.size() > MAX_SESSIONS)
  {
    logged_.clear();
  }
  const auto known = logged_.find(what);
  if (known == logged_.end() || now - known->second > LOG_INTERVAL)
  {
    logged_[what] = now;
    log_(what);
  }
}

Hello Bridge::describe(const Endpoint& towards)
{
  Hello hello;
  hello.instance = instance_;
  hello.port = config_.advertise.port != 0 ? config_.advertise.port : transport_->port();
  hello.fixed = !config_.advertise.address.empty();
  // A peer with libnanomsg cannot see where frames come from.
  hello.address = hello.fixed ? config_.advertise.address : addressTowards(towards);
  hello.max_message_bytes = config_.max_message_mb << 20;
  hello.name = config_.name;
  return hello;
}

Bridge::Session* Bridge::introduce(FrameTransport::SourceId source, const Hello& hello)
{
  if (hello.instance == instance_)
  {
    return nullptr;  // this bridge itself, by another of its addresses
  }
  if (Session* const known = sessionBySecret(hello.echo))
  {
    return known;
  }
  // A bridge behind a tunnel says where it can be reached; otherwise it is where it speaks from.
  const std::string seen = transport_->addressOf(source);
  const std::string address = hello.fixed || seen.empty() ? hello.address : seen;
  in_addr parsed;
  if (hello.port == 0 || inet_pton(AF_INET, address.c_str(), &parsed) != 1)
  {
    refuse(&refused_.malformed, "a bridge that says no address: give it one with advertise");
    return nullptr;
  }
  if (!config_.allows(address))
  {
    refuse(&refused_.unknown_peer, "a bridge at " + address + " is not allowed here");
    return nullptr;
  }
  return sessionFor(Endpoint{address, hello.port});
}

void Bridge::onConnected(FrameTransport::ConnectionId connection)
{
  for (const auto& session : sessions_)
  {
    if (session.second->peer->owns(connection))
    {
      session.second->peer->onConnected(connection);
      return;
    }
  }
}

void Bridge::onWritable(FrameTransport::ConnectionId connection)
{
  for (const auto& session : sessions_)
  {
    if (session.second->peer->owns(connection))
    {
      session.second->peer->pump();
      return;
    }
  }
}

void Bridge::onClosed(FrameTransport::ConnectionId connection, CloseReason reason)
{
  for (const auto& session : sessions_)
  {
    if (session.second->peer->owns(connection))
    {
      session.second->peer->onClosed(connection, reason);
      return;
    }
  }
}

bool Bridge::onAccept(const std::string& address)
{
  if (config_.allows(address))
  {
    return true;
  }
  refuse(&refused_.unknown_peer, address + " is not allowed to connect");
  return false;
}

uint8_t* Bridge::onHeader(FrameTransport::SourceId source, const FrameHeader& header, uint32_t length)
{
  if (header.type == FrameType::HELLO)
  {
    if (length > MAX_HELLO)
    {
      ++refused_.malformed;
      return nullptr;
    }
  }
  else
  {
    Session* const session = sessionBySecret(header.session);
    if (session == nullptr || (header.lane & ~ACK_NOW) >= TRAFFIC_CLASSES)
    {
      ++refused_.bad_session;
      return nullptr;
    }
    if (header.type == FrameType::FRAGMENT)
    {
      const auto stream = session->incoming_streams.find(header.id);
      const std::shared_ptr<uint8_t> memory =
          stream != session->incoming_streams.end() ? stream->second->fragmentMemory(header, length) : nullptr;
      refused_.malformed += memory == nullptr ? 1 : 0;
      fragments_[source] = memory;
      return memory.get();
    }
  }
  std::vector<uint8_t>& buffer = payloads_[source];
  buffer.resize(std::max<size_t>(buffer.size(), std::max<uint32_t>(length, 1)));
  return buffer.data();
}

void Bridge::onFrame(FrameTransport::SourceId source, const FrameHeader& header, uint8_t* payload, uint32_t length)
{
  if (header.type == FrameType::HELLO)
  {
    Hello hello;
    if (!Hello::decode(payload, length, &hello))
    {
      refuse(&refused_.malformed, "a greeting that cannot be read");
      transport_->closeSource(source);
      return;
    }
    Session* const session = introduce(source, hello);
    if (session == nullptr || !session->peer->onHello(hello))
    {
      refused_.bad_session += session != nullptr ? 1 : 0;
      transport_->closeSource(source);
    }
    return;
  }
  Session* const session = sessionBySecret(header.session);
  if (session == nullptr)
  {
    ++refused_.bad_session;
    transport_->closeSource(source);
    return;
  }
  const std::shared_ptr<Peer> peer = session->peer;
  if (header.type == FrameType::FRAGMENT)
  {
    fragments_.erase(source);
  }
  if (!onPeerFrame(session, header, payload, length))
  {
    refuse(&refused_.malformed, "a frame from " + peer->endpoint().toString() + " that cannot be (type " +
                                    std::to_string(static_cast<int>(header.type)) + ")");
    transport_->closeSource(source);
    peer->restart();
    return;
  }
  if (Lane::isCounted(header.type))
  {
    peer->acknowledge(static_cast<Traffic>(header.lane & ~ACK_NOW), length + static_cast<uint32_t>(FrameHeader::BYTES),
                      (header.lane & ACK_NOW) != 0);
  }
}

void Bridge::onSourceClosed(FrameTransport::SourceId source, CloseReason reason, const std::string& detail)
{
  if (source != 0)
  {
    payloads_.erase(source);
    fragments_.erase(source);
  }
  if (reason != CloseReason::MALFORMED)
  {
    return;
  }
  switch (faultOf(detail))
  {
    case SourceFault::OVERSIZED:
      refuse(&refused_.oversized, "an oversized frame was refused");
      break;
    case SourceFault::WRONG_VERSION:
      refuse(&refused_.wrong_version, "a bridge of another version was refused: " + detail);
      break;
    case SourceFault::MALFORMED:
      refuse(&refused_.malformed, "something that is no bridge was refused: " + detail);
      break;
    case SourceFault::REFUSED:
      break;  // counted where it was refused
  }
}

void Bridge::onUp(Peer* peer, bool resumed)
{
  log_((resumed ? "link to " : "connected to ") + peer->name() + " (" + peer->endpoint().toString() + ")" +
       (resumed ? " is back" : ""));
  Session* const session = sessionOf(peer);
  for (const auto& link : session->incoming)
  {
    if (link.second->state == IncomingLink::State::WANTED)
    {
      const BridgeRequest& request = link.second->request;
      link.second->state = IncomingLink::State::OPENING;
      LinkOpen open{request.socket_token, request.link_token, request.topic,
                    request.type,         request.publisher,  request.subscriber};
      peer->control(linkHeader(FrameType::LINK_OPEN, link.first), open.encode());
    }
  }
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
  log_("link to " + peer->name() + " (" + peer->endpoint().toString() + ") is interrupted");
  Session* const session = sessionOf(peer);
  const auto streams = session->outgoing_streams;  // a link that becomes superfluous may end its stream
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

void Bridge::onLost(Peer* peer, bool hung)
{
  Session* const session = sessionOf(peer);
  if (session == nullptr)
  {
    return;
  }
  if (!session->outgoing.empty() || !session->incoming.empty())
  {
    log_("bridge " + peer->name() + " (" + peer->endpoint().toString() + ")" +
         (hung ? " does not answer" : " has ended") + "; its links go back to TCPROS");
  }
  for (const auto& stream : session->outgoing_streams)
  {
    stream.second->abandon();
  }
  while (!session->outgoing.empty())
  {
    forgetOutgoing(session, session->outgoing.begin()->second);
  }
  session->outgoing_streams.clear();
  while (!session->incoming.empty())
  {
    endIncoming(session, session->incoming.begin()->second, hung ? LinkEnd::PUBLISHER_UNAWARE : LinkEnd::BACK_TO_TCP,
                false);
  }
  session->incoming_streams.clear();
  const auto tunnels = std::exchange(session->tunnels, {});
  for (const auto& tunnel : tunnels)
  {
    tunnel.second->abort();
  }
}

bool Bridge::onPeerFrame(Session* session, const FrameHeader& header, uint8_t* payload, uint32_t length)
{
  switch (header.type)
  {
    case FrameType::HELLO:
      return false;
    case FrameType::PING:
      session->peer->onPing();
      return true;
    case FrameType::ACK:
      if (!session->peer->onAck(header))
      {
        return false;
      }
      session->peer->pump();
      return true;
    case FrameType::LINK_OPEN:
    case FrameType::LINK_READY:
    case FrameType::LINK_PROVED:
    case FrameType::LINK_START:
    case FrameType::LINK_CLOSE:
    case FrameType::LINK_PAUSE:
    case FrameType::LINK_RESUME:
      return onLinkFrame(session, header, payload, length);
    case FrameType::MESSAGE:
    case FrameType::BEGIN:
    case FrameType::FRAGMENT:
    case FrameType::ATTACH:
      return onStreamFrame(session, header, payload, length);
    case FrameType::TUNNEL_OPEN:
    case FrameType::TUNNEL_READY:
    case FrameType::TUNNEL_DATA:
    case FrameType::TUNNEL_CREDIT:
    case FrameType::TUNNEL_CLOSE:
      return onTunnelFrame(session, header, payload, length);
  }
  return false;
}

bool Bridge::onLinkFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  if (header.type == FrameType::LINK_OPEN)
  {
    LinkOpen open;
    if (!LinkOpen::decode(payload, length, &open))
    {
      return false;
    }
    openOutgoing(session, header.id, open);
    return true;
  }
  const auto incoming = session->incoming.find(header.id);
  const auto outgoing = session->outgoing.find(header.id);
  const std::shared_ptr<IncomingLink> in = incoming != session->incoming.end() ? incoming->second : nullptr;
  const std::shared_ptr<OutgoingLink> out = outgoing != session->outgoing.end() ? outgoing->second : nullptr;
  const bool from_publisher = (header.count & FROM_SUBSCRIBER) == 0;
  switch (header.type)
  {
    case FrameType::LINK_READY:
      if (in)
      {
        offerTo(session, in);
      }
      break;
    case FrameType::LINK_START:
      if (in && in->state == IncomingLink::State::CARRYING)
      {
        in->start(header.offset, header.count);
      }
      break;
    case FrameType::LINK_PROVED:
      if (out && out->state == OutgoingLink::State::OFFERED)
      {
        out->state = OutgoingLink::State::CARRYING;
        out->ring->sendProof();
        onDoorbell(out);
      }
      break;
    case FrameType::LINK_PAUSE:
    case FrameType::LINK_RESUME:
      if (out)
      {
        out->paused = header.type == FrameType::LINK_PAUSE;
        onDoorbell(out);
      }
      break;
    case FrameType::LINK_CLOSE:
      if (from_publisher && in)
      {
        endIncoming(session, in, static_cast<LinkEnd>(header.count), false);
      }
      else if (!from_publisher && out)
      {
        endOutgoing(session, out, LinkEnd::BACK_TO_TCP, "the subscriber left");
      }
      break;
    default:
      return false;
  }
  return true;
}

bool Bridge::onStreamFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  std::shared_ptr<IncomingStream> stream;
  const auto found = session->incoming_streams.find(header.id);
  if (found != session->incoming_streams.end())
  {
    stream = found->second;
  }
  else if (session->incoming_streams.size() < MAX_STREAMS &&
           (header.type == FrameType::MESSAGE || header.type == FrameType::BEGIN))
  {
    stream = std::make_shared<IncomingStream>(
        pool_.get(), config_.max_message_mb << 20,
        [session](uint32_t id)
        {
          const auto link = session->incoming.find(id);
          return link != session->incoming.end() ? link->second : nullptr;
        },
        [this](const uint8_t* bytes, size_t size, const IncomingStream::Decompressed& done)
        {
          return codec_->decode(
              bytes, size,
              [this, done](ImageCodec::Result result, std::vector<uint8_t> message, const std::string& detail)
              {
                if (result != ImageCodec::Result::CONVERTED)
                {
                  refuse(nullptr, "a compressed image was lost: " + detail);
                }
                done(std::move(message));
              });
        });
    session->incoming_streams[header.id] = stream;
  }
  if (!stream)
  {
    return false;
  }
  bool accepted = false;
  switch (header.type)
  {
    case FrameType::MESSAGE:
      accepted = stream->onMessage(header, payload, length);
      break;
    case FrameType::BEGIN:
      accepted = stream->onBegin(header, payload, length);
      break;
    case FrameType::FRAGMENT:
      accepted = stream->onFragment(header, length);
      break;
    default:
      accepted = stream->onAttach(header, payload, length);
      break;
  }
  loop_->expectSoon(stream->arriving() ? FRAGMENT_GAP : std::chrono::microseconds(0));
  const std::vector<uint32_t> retired = pool_->takeRetired();
  for (const auto& entry : sessions_)
  {
    for (const auto& link : entry.second->incoming)
    {
      if (!retired.empty() && link.second->ring)
      {
        link.second->ring->retire(retired);
      }
    }
  }
  return accepted;
}

bool Bridge::onTunnelFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  if (header.type == FrameType::TUNNEL_OPEN)
  {
    return acceptTunnel(session, header, payload, length);
  }
  const auto found = session->tunnels.find(header.id);
  if (found == session->tunnels.end())
  {
    return true;  // it has ended here meanwhile
  }
  const std::shared_ptr<Tunnel> tunnel = found->second;
  switch (header.type)
  {
    case FrameType::TUNNEL_READY:
      return true;
    case FrameType::TUNNEL_DATA:
      if (tunnelBytes() + length > MAX_TUNNEL_BYTES)
      {
        tunnel->abort();
        return true;
      }
      return tunnel->onData(header, payload, length);
    case FrameType::TUNNEL_CREDIT:
      return tunnel->onCredit(header);
    case FrameType::TUNNEL_CLOSE:
      tunnel->onClose(header);
      return true;
    default:
      return false;
  }
}

uint64_t Bridge::tunnelBytes() const
{
  uint64_t bytes = 0;
  for (const auto& session : sessions_)
  {
    for (const auto& tunnel : session.second->tunnels)
    {
      bytes += tunnel.second->waitingBytes();
    }
  }
  return bytes;
}

bool Bridge::acceptTunnel(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  PayloadReader in(payload, length);
  const std::string address = in.getString();
  if (!in.ok() || (header.id & Tunnel::SERVER_BIT) != 0 || header.count == 0 || header.count > 65535)
  {
    return false;
  }
  if (session->tunnels.count(header.id) != 0)
  {
    return true;  // came again after an interruption
  }
  const uint16_t port = static_cast<uint16_t>(header.count);
  const std::string target = address + ":" + std::to_string(port);
  // Only what this device offers to others: a bridge is a way neither into the network behind it nor to what listens on
  // the loopback interface alone.
  FileDescriptor socket(isLocal(address) && !isLoopback(address) && session->tunnels.size() < MAX_TUNNELS &&
                                !on_drained_
                            ? ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)
                            : -1);
  const sockaddr_in destination = socketAddress(address, port);
  if (!socket || (connect(socket.get(), reinterpret_cast<const sockaddr*>(&destination), sizeof(destination)) != 0 &&
                  errno != EINPROGRESS))
  {
    FrameHeader close = linkHeader(FrameType::TUNNEL_CLOSE, header.id | Tunnel::SERVER_BIT);
    close.count = 1;
    session->peer->control(close, textPayload(target + " cannot be reached"));
    return true;
  }
  addTunnel(session, Tunnel::Side::SERVER, header.id, std::move(socket), target);
  return true;
}

void Bridge::addTunnel(Session* session, Tunnel::Side side, uint32_t id, FileDescriptor socket,
                       const std::string& target)
{
  // Frames about it come with the id of the other side.
  const uint32_t key = side == Tunnel::Side::CLIENT ? id | Tunnel::SERVER_BIT : id;
  const auto tunnel = std::make_shared<Tunnel>(loop_, session->peer.get(), id, side, std::move(socket), target,
                                               [this, peer = session->peer, key]()
                                               {
                                                 Session* const owner = sessionOf(peer.get());
                                                 if (owner != nullptr)
                                                 {
                                                   owner->tunnels.erase(key);
                                                 }
                                               });
  session->tunnels[key] = tunnel;
  tunnel->start();
}

// The end.

void Bridge::drain(std::function<void()> done)
{
  on_drained_ = std::move(done);
  drain_deadline_ = SteadyClock::now() + DRAIN_TIME;
  loop_->remove(listener_.fd());
  listener_.close();
  for (const auto& entry : sessions_)
  {
    Session* const session = entry.second.get();
    const auto outgoing = session->outgoing;
    for (const auto& link : outgoing)
    {
      endOutgoing(session, link.second, LinkEnd::BACK_TO_TCP, "the bridge ends");
    }
    const auto incoming = session->incoming;
    for (const auto& link : incoming)
    {
      if (session->peer->up() && link.second->state == IncomingLink::State::CARRYING)
      {
        // The peer closes the link when all that is under way has come.
        FrameHeader header = linkHeader(FrameType::LINK_CLOSE, link.first);
        header.count = FROM_SUBSCRIBER;
        session->peer->control(header, textPayload("the bridge ends"));
      }
      else
      {
        endIncoming(session, link.second, LinkEnd::BACK_TO_TCP, session->peer->up());
      }
    }
  }
  loop_->at(drain_deadline_, [this]() { finishDraining(); });
  finishDraining();
}

bool Bridge::drained() const
{
  return std::all_of(sessions_.begin(), sessions_.end(),
                     [](const auto& entry)
                     { return entry.second->outgoing.empty() && entry.second->incoming.empty(); });
}

void Bridge::finishDraining()
{
  if (on_drained_ && (drained() || SteadyClock::now() >= drain_deadline_))
  {
    loop_->defer(std::exchange(on_drained_, []() {}));
  }
}

std::string Bridge::status() const
{
  BridgeStatus status;
  status.name = config_.name;
  status.instance = instance_;
  status.wire = config_.wire;
  for (const Endpoint& endpoint : config_.listen)
  {
    status.listen.push_back(endpoint.address + ":" +
                            std::to_string(endpoint.port != 0 ? endpoint.port : transport_->port()));
  }
  const SlotPool::Usage usage = pool_->usage();
  status.pool = {{"committed", usage.committed}, {"limit", usage.limit}};
  status.refused = {{"unknown_peer", refused_.unknown_peer},
                    {"wrong_version", refused_.wrong_version},
                    {"oversized", refused_.oversized},
                    {"malformed", refused_.malformed},
                    {"bad_session", refused_.bad_session}};
  for (const auto& entry : sessions_)
  {
    const Session& session = *entry.second;
    const Peer& peer = *session.peer;
    const std::string address = peer.endpoint().toString();
    static const char* const STATES[] = {"connecting", "up", "silent", "hung", "down"};
    const Lane& express = peer.lane(Traffic::EXPRESS);
    const Lane& bulk = peer.lane(Traffic::BULK);
    status.peers.push_back({{"address", address},
                            {"name", peer.name()},
                            {"state", STATES[static_cast<size_t>(peer.state())]},
                            {"rtt_us", static_cast<uint64_t>(bulk.rtt().count())},
                            {"window", bulk.window()},
                            {"sent_bytes", express.sentBytes() + bulk.sentBytes()},
                            {"received_bytes", peer.receivedBytes()}});
    for (const auto& item : session.outgoing_streams)
    {
      const OutgoingStream& stream = *item.second;
      const OutgoingStream::Counters& counters = stream.counters();
      status.outgoing.push_back({{"topic", stream.topic()},
                                 {"publisher", stream.publisher()},
                                 {"peer", address},
                                 {"subscribers", uint64_t{stream.links().size()}},
                                 {"messages", counters.messages},
                                 {"bytes", counters.bytes},
                                 {"superseded", counters.superseded},
                                 {"rate_limited", counters.rate_limited},
                                 {"uncompressed", counters.uncompressed},
                                 {"lost", counters.lost}});
    }
    for (const auto& item : session.incoming)
    {
      const IncomingLink& link = *item.second;
      status.incoming.push_back({{"topic", link.request.topic},
                                 {"publisher", link.request.publisher},
                                 {"subscriber", link.request.subscriber},
                                 {"peer", address},
                                 {"carrying", uint64_t{link.state == IncomingLink::State::CARRYING}},
                                 {"messages", link.messages()},
                                 {"bytes", link.bytes()},
                                 {"dropped", link.dropped()},
                                 {"lost", link.lost()},
                                 {"paused", uint64_t{link.paused}}});
    }
    for (const auto& item : session.tunnels)
    {
      const Tunnel& tunnel = *item.second;
      status.tunnels.push_back({{"target", tunnel.target()},
                                {"peer", address},
                                {"state", tunnel.state()},
                                {"sent_bytes", tunnel.sentBytes()},
                                {"received_bytes", tunnel.receivedBytes()}});
    }
  }
  return status.toJson();
}

}  // namespace pi_os_transport
