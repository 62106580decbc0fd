#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "pi_os_transport/little_endian.h"
#include "shm/ring_receiver.h"
#include "shm/ring_sender.h"
#include "shm/side_channel.h"
#include "shm/slot_pool.h"

namespace pi_os_transport
{

/// Both ends of one link in shared memory.
struct RingPair
{
  explicit RingPair(SlotPool* pool, uint64_t lease_budget = 64 << 20)
    : sender(std::make_unique<RingSender>(pool, Token::random(), lease_budget))
  {
    const std::string name = "pi_os_test/" + Token::random().toString();
    SideChannel listener = SideChannel::listen(name);
    receiver = std::make_shared<RingReceiver>(SideChannel::connect(name));
    std::string error;
    EXPECT_TRUE(sender->open(listener.accept(), &error)) << error;
    receiver->readPackets();
    EXPECT_TRUE(receiver->hasRing());
  }

  struct Taken
  {
    Descriptor descriptor;
    uint32_t place;
    std::vector<uint8_t> bytes;
  };
  /// Takes the next message as a subscriber does, without releasing it.
  std::optional<Taken> take()
  {
    Taken taken;
    if (receiver->ring().take(0, true, &taken.descriptor, &taken.place) != RingConsumer::Take::TAKEN)
    {
      return std::nullopt;
    }
    if (taken.descriptor.segment != Descriptor::LINK_START)
    {
      const std::shared_ptr<MappedSegment> segment = receiver->find(taken.descriptor);
      EXPECT_NE(nullptr, segment);
      taken.bytes.resize(taken.descriptor.length);
      EXPECT_TRUE(taken.bytes.empty() ||
                  (segment && segment->copy(taken.descriptor.offset, taken.bytes.data(), taken.descriptor.length)));
    }
    return taken;
  }
  /// Takes and releases everything but the start. @return the messages.
  std::vector<std::vector<uint8_t>> takeMessages()
  {
    std::vector<std::vector<uint8_t>> messages;
    while (std::optional<Taken> taken = take())
    {
      receiver->release(taken->place);
      if (taken->descriptor.segment != Descriptor::LINK_START)
      {
        messages.push_back(std::move(taken->bytes));
      }
    }
    return messages;
  }

  std::unique_ptr<RingSender> sender;
  std::shared_ptr<RingReceiver> receiver;
};

/// Bytes that tell one message from every other one.
inline std::vector<uint8_t> patternOf(uint32_t seed, size_t length)
{
  std::vector<uint8_t> bytes(length);
  std::minstd_rand random(seed + 1);
  for (uint8_t& byte : bytes)
  {
    byte = static_cast<uint8_t>(random() >> 8);
  }
  return bytes;
}

/// A message in the pool, with one reference.
inline uint8_t* poolMessage(SlotPool* pool, const std::vector<uint8_t>& bytes)
{
  uint8_t* const buffer = pool->allocate(bytes.size() + LENGTH_PREFIX);
  EXPECT_NE(nullptr, buffer) << pool->lastError();
  storeLittleEndian<uint32_t>(buffer, static_cast<uint32_t>(bytes.size()));
  std::copy(bytes.begin(), bytes.end(), buffer + LENGTH_PREFIX);
  return buffer;
}

}  // namespace pi_os_transport
