#pragma once

// What hostile peers of a link in shared memory can do.

#include <sys/eventfd.h>
#include <unistd.h>

#include <array>
#include <string>
#include <vector>

#include "fuzz_input.h"
#include "shm/descriptor_ring.h"
#include "shm/file_descriptor.h"
#include "shm/shared_memory.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

using Descriptors = std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS>;

/// A hostile peer as the sender of messages: what it may hand over, and write into the ring that it has handed over.
class HostileSender
{
public:
  HostileSender()
    : doorbell_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK))
    , ring_memory_(memoryOf(sizeof(RingLayout), 0))
    , mapping_(ring_memory_.get(), sizeof(RingLayout), true)
    , ring_(reinterpret_cast<RingLayout*>(mapping_.data()))
  {
    require(ring_ != nullptr, "memory");
    RingProducer(ring_, 42);
    sealSharedMemory(ring_memory_.get(), false);
  }

  /// Sends a packet of any kind, often one that makes sense, unless the channel is closed.
  void send(FuzzInput* input, SideChannel* channel)
  {
    if (!*channel)
    {
      return;
    }
    Packet packet;
    packet.type = input->below(12);
    packet.values[0] = input->below(4);
    packet.values[1] = input->below(4) != 0 ? SEGMENT_BYTES : input->take<uint64_t>();
    packet.values[2] = input->below(2) == 0 ? 1 << 20 : input->take<uint64_t>();
    switch (input->below(8))
    {
      case 0:
      {
        const std::vector<uint8_t> bytes = input->bytes(input->below(64));
        channel->sendBytes(bytes.data(), bytes.size(), {doorbell_.get()});
        break;
      }
      case 1:
        channel->send(packet, {doorbell_.get(), doorbell_.get(), doorbell_.get()});
        break;
      case 2:
        channel->send(packet);
        break;
      case 3:
        packet.type = Packet::OFFER;
        channel->send(packet, {ring_memory_.get(), doorbell_.get(), doorbell_.get()});
        break;
      case 4:
        packet.type = Packet::OFFER;  // with doorbells that nobody can wait for
        channel->send(packet, {ring_memory_.get(), ring_memory_.get(), ring_memory_.get()});
        break;
      default:
      {
        packet.type = Packet::SEGMENT;
        const FileDescriptor segment = memoryOf(SEGMENT_BYTES, input->below(4) == 0 ? input->below(3) : 2);
        channel->send(packet, {segment.get()});
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
  void ring() const
  {
    const uint64_t one = 1;
    static_cast<void>(!::write(doorbell_.get(), &one, sizeof(one)));
  }

  static FileDescriptor memoryOf(size_t length, uint32_t seals)
  {
    std::string error;
    FileDescriptor memory = makeSharedMemory("pi_os_fuzz", length, &error);
    if (seals != 0)
    {
      sealSharedMemory(memory.get(), seals == 2);
    }
    return memory;
  }

private:
  static constexpr size_t SEGMENT_BYTES = 4096;

  FileDescriptor doorbell_;
  FileDescriptor ring_memory_;
  SharedMapping mapping_;
  RingLayout* ring_;
};

/// A hostile peer as the receiver of messages: it maps the ring that it is offered, and writes there what it wants.
class HostileReceiver
{
public:
  /// Reads one packet, if there is one; closes the channel at its end.
  void receive(SideChannel* channel)
  {
    if (!*channel)
    {
      return;
    }
    Packet packet;
    Descriptors descriptors;
    switch (channel->receive(&packet, &descriptors))
    {
      case SideChannel::Receive::PACKET:
        if (packet.type == Packet::OFFER && ring_ == nullptr && descriptors[0])
        {
          mapping_ = SharedMapping(descriptors[0].get(), sizeof(RingLayout), true);
          ring_ = reinterpret_cast<RingLayout*>(mapping_.data());
        }
        break;
      case SideChannel::Receive::NOTHING:
        break;
      default:
        channel->close();
        break;
    }
  }

  /// Sends a packet of any kind, often the proof, unless the channel is closed.
  void send(FuzzInput* input, SideChannel* channel)
  {
    if (!*channel)
    {
      return;
    }
    Packet packet;
    packet.type = input->below(2) == 0 ? uint32_t{Packet::PROOF} : input->below(12);
    packet.values[0] = ring_ != nullptr && input->below(4) != 0 ? ring_->nonce : input->take<uint64_t>();
    if (input->below(12) == 0)
    {
      const std::vector<uint8_t> bytes = input->bytes(input->below(64));
      channel->sendBytes(bytes.data(), bytes.size());
      return;
    }
    channel->send(packet);
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
