// A hostile subscriber: what it writes into the ring while the publisher goes on.

#include <map>
#include <memory>
#include <string>

#include "fuzz_input.h"
#include "pi_os_transport/little_endian.h"
#include "shm/pair_ends.h"
#include "shm/ring_sender.h"
#include "shm/shared_memory.h"
#include "shm/slot_pool.h"

namespace pi_os_transport
{
namespace
{

void fuzz(FuzzInput input)
{
  static SlotPool pool(16 << 20);
  const uint32_t live_before = pool.usage().live_slots;
  PairEnds ends;
  const auto link = std::make_shared<RecordingLink>();
  RingSender sender(&pool, 1 << 20);
  std::string error;
  require(sender.open(ends.sending, ends.receiving->addReceiver(link), &error), "open");
  require(ends.receiving->receive() && link->packets.size() == 1, "offer");
  const Packet packet = link->packets.front();
  const SharedMapping mapping(link->last_descriptors[0].get(), sizeof(RingLayout), true);
  auto* const ring = reinterpret_cast<RingLayout*>(mapping.data());
  RingConsumer honest(ring);

  std::map<const uint8_t*, uint32_t> mine;  // taken back, with a reference each; and the number of the message in it
  const auto numberOf = [](const uint8_t* buffer) { return loadLittleEndian<uint32_t>(buffer + LENGTH_PREFIX); };
  const auto keep = [&mine, &numberOf](const RingSender::Message& message)
  {
    if (message.buffer != nullptr)
    {
      require(mine.emplace(message.buffer, numberOf(message.buffer)).second, "a message is taken back once");
    }
  };
  for (uint32_t step = 0; step < 2000 && !input.empty(); ++step)
  {
    switch (input.below(16))
    {
      case 0:
        ring->head.store(input.take<uint32_t>());
        break;
      case 1:
        ring->head.store(ring->head.load() + input.below(3) - 1);
        break;
      case 2:
        ring->tail.store(input.take<uint32_t>());
        break;
      case 3:
        ring->armed.store(input.take<uint32_t>());
        break;
      case 4:
        ring->released[input.below(RingLayout::CAPACITY - 1)].store(1);
        ring->release_count.fetch_add(1);
        break;
      case 5:
      case 6:
      {
        Descriptor descriptor;
        uint32_t place = 0;
        if (honest.take(0, true, &descriptor, &place) == RingConsumer::Take::TAKEN && input.below(2) == 0)
        {
          honest.release(place);
        }
        break;
      }
      case 7:
        sender.collect();
        break;
      case 8:
        for (const RingSender::Message& message : sender.takeBack())
        {
          keep(message);
        }
        break;
      case 9:
        for (const RingSender::Message& message : sender.takeBackTaken())
        {
          keep(message);
        }
        break;
      case 10:
        sender.pushStart(input.below(4), input.below(2) == 1, 0);
        break;
      case 11:
        sender.isProof(packet);
        sender.untaken();
        sender.idle();
        break;
      default:
      {
        const uint32_t length = input.below(2) == 0 ? 64 : 300000;
        uint8_t* const buffer = pool.allocate(length + LENGTH_PREFIX);
        require(mine.count(buffer) == 0, "nobody gets memory that somebody else holds");
        if (buffer != nullptr)
        {
          storeLittleEndian<uint32_t>(buffer + LENGTH_PREFIX, step);
        }
        if (buffer != nullptr && sender.push(buffer, length, input.below(3), 0, step) != RingSender::Push::WRITTEN)
        {
          pool.release(buffer);
        }
        break;
      }
    }
  }
  sender.close();
  for (const auto& [buffer, number] : mine)
  {
    require(numberOf(buffer) == number, "nobody writes to memory that somebody else holds");
    pool.release(buffer);
  }
  require(pool.usage().live_slots == live_before, "every message is given back, and once");
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
