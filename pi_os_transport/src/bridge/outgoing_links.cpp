#include "bridge/outgoing_links.h"

#include <algorithm>
#include <optional>
#include <system_error>
#include <utility>

#include "shm/event.h"

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
        onDoorbell(link);
      }
      break;
    case FrameType::LINK_PAUSE:
    case FrameType::LINK_RESUME:
      link->paused = header.type == FrameType::LINK_PAUSE;
      if (!link->paused && link->ring->hasRing())
      {
        link->onResumed();
        onDoorbell(link);
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
  SideChannel channel = SideChannel::connect("pi_os/" + open.socket_token);
  if (!channel || !channel.send(Packet::of(Packet::HELLO, link_token->high, link_token->low, 1)))
  {
    return "the publisher cannot be reached by its bridge: it runs as another user, or in another container";
  }
  const auto link = std::make_shared<OutgoingLink>(id, std::make_shared<RingReceiver>(std::move(channel)));
  link->subscriber = open.subscriber;
  session->outgoing[id] = link;
  streamFor(session, open)->add(link);
  context_->loop->add(link->ring->fd(), EPOLLIN, [this, session, link](uint32_t) { onPublisher(session, link); });
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

void OutgoingLinks::onPublisher(Session* session, const LinkPtr& link)
{
  const SideChannel::Receive received = link->ring->readPackets();
  if (link->ring->takePublisherWaits())
  {
    link->onPublisherWaits();
  }
  if (link->ring->hasRing() && link->state == OutgoingLink::State::OPENING)
  {
    link->state = OutgoingLink::State::OFFERED;
    if (!watchDoorbell(link))
    {
      end(session, link, LinkEnd::REFUSED, "the publisher sent no doorbell");
      return;
    }
    session->peer->control(FrameHeader::of(FrameType::LINK_READY, link->id));
  }
  if (received == SideChannel::Receive::NOTHING)
  {
    return;
  }
  if (link->state != OutgoingLink::State::CARRYING || received == SideChannel::Receive::MALFORMED)
  {
    end(session, link, LinkEnd::BACK_TO_TCP, "the publisher ended the link");
    return;
  }
  if (link->ring->ended() == LinkEnd::BACK_TO_TCP)
  {
    end(session, link, LinkEnd::BACK_TO_TCP, "the publisher went back to TCPROS");
    return;
  }
  // The publisher's process has ended, or has closed the link. What is left in the ring is still delivered.
  link->publisher_gone = true;
  context_->loop->remove(link->ring->fd());
  if (link->isDone())
  {
    close(session, link);
    return;
  }
  onDoorbell(link);
}

/// @return false if the descriptor that the publisher sent as its doorbell cannot be waited for
bool OutgoingLinks::watchDoorbell(const LinkPtr& link)
{
  try
  {
    context_->loop->add(link->ring->doorbell(NETWORK_THREAD), EPOLLIN, [this, link](uint32_t) { onDoorbell(link); });
    return true;
  }
  catch (const std::system_error&)
  {
    return false;
  }
}

void OutgoingLinks::onDoorbell(const LinkPtr& link)
{
  clearEvent(link->ring->doorbell(NETWORK_THREAD));  // looking into the ring is harmless also if nothing rang
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
  if (!kept->publisher_gone)
  {
    context_->loop->remove(kept->ring->fd());
  }
  if (kept->ring->hasRing())
  {
    context_->loop->remove(kept->ring->doorbell(NETWORK_THREAD));
  }
  kept->ring->channel().close();
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
