// Frames that carry messages from another device.

#include <map>
#include <memory>
#include <utility>

#include "bridge/incoming_stream.h"
#include "fuzz_input.h"
#include "shm/ring_pair.h"

namespace pi_os_transport
{
namespace
{

constexpr uint32_t MAX_MESSAGE = 1 << 20;

void fuzz(FuzzInput input)
{
  static SlotPool pool(8 << 20);
  const uint32_t live_before = pool.usage().live_slots;
  std::map<uint32_t, std::shared_ptr<IncomingLink>> links;
  std::map<uint32_t, std::unique_ptr<RingPair>> pairs;
  for (const uint32_t id : {0U, 1U})
  {
    pairs[id] = std::make_unique<RingPair>(&pool, 1 << 20);
    links[id] = std::make_shared<IncomingLink>(id, BridgeRequest(), nullptr);
    links[id]->ring = std::move(pairs[id]->sender);
    links[id]->state = IncomingLink::State::CARRYING;
    links[id]->on_blocked = [] {};
    links[id]->start(input.below(3), 0);
  }
  IncomingStream::Decompressed decompressed;
  auto stream = std::make_shared<IncomingStream>(
      &pool, MAX_MESSAGE,
      [&links](uint32_t id)
      {
        const auto found = links.find(id);
        return found != links.end() ? found->second : nullptr;
      },
      [&decompressed](const uint8_t*, size_t, IncomingStream::Decompressed done)
      {
        decompressed = std::move(done);
        return true;
      });
  while (!input.empty())
  {
    FrameHeader header;
    const uint32_t kind = input.below(8);
    header.count = input.below(4) | (input.below(8) == 0 ? COMPRESSED : 0) | (input.below(32) == 0 ? 0x40000000u : 0);
    header.offset = input.below(4) == 0 ? input.take<uint64_t>() : input.take<uint8_t>();
    const std::vector<uint8_t> bytes = input.bytes(input.below(80));
    const uint32_t length = static_cast<uint32_t>(bytes.size());
    const auto payload = std::make_unique<uint8_t[]>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), payload.get());
    switch (kind)
    {
      case 0:
      case 1:
        stream->onMessage(header, payload.get(), length);
        break;
      case 2:
        stream->onBegin(header, payload.get(), length);
        break;
      case 3:
      case 4:
        if (const std::shared_ptr<uint8_t> place = stream->fragmentMemory(header, length))
        {
          std::copy(bytes.begin(), bytes.end(), place.get());
        }
        stream->onFragment(header, length);
        break;
      case 5:
        stream->onAttach(header, payload.get(), length);
        break;
      case 6:
        if (const IncomingStream::Decompressed done = std::exchange(decompressed, nullptr))
        {
          done(bytes);
        }
        break;
      default:
        stream->interrupt();
        break;
    }
  }
  decompressed = nullptr;
  stream.reset();
  links.clear();
  require(pool.usage().live_slots == live_before, "every message is given back, and once");
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
