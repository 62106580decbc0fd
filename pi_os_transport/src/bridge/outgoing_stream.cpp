#include "bridge/outgoing_stream.h"

#include <algorithm>
#include <utility>

#include "event_loop/if_alive.h"
#include "shm/ring_sender.h"

namespace pi_os_transport
{
namespace
{

constexpr uint32_t FIRST_FRAGMENT = 32 << 10;

}  // namespace

OutgoingStream::OutgoingStream(uint32_t id, Peer* peer, EventLoop* loop, const TopicOptions& options, Compress compress,
                               std::string topic, std::string publisher, uint32_t max_message_bytes)
  : id_(id)
  , peer_(peer)
  , options_(options)
  , compress_(std::move(compress))
  , topic_(std::move(topic))
  , publisher_(std::move(publisher))
  , traffic_(options.priority == TopicOptions::Priority::LOW ? Traffic::BULK : Traffic::EXPRESS)
  , selector_(
        loop, options, max_message_bytes, &counters_,
        [this]()
        {
          offerAgain();
          peer_->pump();
        },
        [this](const std::shared_ptr<OutgoingLink>& link) { on_too_large(link); })
{
}

void OutgoingStream::add(const std::shared_ptr<OutgoingLink>& link)
{
  selector_.add(link);
  link->stream = weak_from_this();
}

void OutgoingStream::offerAgain()
{
  peer_->offer(shared_from_this());
}

Traffic OutgoingStream::wantedTraffic(const OutgoingMessage& message) const
{
  if (message.start || message.attach || options_.priority == TopicOptions::Priority::HIGH)
  {
    return options_.priority == TopicOptions::Priority::HIGH ? Traffic::EXPRESS : traffic_;
  }
  if (options_.priority == TopicOptions::Priority::LOW || message.length > SMALL_MESSAGE)
  {
    return Traffic::BULK;
  }
  return unacked_.empty() ? Traffic::EXPRESS : traffic_;
}

bool OutgoingStream::prepare(const OutgoingMessagePtr& message)
{
  if (!compress_ || message->start || message->attach || message->compressed)
  {
    return false;
  }
  const auto done = [message](const std::shared_ptr<OutgoingStream>& self, std::vector<uint8_t> bytes)
  {
    if (!std::exchange(self->preparing_, false))
    {
      return;
    }
    if (bytes.empty())
    {
      ++self->counters_.uncompressed;
    }
    else
    {
      message->copy = std::move(bytes);
      message->data = message->copy.data();
      message->length = static_cast<uint32_t>(message->copy.size());
      message->compressed = true;
    }
    if (self->waiting_ || !self->resend_.empty())
    {
      self->resend_.push_back(message);  // after the messages taken before it
    }
    else
    {
      self->waiting_ = message;
    }
    self->offerAgain();
    self->peer_->pump();
  };
  preparing_ = compress_(message->data, message->length, ifAlive(weak_from_this(), done));
  counters_.uncompressed += preparing_ ? 0 : 1;
  return preparing_;
}

bool OutgoingStream::sendNext(Peer*, Lane* lane)
{
  if (sending_)
  {
    return fragment(lane, sending_);
  }
  OutgoingMessagePtr message = std::exchange(waiting_, nullptr);
  if (!message && !resend_.empty())
  {
    message = resend_.front();
    resend_.pop_front();
  }
  else if (!message)
  {
    message = preparing_ ? nullptr : selector_.next();
    if (!message || prepare(message))
    {
      return false;
    }
  }
  const Traffic wanted = wantedTraffic(*message);
  if (wanted != traffic_)
  {
    waiting_ = message;
    if (unacked_.empty())
    {
      traffic_ = wanted;
      offerAgain();
    }
    return false;
  }
  return begin(lane, message);
}

bool OutgoingStream::transmit(Lane* lane, const FrameHeader& header, const iovec* payload, size_t pieces,
                              const OutgoingMessagePtr& message, bool last)
{
  FrameHeader stamped = header;
  stamped.session = peer_->theirSecret();
  Lane::Acknowledged acknowledged;
  if (last)
  {
    acknowledged = ifAlive(weak_from_this(), [](const auto& self) { self->onAcknowledged(); });
  }
  return lane->send(stamped, payload, pieces, message, std::move(acknowledged), header.type == FrameType::BEGIN);
}

bool OutgoingStream::begin(Lane* lane, const OutgoingMessagePtr& message)
{
  FrameHeader header;
  header.id = id_;
  bool whole = true;
  if (message->start)
  {
    const OutgoingMessage::Target& target = message->targets.front();
    header.type = FrameType::LINK_START;
    header.id = target.link->id;
    header.count = target.entry.after_tcp;
    header.offset = target.link->max_queue;
  }
  else
  {
    PayloadWriter entries;
    for (const OutgoingMessage::Target& target : message->targets)
    {
      target.entry.append(&entries);
    }
    message->head = entries.take();
    header.count = static_cast<uint32_t>(message->targets.size()) | (message->compressed ? COMPRESSED : 0);
    whole = message->attach || message->length <= SMALL_MESSAGE;
    header.type = message->attach ? FrameType::ATTACH : (whole ? FrameType::MESSAGE : FrameType::BEGIN);
    header.offset = message->attach ? 0 : message->length;
  }
  const bool with_bytes = header.type == FrameType::MESSAGE && message->length > 0;
  const iovec pieces[2] = {{message->head.data(), message->head.size()},
                           {const_cast<uint8_t*>(message->data), with_bytes ? message->length : 0}};
  if (!transmit(lane, header, pieces, message->head.empty() ? 0 : (with_bytes ? 2 : 1), message, whole))
  {
    waiting_ = message;
    offerAgain();
    return false;
  }
  unacked_.push_back(message);
  if (!whole)
  {
    sending_ = message;
    message->sent = 0;
  }
  if (!message->start && !message->attach)
  {
    selector_.setLastSerial(message->serial);
    ++counters_.messages;
    counters_.bytes += message->length;
  }
  return whole || fragment(lane, message);
}

bool OutgoingStream::fragment(Lane* lane, const OutgoingMessagePtr& message)
{
  // The first one is small: the peer processes it while the next one is sent.
  const uint32_t most = message->sent == 0 ? std::min(FIRST_FRAGMENT, lane->fragmentBytes()) : lane->fragmentBytes();
  const uint32_t bytes = std::min(most, message->length - message->sent);
  const bool last = message->sent + bytes == message->length;
  const iovec piece{const_cast<uint8_t*>(message->data) + message->sent, bytes};
  if (!transmit(lane, FrameHeader::of(FrameType::FRAGMENT, id_, 0, message->sent), &piece, 1, message, last))
  {
    offerAgain();
    return false;
  }
  message->sent += bytes;
  if (last)
  {
    sending_.reset();
  }
  return true;
}

void OutgoingStream::onAcknowledged()
{
  if (unacked_.empty())
  {
    return;
  }
  const OutgoingMessagePtr message = unacked_.front();
  unacked_.pop_front();
  finish(message.get());
  if (waiting_)
  {
    offerAgain();
  }
}

void OutgoingStream::releasePlaces(OutgoingMessage* message)
{
  for (OutgoingMessage::Target& target : message->targets)
  {
    const int place = std::exchange(target.place, -1);
    if (place >= 0)
    {
      target.link->onArrived(static_cast<uint32_t>(place));
    }
  }
}

void OutgoingStream::finish(OutgoingMessage* message)
{
  releasePlaces(message);
  for (const OutgoingMessage::Target& target : std::exchange(message->targets, {}))
  {
    --target.link->unacked;
    if (target.link->isDone())
    {
      on_link_done(target.link);
    }
  }
}

void OutgoingStream::rewind()
{
  sending_.reset();
  selector_.setLastSerial(0);
  if (waiting_)
  {
    unacked_.push_back(std::exchange(waiting_, nullptr));
  }
  resend_.insert(resend_.begin(), unacked_.begin(), unacked_.end());
  unacked_.clear();
  // Messages to be sent again count as part of the publisher's queue: the oldest are dropped, beyond what the socket of
  // TCPROS would hold.
  for (const std::shared_ptr<OutgoingLink>& link : std::vector<std::shared_ptr<OutgoingLink>>(links()))
  {
    if (link->max_queue == 0)
    {
      continue;
    }
    size_t waiting = link->ring->ring().available();
    uint64_t bytes = 0;
    for (auto message = resend_.rbegin(); message != resend_.rend(); ++message)
    {
      std::vector<OutgoingMessage::Target>& targets = (*message)->targets;
      const auto target = std::find_if(targets.begin(), targets.end(),
                                       [&link](const OutgoingMessage::Target& other) { return other.link == link; });
      bytes += target != targets.end() ? (*message)->length : 0;
      if ((*message)->start || target == targets.end() || ++waiting <= link->max_queue || bytes <= SOCKET_BYTES)
      {
        continue;
      }
      OutgoingMessage dropped;
      dropped.targets.push_back(*target);
      targets.erase(target);
      finish(&dropped);
      ++counters_.superseded;
    }
  }
  resend_.erase(std::remove_if(resend_.begin(), resend_.end(),
                               [](const OutgoingMessagePtr& message) { return message->targets.empty(); }),
                resend_.end());
  for (const OutgoingMessagePtr& message : resend_)
  {
    message->attach = false;  // the peer may have dropped the message
  }
}

void OutgoingStream::abandon()
{
  // A publisher that lives still has them, and sends them over TCPROS.
  const auto lost = [](const OutgoingMessagePtr& message)
  {
    const auto& targets = message->targets;
    return !message->start && std::any_of(targets.begin(), targets.end(), [](const OutgoingMessage::Target& target)
                                          { return target.link->publisher_gone; });
  };
  counters_.lost += static_cast<uint64_t>(std::count_if(unacked_.begin(), unacked_.end(), lost));
  preparing_ = false;
  sending_.reset();
  waiting_.reset();
  unacked_.clear();
  resend_.clear();
}

}  // namespace pi_os_transport
