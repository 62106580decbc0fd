#include "bridge/outgoing_stream.h"

#include <algorithm>
#include <utility>

namespace pi_os_transport
{
namespace
{

/// Up to so much goes in one frame, is copied and leaves the publisher's memory at once [B].
constexpr uint32_t SMALL_MESSAGE = 16 << 10;
constexpr uint32_t FIRST_FRAGMENT = 32 << 10;

}  // namespace

void OutgoingLink::onPublisherWaits()
{
  publisher_waits_ = true;
  announceSpace();
}

void OutgoingLink::onProgress()
{
  progressed_ = true;
  announceSpace();
}

void OutgoingLink::announceSpace()
{
  if (publisher_waits_ && progressed_ && ring->hasRing() && ring->ring().available() < RingLayout::CAPACITY / 2)
  {
    publisher_waits_ = false;
    progressed_ = false;
    Packet packet;
    packet.type = Packet::SPACE;
    ring->channel().send(packet);
  }
}

OutgoingStream::OutgoingStream(uint32_t id, Peer* peer, EventLoop* loop, const TopicOptions& options, Compress compress,
                               std::string topic, std::string publisher, uint32_t max_message_bytes)
  : id_(id)
  , peer_(peer)
  , loop_(loop)
  , options_(options)
  , compress_(std::move(compress))
  , topic_(std::move(topic))
  , publisher_(std::move(publisher))
  , traffic_(options.priority == TopicOptions::Priority::LOW ? Traffic::BULK : Traffic::EXPRESS)
  , max_message_bytes_(max_message_bytes)
{
}

OutgoingStream::~OutgoingStream()
{
  loop_->cancel(rate_timer_);
}

void OutgoingStream::add(const std::shared_ptr<OutgoingLink>& link)
{
  links_.push_back(link);
  link->stream = weak_from_this();
}

void OutgoingStream::remove(const std::shared_ptr<OutgoingLink>& link)
{
  links_.erase(std::remove(links_.begin(), links_.end(), link), links_.end());
}

void OutgoingStream::offerAgain()
{
  peer_->offer(shared_from_this());
}

std::vector<OutgoingStream::Head> OutgoingStream::heads()
{
  std::vector<Head> heads;
  for (const std::shared_ptr<OutgoingLink>& link : links_)
  {
    Head head{link, {}, 0};
    if (link->state == OutgoingLink::State::CARRYING && !link->paused &&
        link->ring->ring().peek(&head.descriptor, &head.index))
    {
      heads.push_back(std::move(head));
    }
  }
  return heads;
}

OutgoingStream::OutgoingPtr OutgoingStream::next()
{
  for (;;)
  {
    if (options_.keep_latest)
    {
      dropSuperseded();
    }
    const std::vector<Head> candidates = heads();
    const Head* first = nullptr;
    bool attach = false;
    for (const Head& head : candidates)
    {
      if (head.descriptor.segment == Descriptor::LINK_START)
      {
        if (OutgoingPtr start = takeStart(head))
        {
          return start;
        }
      }
      attach = attach || (last_serial_ != 0 && head.descriptor.serial == last_serial_);
      if (first == nullptr || head.descriptor.serial < first->descriptor.serial)
      {
        first = &head;
      }
    }
    if (first == nullptr)
    {
      return nullptr;
    }
    const uint64_t serial = attach ? last_serial_ : first->descriptor.serial;
    if (serial != 0 && serial == skipped_serial_)
    {
      skip(candidates, serial);  // the same message, in the ring of one more link
      continue;
    }
    if (!attach && first->descriptor.length > max_message_bytes_)
    {
      const std::shared_ptr<OutgoingLink> link = first->link;
      on_too_large(link);
      continue;
    }
    if (!attach && !mayLeaveNow(first->link->latched))
    {
      if (first->link->latched)
      {
        dropSuperseded();
        return nullptr;  // the timer comes back to it
      }
      counters_.rate_limited += skip(candidates, serial) ? 1 : 0;
      skipped_serial_ = serial;
      continue;
    }
    if (OutgoingPtr message = take(candidates, serial))
    {
      message->attach = attach;
      return message;
    }
  }
}

OutgoingStream::OutgoingPtr OutgoingStream::takeStart(const Head& head)
{
  const int place = head.link->ring->ring().takePeeked(head.index);
  if (place < 0)
  {
    return nullptr;
  }
  head.link->ring->release(static_cast<uint32_t>(place));
  head.link->started = true;
  head.link->max_queue = head.descriptor.length;
  head.link->latched = head.descriptor.serial != 0;
  head.link->after_tcp = head.descriptor.after_tcp;
  ++head.link->unacked;
  auto start = std::make_shared<Outgoing>();
  start->start = true;
  start->targets.push_back(Outgoing::Target{head.link, LinkEntry{head.link->id, 0, head.descriptor.after_tcp}, -1});
  return start;
}

OutgoingStream::OutgoingPtr OutgoingStream::take(const std::vector<Head>& heads, uint64_t serial)
{
  auto message = std::make_shared<Outgoing>();
  message->serial = serial;
  bool unreadable = false;
  for (const Head& head : heads)
  {
    if (head.descriptor.serial != serial || head.descriptor.segment == Descriptor::LINK_START)
    {
      continue;
    }
    const int taken = head.link->ring->ring().takePeeked(head.index);
    if (taken < 0)
    {
      continue;  // the publisher has just dropped it
    }
    const uint32_t place = static_cast<uint32_t>(taken);
    const std::shared_ptr<MappedSegment> segment = head.link->ring->find(head.descriptor);
    if (!segment)
    {
      head.link->ring->release(place);
      unreadable = true;
      continue;
    }
    if (message->targets.empty())
    {
      message->segment = segment;
      message->length = head.descriptor.length;
      message->data = segment->data() != nullptr ? segment->data() + head.descriptor.offset : nullptr;
      const bool small = message->length <= SMALL_MESSAGE && !head.link->latched;
      if (small || message->data == nullptr)
      {
        message->copy.resize(message->length);
        unreadable = unreadable || !segment->copy(head.descriptor.offset, message->copy.data(), message->length);
        message->data = message->copy.data();
        message->segment.reset();
      }
    }
    const bool keep = !message->copy.empty() || message->length == 0 ? head.link->latched : true;
    if (!keep)
    {
      head.link->ring->release(place);
    }
    head.link->onProgress();
    ++head.link->unacked;
    message->targets.push_back(Outgoing::Target{
        head.link, LinkEntry{head.link->id, head.link->next_sequence++, head.descriptor.after_tcp}, keep ? taken : -1});
    if (serial == 0)
    {
      break;  // messages without a serial have nothing in common
    }
  }
  counters_.lost += unreadable ? 1 : 0;
  return message->targets.empty() ? nullptr : message;
}

bool OutgoingStream::skip(const std::vector<Head>& heads, uint64_t serial)
{
  bool skipped = false;
  for (const Head& head : heads)
  {
    if (head.descriptor.serial == serial && head.descriptor.segment != Descriptor::LINK_START)
    {
      const int place = head.link->ring->ring().takePeeked(head.index);
      if (place >= 0)
      {
        head.link->ring->release(static_cast<uint32_t>(place));
        head.link->onProgress();
        skipped = true;
      }
      if (serial == 0)
      {
        break;
      }
    }
  }
  return skipped;
}

bool OutgoingStream::mayLeaveNow(bool latched)
{
  if (options_.rate_limit_hz <= 0.0)
  {
    return true;
  }
  const SteadyTime now = SteadyClock::now();
  const auto period =
      std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(1.0 / options_.rate_limit_hz));
  // A message that comes a little early, because the publisher's clock jitters, does not cost a whole period.
  if (now + period / 10 < next_allowed_)
  {
    if (latched && rate_timer_ == 0)
    {
      rate_timer_ = loop_->at(next_allowed_,
                              [this]()
                              {
                                rate_timer_ = 0;
                                offerAgain();
                                peer_->pump();
                              });
    }
    return false;
  }
  next_allowed_ = now - next_allowed_ < period ? next_allowed_ + period : now + period;
  return true;
}

void OutgoingStream::dropSuperseded()
{
  bool counted = false;
  for (const std::shared_ptr<OutgoingLink>& link : links_)
  {
    Descriptor descriptor;
    uint32_t index;
    uint64_t dropped = 0;
    while (link->state == OutgoingLink::State::CARRYING && link->ring->ring().available() > 1 &&
           link->ring->ring().peek(&descriptor, &index) && descriptor.segment != Descriptor::LINK_START)
    {
      const int place = link->ring->ring().takePeeked(index);
      if (place >= 0)
      {
        link->ring->release(static_cast<uint32_t>(place));
        link->onProgress();
        ++dropped;
      }
    }
    if (dropped > 0 && !std::exchange(counted, true))
    {
      counters_.superseded += dropped;
    }
  }
}

Traffic OutgoingStream::wantedTraffic(const Outgoing& message) const
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

bool OutgoingStream::prepare(const OutgoingPtr& message)
{
  if (!compress_ || message->start || message->attach || message->compressed)
  {
    return false;
  }
  const auto done = [weak = weak_from_this(), message](std::vector<uint8_t> bytes)
  {
    const std::shared_ptr<OutgoingStream> self = weak.lock();
    if (!self || !std::exchange(self->preparing_, false))
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
      self->resend_.push_back(message);  // after all that was taken before it
    }
    else
    {
      self->waiting_ = message;
    }
    self->offerAgain();
    self->peer_->pump();
  };
  preparing_ = compress_(message->data, message->length, done);
  counters_.uncompressed += preparing_ ? 0 : 1;
  return preparing_;
}

bool OutgoingStream::sendNext(Peer*, Lane* lane)
{
  if (sending_)
  {
    return fragment(lane, sending_);
  }
  OutgoingPtr message = std::exchange(waiting_, nullptr);
  if (!message && !resend_.empty())
  {
    message = resend_.front();
    resend_.pop_front();
  }
  else if (!message)
  {
    message = preparing_ ? nullptr : next();
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
                              const OutgoingPtr& message, bool last)
{
  FrameHeader stamped = header;
  stamped.session = peer_->theirSecret();
  Lane::Acknowledged acknowledged;
  if (last)
  {
    acknowledged = [weak = weak_from_this()]()
    {
      if (const std::shared_ptr<OutgoingStream> self = weak.lock())
      {
        self->onAcknowledged();
      }
    };
  }
  return lane->send(stamped, payload, pieces, message, std::move(acknowledged), header.type == FrameType::BEGIN);
}

bool OutgoingStream::begin(Lane* lane, const OutgoingPtr& message)
{
  FrameHeader header;
  header.id = id_;
  bool whole = true;
  if (message->start)
  {
    const Outgoing::Target& target = message->targets.front();
    header.type = FrameType::LINK_START;
    header.id = target.link->id;
    header.count = target.entry.after_tcp;
    header.offset = target.link->max_queue;
  }
  else
  {
    PayloadWriter entries;
    for (const Outgoing::Target& target : message->targets)
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
    last_serial_ = message->serial;
    ++counters_.messages;
    counters_.bytes += message->length;
  }
  return whole || fragment(lane, message);
}

bool OutgoingStream::fragment(Lane* lane, const OutgoingPtr& message)
{
  FrameHeader header;
  header.type = FrameType::FRAGMENT;
  header.id = id_;
  header.offset = message->sent;
  // A small first one: the peer works on it while the next one is sent.
  const uint32_t most = message->sent == 0 ? std::min(FIRST_FRAGMENT, lane->fragmentBytes()) : lane->fragmentBytes();
  const uint32_t bytes = std::min(most, message->length - message->sent);
  const bool last = message->sent + bytes == message->length;
  const iovec piece{const_cast<uint8_t*>(message->data) + message->sent, bytes};
  if (!transmit(lane, header, &piece, 1, message, last))
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
  const OutgoingPtr message = unacked_.front();
  unacked_.pop_front();
  finish(message.get());
  if (waiting_)
  {
    offerAgain();
  }
}

void OutgoingStream::releasePlaces(Outgoing* message)
{
  for (Outgoing::Target& target : message->targets)
  {
    const int place = std::exchange(target.place, -1);
    if (place >= 0)
    {
      target.link->ring->release(static_cast<uint32_t>(place));
      target.link->onProgress();
    }
  }
}

void OutgoingStream::finish(Outgoing* message)
{
  releasePlaces(message);
  for (const Outgoing::Target& target : std::exchange(message->targets, {}))
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
  last_serial_ = 0;
  if (waiting_)
  {
    unacked_.push_back(std::exchange(waiting_, nullptr));
  }
  resend_.insert(resend_.begin(), unacked_.begin(), unacked_.end());
  unacked_.clear();
  // As if the publisher's queue had held what is sent again: the oldest goes.
  for (const std::shared_ptr<OutgoingLink>& link : std::vector<std::shared_ptr<OutgoingLink>>(links_))
  {
    if (link->max_queue == 0)
    {
      continue;
    }
    size_t waiting = link->ring->ring().available();
    for (auto message = resend_.rbegin(); message != resend_.rend(); ++message)
    {
      std::vector<Outgoing::Target>& targets = (*message)->targets;
      const auto target = std::find_if(targets.begin(), targets.end(),
                                       [&link](const Outgoing::Target& other) { return other.link == link; });
      if ((*message)->start || target == targets.end() || ++waiting <= link->max_queue)
      {
        continue;
      }
      Outgoing dropped;
      dropped.targets.push_back(*target);
      targets.erase(target);
      finish(&dropped);
      ++counters_.superseded;
    }
  }
  resend_.erase(std::remove_if(resend_.begin(), resend_.end(),
                               [](const OutgoingPtr& message) { return message->targets.empty(); }),
                resend_.end());
  for (const OutgoingPtr& message : resend_)
  {
    message->attach = false;  // the peer may not have that message any more
  }
}

void OutgoingStream::abandon()
{
  counters_.lost += static_cast<uint64_t>(
      std::count_if(unacked_.begin(), unacked_.end(), [](const OutgoingPtr& message) { return !message->start; }));
  preparing_ = false;
  sending_.reset();
  waiting_.reset();
  unacked_.clear();
  resend_.clear();
}

}  // namespace pi_os_transport
