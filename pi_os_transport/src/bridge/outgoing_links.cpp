#include "bridge/outgoing_links.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "event_loop/if_alive.h"
#include "shm/topic_mark.h"

namespace pi_os_transport
{

bool OutgoingLinks::onLinkFrame(Session* session, const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  if (header.type == FrameType::LINK_OPEN)
  {
    LinkOpen request;
    if (!LinkOpen::decode(payload, length, &request))
    {
      return false;
    }
    open(session, header.id, request);
    return true;
  }
  const auto found = session->outgoing.find(header.id);
  if (found == session->outgoing.end())
  {
    return true;
  }
  const LinkPtr link = found->second;
  switch (header.type)
  {
    case FrameType::LINK_PROVED:
      if (link->state == OutgoingLink::State::OFFERED)
      {
        link->state = OutgoingLink::State::CARRYING;
        link->ring->sendProof();
        onNews(link);
      }
      break;
    case FrameType::LINK_PAUSE:
    case FrameType::LINK_RESUME:
      link->paused = header.type == FrameType::LINK_PAUSE;
      if (!link->paused && link->ring->hasRing())
      {
        link->onResumed();
        onNews(link);
      }
      break;
    default:
      end(session, link, LinkEnd::BACK_TO_TCP, "the subscriber left");
      break;
  }
  return true;
}

void OutgoingLinks::open(Session* session, uint32_t id, const LinkOpen& open)
{
  const auto known = session->outgoing.find(id);
  if (known != session->outgoing.end())
  {
    if (known->second->state != OutgoingLink::State::OPENING)
    {
      session->peer->control(FrameHeader::of(FrameType::LINK_READY, id));
    }
    return;
  }
  const std::string refusal = fetch(session, id, open);
  if (!refusal.empty())
  {
    session->peer->control(FrameHeader::of(FrameType::LINK_CLOSE, id, static_cast<uint32_t>(LinkEnd::REFUSED)),
                           encodeText(refusal));
  }
}

std::string OutgoingLinks::fetch(Session* session, uint32_t id, const LinkOpen& open)
{
  const std::optional<Token> socket_token = Token::fromString(open.socket_token);
  const std::optional<Token> link_token = Token::fromString(open.link_token);
  if (!socket_token || !link_token || session->outgoing.size() >= Session::MAX_LINKS ||
      session->outgoing_streams.size() >= Session::MAX_STREAMS || context_->draining)
  {
    return "not acceptable";
  }
  if (!context_->config.topic(open.topic).forward)
  {
    return "its publisher's bridge does not forward this topic";
  }
  if (!context_->config.trusts(session->identity, open.topic))
  {
    context_->refusals.warn("\"" + session->identity + "\" may not receive " + open.topic + ", see trust");
    return "its publisher's bridge does not trust this device with the topic";
  }
  const std::shared_ptr<ProcessPair> pair = pairs_->with(open.socket_token);
  const auto local = std::make_shared<LocalLink>();
  const auto link = pair ? std::make_shared<OutgoingLink>(id, std::make_shared<RingReceiver>(pair, local)) : nullptr;
  // The publisher compares the mark: the peer may name a topic that is not the link's.
  if (!link || !link->ring->sendHello(*link_token, topicMark(*link_token, open.topic)))
  {
    return "the publisher cannot be reached by its bridge: it runs as another user, or in another container";
  }
  local->on_packet = ifAlive(link, [this, session](const LinkPtr& alive, const Packet& packet, auto* descriptors)
                             { onPublisher(session, alive, packet, descriptors); });
  local->on_pair_ended =
      ifAlive(link, [this, session](const LinkPtr& alive) { onPublisherEnd(session, alive, LinkEnd::CLOSED); });
  local->on_news = ifAlive(link, [this](const LinkPtr& alive) { onNews(alive); });
  link->subscriber = open.subscriber;
  session->outgoing[id] = link;
  streamFor(session, open)->add(link);
  return {};
}

std::shared_ptr<OutgoingStream> OutgoingLinks::streamFor(Session* session, const LinkOpen& open)
{
  std::shared_ptr<OutgoingStream>& stream = session->outgoing_streams[open.socket_token + " " + open.topic];
  if (stream)
  {
    return stream;
  }
  const TopicOptions& options = context_->config.topic(open.topic);
  stream = std::make_shared<OutgoingStream>(
      context_->next_id++, session->peer.get(), context_->loop, options, compressionFor(options, open), open.topic,
      open.publisher, std::min(context_->config.max_message_mb << 20, session->peer->maxMessageBytes()));
  stream->on_link_done = [this, session](const LinkPtr& link) { close(session, link); };
  stream->on_too_large = [this, session](const LinkPtr& link)
  { end(session, link, LinkEnd::REFUSED, "a message is larger than max_message_mb"); };
  return stream;
}

/// Null if the topic is sent as it is.
OutgoingStream::Compress OutgoingLinks::compressionFor(const TopicOptions& options, const LinkOpen& open)
{
  if (options.compression.empty() || open.type != "sensor_msgs/Image")
  {
    return nullptr;
  }
  const auto kind = options.compression == "png" ? ImageCodec::Compression::PNG : ImageCodec::Compression::JPEG;
  return [this, kind, quality = options.quality, topic = open.topic](const uint8_t* bytes, size_t length,
                                                                     const OutgoingStream::Compressed& done)
  {
    return context_->codec->encode(
        kind, quality, bytes, length,
        [this, done, topic](ImageCodec::Result result, std::vector<uint8_t> message, const std::string& detail)
        {
          if (result != ImageCodec::Result::CONVERTED)
          {
            context_->refusals.warn(topic + " is sent uncompressed: " + detail);
          }
          done(std::move(message));
        });
  };
}

void OutgoingLinks::onPublisher(Session* session, const LinkPtr& link, const Packet& packet,
                                SideChannel::Descriptors* descriptors)
{
  if (packet.type == Packet::WAITING)
  {
    link->onPublisherWaits();
  }
  else if (packet.type == Packet::OFFER && link->state == OutgoingLink::State::OPENING)
  {
    if (!link->ring->onOffer(packet, descriptors))
    {
      end(session, link, LinkEnd::REFUSED, "the publisher's memory cannot be mapped");
      return;
    }
    link->state = OutgoingLink::State::OFFERED;
    session->peer->control(FrameHeader::of(FrameType::LINK_READY, link->id));
  }
  else if (packet.type == Packet::ENDED)
  {
    onPublisherEnd(session, link, static_cast<LinkEnd>(packet.values[0]));
  }
}

void OutgoingLinks::onPublisherEnd(Session* session, const LinkPtr& link, LinkEnd reason)
{
  if (link->state != OutgoingLink::State::CARRYING)
  {
    end(session, link, LinkEnd::BACK_TO_TCP, "the publisher ended the link");
    return;
  }
  if (reason == LinkEnd::BACK_TO_TCP)
  {
    end(session, link, LinkEnd::BACK_TO_TCP, "the publisher went back to TCPROS");
    return;
  }
  // The publisher's process has ended, or has closed the link. What is left in the ring is still delivered.
  link->publisher_gone = true;
  link->ring->detach();
  if (link->isDone())
  {
    close(session, link);
    return;
  }
  onNews(link);
}

void OutgoingLinks::onNews(const LinkPtr& link)
{
  if (const std::shared_ptr<OutgoingStream> stream = link->stream.lock())
  {
    stream->peer()->offer(stream);
    stream->peer()->pump();
  }
}

/// Ends a link whose messages may still be under way. The publisher goes back to TCPROS when they have arrived.
void OutgoingLinks::end(Session* session, const LinkPtr& link, LinkEnd reason, const std::string& text)
{
  link->state = OutgoingLink::State::CLOSING;
  link->end_reason = reason;
  link->end_text = text;
  if (link->isDone())
  {
    close(session, link);
  }
}

void OutgoingLinks::close(Session* session, const LinkPtr& link)
{
  const LinkEnd reason = link->publisher_gone ? LinkEnd::CLOSED : link->end_reason;
  session->peer->control(FrameHeader::of(FrameType::LINK_CLOSE, link->id, static_cast<uint32_t>(reason)),
                         encodeText(link->end_text));
  forget(session, link);
}

void OutgoingLinks::forget(Session* session, const LinkPtr& link)
{
  const LinkPtr kept = link;  // `link` may be the entry of the table
  if (session->outgoing.erase(kept->id) == 0)
  {
    return;
  }
  kept->ring->leave();
  if (const std::shared_ptr<OutgoingStream> stream = kept->stream.lock())
  {
    stream->remove(kept);
    auto& streams = session->outgoing_streams;
    const auto entry = std::find_if(streams.begin(), streams.end(),
                                    [&stream](const auto& candidate) { return candidate.second == stream; });
    if (stream->links().empty() && entry != streams.end())
    {
      streams.erase(entry);
    }
  }
  on_ended_();
}

void OutgoingLinks::drain(Session* session)
{
  const auto links = session->outgoing;
  for (const auto& link : links)
  {
    end(session, link.second, LinkEnd::BACK_TO_TCP, "the bridge ends");
  }
}

void OutgoingLinks::abandon(Session* session)
{
  for (const auto& stream : session->outgoing_streams)
  {
    stream.second->abandon();
  }
  while (!session->outgoing.empty())
  {
    forget(session, session->outgoing.begin()->second);
  }
  session->outgoing_streams.clear();
}

}  // namespace pi_os_transport
