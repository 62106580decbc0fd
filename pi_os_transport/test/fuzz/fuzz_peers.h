#pragma once

// What hostile peers of a link in shared memory can do.

#include <unistd.h>

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "fuzz_input.h"
#include "shm/descriptor_ring.h"
#include "shm/file_descriptor.h"
#include "shm/shared_memory.h"
#include "shm/side_channel.h"
#include "shm/wake_board.h"

namespace pi_os_transport
{

using Descriptors = std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS>;

inline FileDescriptor memoryOf(size_t length, uint32_t seals)
{
  std::string error;
  FileDescriptor memory = makeSharedMemory("pi_os_fuzz", length, &error);
  if (seals != 0)
  {
    sealSharedMemory(memory.get(), seals == 2);
  }
  return memory;
}

/// What a hostile process has of its connection to an honest one.
class HostilePair
{
public:
  HostilePair() = default;
  explicit HostilePair(SideChannel connected) : channel(std::move(connected)) {}

  /// Introduces itself, most of the time as is right.
  void meet(FuzzInput* input)
  {
    const FileDescriptor news = memoryOf(sizeof(NewsLayout), 0);
    reinterpret_cast<NewsLayout*>(SharedMapping(news.get(), sizeof(NewsLayout), true).data())->magic =
        input->below(16) != 0 ? NewsLayout::MAGIC : 0;
    sealSharedMemory(news.get(), input->below(16) != 0 ? 1 : 0);
    const FileDescriptor wake = memoryOf(sizeof(WakeLayout), 1);
    channel.send(Packet::of(Packet::MEET, 0, 1, 2), {news.get(), wake.get()});
  }
  /// Reads what has come. Closes at the end of the channel.
  void receive()
  {
    for (;;)
    {
      Packet packet;
      Descriptors descriptors;
      const SideChannel::Receive result =
          channel ? channel.receive(&packet, &descriptors) : SideChannel::Receive::NOTHING;
      if (result == SideChannel::Receive::NOTHING)
      {
        return;
      }
      if (result != SideChannel::Receive::PACKET)
      {
        channel.close();
        return;
      }
      if (packet.type == Packet::MEET)
      {
        news_memory_ = SharedMapping(descriptors[0].get(), sizeof(NewsLayout), true);
      }
      else if (packet.type == Packet::HELLO)
      {
        asked = packet.link;
        asked_token = Token{packet.values[0], packet.values[1]};
      }
      else if (packet.type == Packet::OFFER && descriptors[0])
      {
        offered = packet.link;
        ring_memory = std::move(descriptors[0]);
      }
    }
  }
  /// Says that there is news, in any links.
  void ring(FuzzInput* input)
  {
    auto* const news = reinterpret_cast<NewsLayout*>(news_memory_.data());
    if (news == nullptr || !channel)
    {
      return;
    }
    const uint32_t place = input->below(4) != 0 ? asked : input->take<uint32_t>();
    NewsBoard(news).add(place % NewsLayout::LINKS);
    if (input->below(8) == 0)
    {
      news->summary.store(input->take<uint64_t>());
    }
    channel.send(Packet::of(Packet::BELL, 0));
  }
  uint32_t someLink(FuzzInput* input, uint32_t usual) const
  {
    return input->below(16) != 0 ? usual : input->take<uint32_t>();
  }

  SideChannel channel;
  uint32_t asked = 0;  ///< link for which the honest process wants a ring
  Token asked_token;
  uint32_t offered = 0;  ///< link for which it offers one
  FileDescriptor ring_memory;

private:
  SharedMapping news_memory_;
};

/// A hostile peer as the sender of messages: what it may hand over, and write into the ring that it has handed over.
class HostileSender
{
public:
  HostileSender()
    : ring_memory_(memoryOf(sizeof(RingLayout), 0))
    , mapping_(ring_memory_.get(), sizeof(RingLayout), true)
    , ring_(reinterpret_cast<RingLayout*>(mapping_.data()))
  {
    require(ring_ != nullptr, "memory");
    RingProducer(ring_, 42);
    sealSharedMemory(ring_memory_.get(), false);
  }

  /// Sends a packet of any kind, often one that makes sense, unless the channel is closed.
  void send(FuzzInput* input, HostilePair* pair)
  {
    pair->receive();
    if (!pair->channel)
    {
      return;
    }
    Packet packet;
    packet.type = input->below(15);
    packet.link = pair->someLink(input, pair->asked);
    packet.values[0] = input->below(4);
    packet.values[1] = input->below(4) != 0 ? SEGMENT_BYTES : input->take<uint64_t>();
    packet.values[2] = input->below(2) == 0 ? 1 << 20 : input->take<uint64_t>();
    const int ring = ring_memory_.get();
    switch (input->below(8))
    {
      case 0:
      {
        const std::vector<uint8_t> bytes = input->bytes(input->below(64));
        pair->channel.sendBytes(bytes.data(), bytes.size(), {ring});
        break;
      }
      case 1:
        pair->channel.send(packet, {ring, ring, ring});
        break;
      case 2:
        pair->channel.send(packet);
        break;
      case 3:
      case 4:
        packet.type = Packet::OFFER;
        packet.values[0] = input->below(2) == 0 ? 1 << 20 : input->take<uint64_t>();
        pair->channel.send(packet, {ring});
        break;
      default:
      {
        packet.type = Packet::SEGMENT;
        const FileDescriptor segment = memoryOf(SEGMENT_BYTES, input->below(4) == 0 ? input->below(3) : 2);
        pair->channel.send(packet, {segment.get()});
        break;
      }
    }
  }

  /// Writes into the ring. @param serial  what the receiver may be waiting for.
  void write(FuzzInput* input, uint64_t serial)
  {
    switch (input->below(10))
    {
      case 0:
        ring_->tail.store(input->take<uint32_t>());
        break;
      case 1:
        ring_->head.store(input->take<uint32_t>());
        break;
      case 2:
        ring_->armed.store(input->take<uint32_t>());
        break;
      case 3:
        ring_->tail.store(ring_->tail.load() + 1);
        break;
      default:
      {
        RingLayout::Entry& entry = ring_->entries[ring_->tail.load() % RingLayout::CAPACITY];
        const bool fits = input->below(4) != 0;
        const uint64_t length = fits ? input->below(200) : input->take<uint32_t>();
        const uint64_t offset = fits ? input->below(200) : input->take<uint32_t>();
        const uint64_t segment = input->below(4);
        const uint64_t ticket = input->below(255);
        const uint64_t number = input->below(4) != 0 ? serial : input->take<uint64_t>();
        entry.segment_length.store(segment << 32 | length);
        entry.offset_after.store(offset << 32 | input->below(3));
        entry.serial_ticket.store(number << 8 | ticket);
        entry.stamp_ns.store(input->take<uint32_t>());
        ring_->tail.store(ring_->tail.load() + 1);
        break;
      }
    }
  }
  RingLayout* layout() { return ring_; }

private:
  static constexpr size_t SEGMENT_BYTES = 4096;

  FileDescriptor ring_memory_;
  SharedMapping mapping_;
  RingLayout* ring_;
};

/// A hostile peer as the receiver of messages: it maps the ring that it is offered, and writes there what it wants.
class HostileReceiver
{
public:
  /// Reads what has come, and maps the ring that was offered.
  void receive(HostilePair* pair)
  {
    pair->receive();
    if (ring_ == nullptr && pair->ring_memory)
    {
      mapping_ = SharedMapping(pair->ring_memory.get(), sizeof(RingLayout), true);
      ring_ = reinterpret_cast<RingLayout*>(mapping_.data());
    }
  }

  /// Sends a packet of any kind, often the proof, unless the channel is closed.
  void send(FuzzInput* input, HostilePair* pair)
  {
    if (!pair->channel)
    {
      return;
    }
    Packet packet;
    packet.type = input->below(2) == 0 ? uint32_t{Packet::PROOF} : input->below(15);
    packet.link = pair->someLink(input, pair->offered | Packet::TO_SENDER);
    packet.values[0] = ring_ != nullptr && input->below(4) != 0 ? ring_->nonce : input->take<uint64_t>();
    if (input->below(12) == 0)
    {
      const std::vector<uint8_t> bytes = input->bytes(input->below(64));
      pair->channel.sendBytes(bytes.data(), bytes.size());
      return;
    }
    pair->channel.send(packet);
  }

  void write(FuzzInput* input)
  {
    if (ring_ == nullptr)
    {
      return;
    }
    switch (input->below(6))
    {
      case 0:
        ring_->head.store(input->take<uint32_t>());
        break;
      case 1:
        ring_->tail.store(input->take<uint32_t>());
        break;
      case 2:
        ring_->armed.store(input->take<uint32_t>());
        break;
      case 3:
        ring_->released[input->below(RingLayout::CAPACITY - 1)].store(1);
        ring_->release_count.fetch_add(1);
        break;
      default:
      {
        RingConsumer honest(ring_);
        Descriptor descriptor;
        uint32_t ticket = 0;
        if (honest.take(0, true, &descriptor, &ticket) == RingConsumer::Take::TAKEN && input->below(2) == 0)
        {
          honest.release(ticket);
        }
        break;
      }
    }
  }

private:
  SharedMapping mapping_;
  RingLayout* ring_ = nullptr;
};

}  // namespace pi_os_transport
