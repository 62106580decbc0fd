// A hostile publisher: packets with descriptors on the connection of two processes, and the memory of the ring.

#include <memory>
#include <string>
#include <utility>

#include "fuzz_input.h"
#include "fuzz_peers.h"
#include "shm/pair_ends.h"
#include "shm/ring_receiver.h"

namespace pi_os_transport
{
namespace
{

constexpr uint32_t MOST_PACKETS = 12;

void fuzz(FuzzInput input)
{
  std::pair<SideChannel, SideChannel> channels = connectedChannels();
  TestHost host;
  std::string shortage;
  const std::shared_ptr<ProcessPair> pair = ProcessPair::make(std::move(channels.first), host.host, &shortage);
  require(pair != nullptr, "a pair");
  HostilePair publisher(std::move(channels.second));
  publisher.meet(&input);
  HostileSender sender;
  const auto link = std::make_shared<RecordingLink>();
  RingReceiver receiver(pair, link);
  receiver.sendHello(Token::random());
  for (uint32_t packets = input.below(MOST_PACKETS); packets > 0; --packets)
  {
    sender.send(&input, &publisher);
    publisher.ring(&input);
    if (!pair->receive())
    {
      pair->end();
    }
    if (!link->packets.empty() && link->packets.back().type == Packet::OFFER && !receiver.hasRing())
    {
      receiver.onOffer(link->packets.back(), &link->last_descriptors);
    }
  }
  if (!receiver.hasRing())
  {
    pair->end();
    return;
  }
  receiver.sendProof();
  RingLayout* const ring = sender.layout();
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
  RingReceiver::Message message;
  uint32_t taken = 0;
  while (taken <= RingLayout::CAPACITY && receiver.take(0, input.below(2) == 0, &message) == RingReceiver::Take::TAKEN)
  {
    ++taken;
    require(message.ticket < RingLayout::CAPACITY, "a ticket is one of the ring");
    if (message.segment)
    {
      // A place of exactly this size: the address sanitizer sees what is written beyond it.
      const auto copy = std::make_unique<uint8_t[]>(message.descriptor.length);
      message.segment->copy(message.descriptor.offset, copy.get(), message.descriptor.length);
    }
    receiver.release(message.ticket);
  }
  require(taken <= RingLayout::CAPACITY, "no more is taken than the ring holds");
  require(receiver.ring().available() <= RingLayout::CAPACITY, "no more waits than the ring holds");
  pair->end();
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
