#include "bridge/incoming_links.h"

#include <utility>

#include "event_loop/if_alive.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

constexpr std::chrono::milliseconds FLUSH_INTERVAL{10};  ///< between two offers to subscribers with a full queue
constexpr std::chrono::microseconds FRAGMENT_GAP{100};   ///< usual between two fragments on a fast network
constexpr uint64_t SUBSCRIBER_SHARE = 8;                 ///< one subscriber may pin 1/8 of the pool
constexpr char SUBSCRIBER_LEFT[] = "the subscriber left";

}  // namespace

IncomingLinks::IncomingLinks(BridgeContext* context, Sessions* sessions, LocalPairs* pairs,
                             std::function<void()> on_ended)
  : context_(context), sessions_(sessions), pairs_(pairs), on_ended_(std::move(on_ended))
{
  context_->pool->setReclaim([this]() { collect(); });
}

void IncomingLinks::collect()
{
  sessions_->forEachIncoming(
      [](Session*, const LinkPtr& link)
      {
        if (link->ring)
        {
          link->ring->collect();
        }
      });
}

void IncomingLinks::open(const std::shared_ptr<ProcessPair>& pair, const BridgeRequest& request)
{
  const bool possible =
      !isLocalAddress(request.address) && !context_->draining && context_->config.topic(request.topic).forward;
  Session* const session = possible ? sessions_->ofDevice(request.address) : nullptr;
  const uint32_t id = context_->next_id++;
  const auto link = std::make_shared<IncomingLink>(id, request, pair);
  const auto local = std::make_shared<LocalLink>();
  if (session == nullptr || session->incoming.size() >= Session::MAX_LINKS || !pair->addSender(request.link, local))
  {
    pair->send(Packet::ended(request.link, LinkEnd::REFUSED));
    return;
  }
  local->on_packet = ifAlive(link, [this, session](const LinkPtr& alive, const Packet& packet, auto*)
                             { onSubscriber(session, alive, packet); });
  local->on_pair_ended =
      ifAlive(link, [this, session](const LinkPtr& alive)
              { end(session, alive, LinkEnd::CLOSED, alive->state != IncomingLink::State::WANTED); });
  link->end = local;
  link->on_blocked = [this]() { pauseBlocked(); };
  session->incoming[id] = link;
  if (session->peer->up())
  {
    this->request(session, link);
  }
}

void IncomingLinks::openWaiting(Session* session)
{
  const auto links = session->incoming;  // one that is not trusted ends
  for (const auto& link : links)
  {
    if (link.second->state == IncomingLink::State::WANTED)
    {
      request(session, link.second);
    }
  }
}

void IncomingLinks::request(Session* session, const LinkPtr& link)
{
  const BridgeRequest& request = link->request;
  if (!context_->config.trusts(session->identity, request.topic))
  {
    context_->refusals.warn("\"" + session->identity + "\" may not send " + request.topic + ", see trust");
    end(session, link, LinkEnd::REFUSED, false);
    return;
  }
  link->state = IncomingLink::State::OPENING;
  const LinkOpen open{request.socket_token, request.link_token, request.topic,
                      request.type,         request.publisher,  request.subscriber};
  session->peer->control(FrameHeader::of(FrameType::LINK_OPEN, link->id), open.encode());
}

void IncomingLinks::onSubscriber(Session* session, const LinkPtr& link, const Packet& packet)
{
  if (!link->ring || !link->ring->isProof(packet))
  {
    end(session, link, LinkEnd::CLOSED, link->state != IncomingLink::State::WANTED);
    return;
  }
  if (link->state == IncomingLink::State::OFFERED)
  {
    link->state = IncomingLink::State::CARRYING;
    session->peer->control(FrameHeader::of(FrameType::LINK_PROVED, link->id));
  }
}

void IncomingLinks::onLinkFrame(Session* session, const FrameHeader& header)
{
  const auto found = session->incoming.find(header.id);
  if (found == session->incoming.end())
  {
    return;
  }
  const LinkPtr link = found->second;
  switch (header.type)
  {
    case FrameType::LINK_READY:
      offer(session, link);
      break;
    case FrameType::LINK_START:
      if (link->state == IncomingLink::State::CARRYING)
      {
        link->start(header.offset, header.count);
      }
      break;
    default:
      end(session, link, static_cast<LinkEnd>(header.count), false);
      break;
  }
}

/// Offers shared memory to the subscriber.
void IncomingLinks::offer(Session* session, const LinkPtr& link)
{
  if (link->state != IncomingLink::State::OPENING)
  {
    return;  // the frame came again after an interruption
  }
  auto ring =
      std::make_unique<RingSender>(context_->pool.get(), (context_->config.pool_limit_mb << 20) / SUBSCRIBER_SHARE);
  std::string error;
  if (!ring->open(link->pair, link->request.link, &error))
  {
    if (!error.empty())
    {
      context_->log("no shared memory for " + link->request.subscriber + ": " + error);
    }
    end(session, link, LinkEnd::REFUSED, true);
    return;
  }
  link->ring = std::move(ring);
  link->state = IncomingLink::State::OFFERED;
}

void IncomingLinks::end(Session* session, const LinkPtr& ended, LinkEnd reason, bool tell_peer)
{
  const LinkPtr link = ended;  // `ended` may be the entry of the table
  if (session->incoming.erase(link->id) == 0)
  {
    return;
  }
  if (tell_peer)
  {
    session->peer->control(FrameHeader::of(FrameType::LINK_CLOSE, link->id, FROM_SUBSCRIBER),
                           encodeText(SUBSCRIBER_LEFT));
  }
  link->flush();
  link->pair->removeSender(link->request.link, link->end.get());
  link->pair->send(Packet::ended(link->request.link, reason));
  link->ring.reset();
  link->state = IncomingLink::State::WANTED;
  bool any = false;
  sessions_->forEachIncoming([&any](Session*, const LinkPtr&) { any = true; });
  if (!any)
  {
    context_->pool->trim();
  }
  on_ended_();
}

void IncomingLinks::drain(Session* session)
{
  const auto links = session->incoming;
  for (const auto& link : links)
  {
    if (session->peer->up() && link.second->state == IncomingLink::State::CARRYING)
    {
      // The peer closes the link when everything under way has arrived.
      session->peer->control(FrameHeader::of(FrameType::LINK_CLOSE, link.first, FROM_SUBSCRIBER),
                             encodeText("the bridge ends"));
    }
    else
    {
      end(session, link.second, LinkEnd::BACK_TO_TCP, session->peer->up());
    }
  }
}

void IncomingLinks::abandon(Session* session, bool hung)
{
  while (!session->incoming.empty())
  {
    end(session, session->incoming.begin()->second, hung ? LinkEnd::PUBLISHER_UNAWARE : LinkEnd::BACK_TO_TCP, false);
  }
  session->incoming_streams.clear();
}

/// Tells peers which subscribers take no more, and tries again later.
void IncomingLinks::pauseBlocked()
{
  bool any = false;
  sessions_->forEachIncoming(
      [&any](Session* session, const LinkPtr& link)
      {
        any = !link->flush() || any;
        if (link->blocked() != link->paused)
        {
          link->paused = link->blocked();
          session->peer->control(
              FrameHeader::of(link->paused ? FrameType::LINK_PAUSE : FrameType::LINK_RESUME, link->id));
        }
      });
  if (any && !blocked_timer_.running())
  {
    blocked_timer_.start(context_->loop, FLUSH_INTERVAL, [this]() { pauseBlocked(); });
  }
}

std::shared_ptr<IncomingStream> IncomingLinks::streamFor(Session* session, const FrameHeader& header)
{
  const auto found = session->incoming_streams.find(header.id);
  if (found != session->incoming_streams.end())
  {
    return found->second;
  }
  const bool begins = header.type == FrameType::MESSAGE || header.type == FrameType::BEGIN;
  if (!begins || session->incoming_streams.size() >= Session::MAX_STREAMS)
  {
    return nullptr;
  }
  const auto stream = std::make_shared<IncomingStream>(
      context_->pool.get(), context_->config.max_message_mb << 20,
      [session](uint32_t id)
      {
        const auto link = session->incoming.find(id);
        return link != session->incoming.end() ? link->second : nullptr;
      },
      [this](const uint8_t* bytes, size_t size, const IncomingStream::Decompressed& done)
      { return restore(bytes, size, done); });
  session->incoming_streams[header.id] = stream;
  return stream;
}

/// Decompresses an image. @return false if the codec is too busy
bool IncomingLinks::restore(const uint8_t* bytes, size_t size, const IncomingStream::Decompressed& done)
{
  return context_->codec->decode(
      bytes, size,
      [this, done](ImageCodec::Result result, std::vector<uint8_t> message, const std::string& detail)
      {
        if (result != ImageCodec::Result::CONVERTED)
        {
          context_->refusals.warn("a compressed image was lost: " + detail);
        }
        done(std::move(message));
      });
}

bool IncomingLinks::onStreamFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  const std::shared_ptr<IncomingStream> stream = streamFor(session, header);
  if (!stream)
  {
    return false;
  }
  const bool accepted = header.type == FrameType::MESSAGE    ? stream->onMessage(header, payload, length)
                        : header.type == FrameType::BEGIN    ? stream->onBegin(header, payload, length)
                        : header.type == FrameType::FRAGMENT ? stream->onFragment(header, length)
                                                             : stream->onAttach(header, payload, length);
  context_->loop->expectSoon(stream->arriving() ? FRAGMENT_GAP : std::chrono::microseconds(0));
  retireSegments();
  return accepted;
}

/// Tells the subscribers which segments the pool has given up.
void IncomingLinks::retireSegments()
{
  const std::vector<uint32_t> retired = context_->pool->takeRetired();
  if (retired.empty())
  {
    return;
  }
  pairs_->retire(retired);
}

}  // namespace pi_os_transport
