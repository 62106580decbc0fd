#include "bridge/message_selector.h"

#include <algorithm>
#include <utility>

namespace pi_os_transport
{

MessageSelector::MessageSelector(EventLoop* loop, const TopicOptions& options, uint32_t max_message_bytes,
                                 StreamCounters* counters, std::function<void()> on_due, OnLink on_too_large)
  : loop_(loop)
  , options_(options)
  , max_message_bytes_(max_message_bytes)
  , counters_(counters)
  , on_due_(std::move(on_due))
  , on_too_large_(std::move(on_too_large))
{
}

void MessageSelector::remove(const std::shared_ptr<OutgoingLink>& link)
{
  links_.erase(std::remove(links_.begin(), links_.end(), link), links_.end());
}

std::vector<MessageSelector::Head> MessageSelector::heads()
{
  std::vector<Head> heads;
  for (const std::shared_ptr<OutgoingLink>& link : links_)
  {
    Head head{link, {}, 0, nullptr};
    if (link->state == OutgoingLink::State::CARRYING && !link->paused &&
        link->ring->ring().peek(&head.descriptor, &head.index) &&
        (head.descriptor.segment == Descriptor::LINK_START ||
         link->ring->find(head.descriptor, &head.segment) != RingReceiver::Take::WAITING))
    {
      heads.push_back(std::move(head));
    }
  }
  return heads;
}

OutgoingMessagePtr MessageSelector::next()
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
        if (OutgoingMessagePtr start = takeStart(head))
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
      skip(candidates, serial);  // the same message in the ring of another link
      continue;
    }
    if (!attach && first->descriptor.length > max_message_bytes_)
    {
      const std::shared_ptr<OutgoingLink> link = first->link;
      on_too_large_(link);
      continue;
    }
    if (!attach && !mayLeaveNow(first->link->latched))
    {
      if (first->link->latched)
      {
        dropSuperseded();
        return nullptr;  // the timer sends it later
      }
      counters_->rate_limited += skip(candidates, serial) ? 1 : 0;
      skipped_serial_ = serial;
      continue;
    }
    if (OutgoingMessagePtr message = take(candidates, serial))
    {
      message->attach = attach;
      return message;
    }
  }
}

OutgoingMessagePtr MessageSelector::takeStart(const Head& head)
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
  auto start = std::make_shared<OutgoingMessage>();
  start->start = true;
  start->targets.push_back(
      OutgoingMessage::Target{head.link, LinkEntry{head.link->id, 0, head.descriptor.after_tcp}, -1});
  return start;
}

OutgoingMessagePtr MessageSelector::take(const std::vector<Head>& heads, uint64_t serial)
{
  auto message = std::make_shared<OutgoingMessage>();
  message->serial = serial;
  bool unreadable = false;
  for (const Head& head : heads)
  {
    const bool wanted = head.descriptor.serial == serial && head.descriptor.segment != Descriptor::LINK_START;
    if (wanted && takeFrom(head, message.get(), &unreadable) && serial == 0)
    {
      break;  // messages without a serial are all different
    }
  }
  counters_->lost += unreadable ? 1 : 0;
  return message->targets.empty() ? nullptr : message;
}

/// Takes the message from one ring and adds its link to the targets. @return false if this is impossible
bool MessageSelector::takeFrom(const Head& head, OutgoingMessage* message, bool* unreadable)
{
  OutgoingLink& link = *head.link;
  const int taken = link.ring->ring().takePeeked(head.index);
  if (taken < 0)
  {
    return false;  // the publisher dropped the message meanwhile
  }
  const uint32_t place = static_cast<uint32_t>(taken);
  const std::shared_ptr<MappedSegment>& segment = head.segment;
  if (!segment)
  {
    link.ring->release(place);
    *unreadable = true;
    return false;
  }
  if (message->targets.empty())
  {
    message->segment = segment;
    message->length = head.descriptor.length;
    message->data = segment->data() != nullptr ? segment->data() + head.descriptor.offset : nullptr;
    if (message->data == nullptr && message->length > 0)
    {
      message->copy.resize(message->length);
      *unreadable = !segment->copy(head.descriptor.offset, message->copy.data(), message->length) || *unreadable;
      message->data = message->copy.data();
      message->segment.reset();
    }
  }
  link.onProgress();
  ++link.unacked;
  const LinkEntry entry{link.id, link.next_sequence++, head.descriptor.after_tcp};
  message->targets.push_back(OutgoingMessage::Target{head.link, entry, taken});
  return true;
}

bool MessageSelector::skip(const std::vector<Head>& heads, uint64_t serial)
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

bool MessageSelector::mayLeaveNow(bool latched)
{
  if (options_.rate_limit_hz <= 0.0)
  {
    return true;
  }
  const SteadyTime now = SteadyClock::now();
  const auto period =
      std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(1.0 / options_.rate_limit_hz));
  // A message may be 10 % early: the publisher's clock jitters.
  if (now + period / 10 < next_allowed_)
  {
    if (latched && !rate_timer_.running())
    {
      rate_timer_.start(loop_, next_allowed_, on_due_);
    }
    return false;
  }
  next_allowed_ = now - next_allowed_ < period ? next_allowed_ + period : now + period;
  return true;
}

void MessageSelector::dropSuperseded()
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
      counters_->superseded += dropped;
    }
  }
}

}  // namespace pi_os_transport
