#include "bridge/incoming_stream.h"

#include <cstring>
#include <utility>

#include "event_loop/if_alive.h"
#include "pi_os_transport/little_endian.h"

namespace pi_os_transport
{
namespace
{

/// Most that is kept for a subscriber that takes nothing [B]: more than is under way when the peer is told to pause.
/// Small messages count as more, for the memory around them.
constexpr uint64_t MAX_BACKLOG = 32 << 20;
constexpr uint64_t KEPT_OVERHEAD = 256;
/// Most compressed images of one stream that wait before the peer is told to pause.
constexpr size_t MAX_UNDECODED = 4;

}  // namespace

std::shared_ptr<PooledMessage> PooledMessage::make(SlotPool* pool, uint32_t length)
{
  uint8_t* const buffer = pool->allocate(size_t{length} + LENGTH_PREFIX);
  if (buffer == nullptr)
  {
    return nullptr;
  }
  storeLittleEndian<uint32_t>(buffer, length);
  return std::shared_ptr<PooledMessage>(new PooledMessage(pool, buffer, length));
}

void IncomingLink::start(size_t max_queue, uint32_t after_tcp)
{
  if (!std::exchange(started_, true))
  {
    max_queue_ = max_queue;
    ring->pushStart(max_queue, false, after_tcp);
  }
}

bool IncomingLink::isNew(const LinkEntry& entry)
{
  const int32_t ahead = static_cast<int32_t>(entry.sequence - last_sequence_);
  if (!started_ || state != State::CARRYING || ahead <= 0)
  {
    return false;  // repeated after an interruption
  }
  lost_ += static_cast<uint64_t>(ahead - 1);
  last_sequence_ = entry.sequence;
  return true;
}

bool IncomingLink::push(const LinkEntry& entry, const PooledMessage& message)
{
  message.addReference();
  if (ring->push(message.buffer(), message.length(), max_queue_, entry.after_tcp, 0) != RingSender::Push::WRITTEN)
  {
    message.dropReference();
    return false;
  }
  ++messages_;
  bytes_ += message.length();
  return true;
}

void IncomingLink::deliver(const LinkEntry& entry, const std::shared_ptr<PooledMessage>& message)
{
  if (!isNew(entry))
  {
    return;
  }
  if (!backlog_.empty() || !push(entry, *message))
  {
    backlog_.push_back(Kept{entry, message});
    backlog_bytes_ += message->length();
    const bool beyond_queue =
        max_queue_ > 0 && backlog_.size() > max_queue_ && ring->untakenBytes() + backlog_bytes_ > SOCKET_BYTES;
    if (beyond_queue || (backlog_.size() > 1 && backlog_bytes_ + backlog_.size() * KEPT_OVERHEAD > MAX_BACKLOG))
    {
      popKept();
      ++dropped_;
    }
    on_blocked();
  }
}

void IncomingLink::lose(const LinkEntry& entry)
{
  if (isNew(entry))
  {
    ++lost_;
  }
}

bool IncomingLink::flush()
{
  while (!backlog_.empty() && push(backlog_.front().entry, *backlog_.front().message))
  {
    popKept();
  }
  return backlog_.empty();
}

void IncomingLink::popKept()
{
  backlog_bytes_ -= backlog_.front().message->length();
  backlog_.pop_front();
}

bool IncomingStream::readEntries(const FrameHeader& header, PayloadReader* in, std::vector<LinkEntry>* entries) const
{
  const uint32_t count = header.count & ~COMPRESSED;
  if (count == 0 || size_t{count} * LinkEntry::BYTES > in->restLength())
  {
    return false;
  }
  entries->reserve(count);
  for (uint32_t index = 0; index < count; ++index)
  {
    entries->push_back(LinkEntry::read(in));
  }
  return true;
}

IncomingStream::ArrivalPtr IncomingStream::makeArrival(const FrameHeader& header, uint32_t length) const
{
  auto arrival = std::make_shared<Arrival>();
  arrival->length = length;
  arrival->compressed = (header.count & COMPRESSED) != 0;
  arrival->message = PooledMessage::make(pool_, length);
  return arrival;
}

bool IncomingStream::onMessage(const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  PayloadReader in(payload, length);
  std::vector<LinkEntry> entries;
  if (arriving_ || !readEntries(header, &in, &entries) || in.restLength() != header.offset)
  {
    return false;
  }
  const ArrivalPtr arrival = makeArrival(header, static_cast<uint32_t>(in.restLength()));
  arrival->entries = std::move(entries);
  if (arrival->message && arrival->length > 0)
  {
    std::memcpy(arrival->message->bytes(), in.rest(), arrival->length);
  }
  complete(arrival);
  return true;
}

bool IncomingStream::onBegin(const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  PayloadReader in(payload, length);
  std::vector<LinkEntry> entries;
  if (arriving_ || header.offset == 0 || header.offset > max_message_bytes_ || !readEntries(header, &in, &entries) ||
      in.restLength() != 0)
  {
    return false;
  }
  last_.reset();  // frees its memory for this message
  arriving_ = makeArrival(header, static_cast<uint32_t>(header.offset));
  arriving_->entries = std::move(entries);
  last_ = arriving_;
  return true;
}

bool IncomingStream::isNext(const FrameHeader& header, uint32_t length) const
{
  return arriving_ && length > 0 && header.offset == arriving_->received &&
         length <= arriving_->length - arriving_->received;
}

std::shared_ptr<uint8_t> IncomingStream::fragmentMemory(const FrameHeader& header, uint32_t length)
{
  if (!isNext(header, length))
  {
    return nullptr;
  }
  if (!arriving_->message)
  {
    return std::shared_ptr<uint8_t>(new uint8_t[length],
                                    std::default_delete<uint8_t[]>());  // no memory: the bytes are read and dropped
  }
  // Owned by the message: the arrival gets another message when the image is decompressed.
  return std::shared_ptr<uint8_t>(arriving_->message, arriving_->message->bytes() + arriving_->received);
}

bool IncomingStream::onFragment(const FrameHeader& header, uint32_t length)
{
  if (!isNext(header, length))
  {
    return false;
  }
  arriving_->received += length;
  if (arriving_->received == arriving_->length)
  {
    complete(std::exchange(arriving_, nullptr));
  }
  return true;
}

bool IncomingStream::onAttach(const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  PayloadReader in(payload, length);
  std::vector<LinkEntry> entries;
  if (!last_ || !readEntries(header, &in, &entries) || in.restLength() != 0)
  {
    return false;
  }
  if (last_->ready)
  {
    deliver(*last_, entries);
  }
  else
  {
    last_->entries.insert(last_->entries.end(), entries.begin(), entries.end());
  }
  return true;
}

void IncomingStream::interrupt()
{
  arriving_.reset();
  last_.reset();
}

void IncomingStream::complete(const ArrivalPtr& arrival)
{
  arrival->ready = !arrival->compressed || !arrival->message;
  last_ = arrival;
  undelivered_.push_back(arrival);
  deliverReady();
  decodeNext();
  if (undelivered_.size() > MAX_UNDECODED)
  {
    holdBack(true);
  }
}

/// Decompresses one image at a time and stream. Later ones wait in shared memory, and then at the peer.
void IncomingStream::decodeNext()
{
  while (!undelivered_.empty() && !decoding_)
  {
    const ArrivalPtr arrival = undelivered_.front();
    const auto done = [arrival](const std::shared_ptr<IncomingStream>& self, std::vector<uint8_t> bytes)
    {
      self->decoding_ = false;
      arrival->message =
          bytes.empty() ? nullptr : PooledMessage::make(self->pool_, static_cast<uint32_t>(bytes.size()));
      if (arrival->message)
      {
        std::memcpy(arrival->message->bytes(), bytes.data(), bytes.size());
      }
      arrival->ready = true;
      self->deliverReady();
      self->decodeNext();
      if (self->undelivered_.empty())
      {
        self->holdBack(false);
      }
    };
    decoding_ = true;
    if (!decompress_ || !decompress_(arrival->message->bytes(), arrival->length, ifAlive(weak_from_this(), done)))
    {
      decoding_ = false;
      arrival->message.reset();  // counts as lost
      arrival->ready = true;
      deliverReady();
    }
  }
}

void IncomingStream::holdBack(bool busy)
{
  if (busy)
  {
    for (const LinkEntry& entry : undelivered_.back()->entries)
    {
      const std::shared_ptr<IncomingLink> link = find_link_(entry.link);
      if (link && !std::exchange(link->decoder_busy, true))
      {
        held_back_.push_back(link);
        link->on_blocked();
      }
    }
    return;
  }
  for (const std::weak_ptr<IncomingLink>& held : std::exchange(held_back_, {}))
  {
    if (const std::shared_ptr<IncomingLink> link = held.lock())
    {
      link->decoder_busy = false;
      link->on_blocked();
    }
  }
}

void IncomingStream::deliverReady()
{
  while (!undelivered_.empty() && undelivered_.front()->ready)
  {
    const ArrivalPtr arrival = undelivered_.front();
    undelivered_.pop_front();
    deliver(*arrival, std::exchange(arrival->entries, {}));
  }
}

void IncomingStream::deliver(const Arrival& arrival, const std::vector<LinkEntry>& entries)
{
  for (const LinkEntry& entry : entries)
  {
    const std::shared_ptr<IncomingLink> link = find_link_(entry.link);
    if (!link)
    {
      continue;
    }
    if (arrival.message)
    {
      link->deliver(entry, arrival.message);
    }
    else
    {
      link->lose(entry);
    }
  }
}

}  // namespace pi_os_transport
