// A hostile publisher: packets with descriptors on the side channel, and the memory of the ring.

#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <memory>

#include "fuzz_input.h"
#include "shm/ring_receiver.h"
#include "shm/shared_memory.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MOST_PACKETS = 12;

FileDescriptor memoryOf(size_t length, uint32_t seals)
{
  std::string error;
  FileDescriptor memory = makeSharedMemory("pi_os_fuzz", length, &error);
  if (seals != 0)
  {
    sealSharedMemory(memory.get(), seals == 2);
  }
  return memory;
}

void fuzz(FuzzInput input)
{
  int ends[2];
  require(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends) == 0, "socketpair");
  SideChannel publisher{FileDescriptor(ends[0])};
  RingReceiver receiver{SideChannel{FileDescriptor(ends[1])}};
  const FileDescriptor doorbell(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  FileDescriptor ring_memory = memoryOf(sizeof(RingLayout), 0);
  const SharedMapping mapping(ring_memory.get(), sizeof(RingLayout), true);
  auto* const ring = reinterpret_cast<RingLayout*>(mapping.data());
  require(ring != nullptr, "memory");
  RingProducer producer(ring, 42);
  sealSharedMemory(ring_memory.get(), false);

  for (uint32_t packets = input.below(MOST_PACKETS); packets > 0; --packets)
  {
    Packet packet;
    packet.type = input.below(10);
    packet.values[0] = input.below(4);
    packet.values[1] = input.below(2) == 0 ? 4096 : input.take<uint64_t>();
    switch (input.below(8))
    {
      case 0:
      {
        const std::vector<uint8_t> bytes = input.bytes(input.below(64));
        publisher.sendBytes(bytes.data(), bytes.size(), {doorbell.get()});
        break;
      }
      case 1:
        publisher.send(packet, {doorbell.get(), doorbell.get(), doorbell.get()});
        break;
      case 2:
        publisher.send(packet);
        break;
      case 3:
      {
        const FileDescriptor small = memoryOf(1 + input.below(200), input.below(3));
        publisher.send(packet, {small.get(), doorbell.get(), doorbell.get()});
        break;
      }
      case 4:
      case 5:
        packet.type = Packet::OFFER;
        publisher.send(packet, {ring_memory.get(), doorbell.get(), doorbell.get()});
        break;
      default:
      {
        packet.type = Packet::SEGMENT;
        const FileDescriptor segment = memoryOf(4096, input.below(3));
        publisher.send(packet, {segment.get()});
        break;
      }
    }
  }
  receiver.readPackets();
  if (!receiver.hasRing())
  {
    return;
  }
  receiver.sendProof();
  for (uint32_t stores = input.below(64); stores > 0; --stores)
  {
    const uint32_t place = input.below(RingLayout::CAPACITY / 16);
    switch (input.below(7))
    {
      case 0:
        ring->tail.store(input.take<uint32_t>());
        break;
      case 1:
        ring->head.store(input.take<uint32_t>());
        break;
      case 2:
        ring->armed.store(input.take<uint32_t>());
        break;
      case 3:
        ring->tail.store(ring->tail.load() + 1);
        break;
      default:
        ring->entries[place].segment_length.store(uint64_t{input.below(4)} << 32 | input.take<uint32_t>());
        ring->entries[place].offset_after.store(uint64_t{input.take<uint32_t>()} << 32 | input.below(4));
        ring->tail.store(ring->tail.load() + 1);
        break;
    }
  }
  Descriptor descriptor;
  uint32_t place = 0;
  uint32_t taken = 0;
  while (taken <= RingLayout::CAPACITY &&
         receiver.ring().take(0, input.below(2) == 0, &descriptor, &place) == RingConsumer::Take::TAKEN)
  {
    ++taken;
    require(place < RingLayout::CAPACITY, "a place is one of the ring");
    if (const std::shared_ptr<MappedSegment> segment = receiver.find(descriptor))
    {
      // A place of exactly this size: the address sanitizer sees what is written beyond it.
      const auto copy = std::make_unique<uint8_t[]>(descriptor.length);
      segment->copy(descriptor.offset, copy.get(), descriptor.length);
    }
    receiver.release(place);
  }
  require(taken <= RingLayout::CAPACITY, "no more is taken than the ring holds");
  require(receiver.ring().available() <= RingLayout::CAPACITY, "no more waits than the ring holds");
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
