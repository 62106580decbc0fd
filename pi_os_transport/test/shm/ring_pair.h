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
#include "shm/pair_ends.h"
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
    : sender(std::make_unique<RingSender>(pool, lease_budget))
    , receiver(std::make_shared<RingReceiver>(ends.receiving, receiving_link))
  {
    std::string error;
    EXPECT_TRUE(ends.sending->addSender(receiver->number(), sending_link));
    EXPECT_TRUE(sender->open(ends.sending, receiver->number(), &error)) << error;
    EXPECT_TRUE(ends.receiving->receive());
    EXPECT_EQ(1U, receiving_link->packets.size());
    EXPECT_TRUE(receiver->onOffer(receiving_link->packets.back(), &receiving_link->last_descriptors));
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
    RingReceiver::Message message;
    if (receiver->take(0, true, &message) != RingReceiver::Take::TAKEN)
    {
      return std::nullopt;
    }
    Taken taken{message.descriptor, message.ticket, {}};
    if (message.descriptor.segment != Descriptor::LINK_START)
    {
      EXPECT_NE(nullptr, message.segment);
      taken.bytes.resize(message.descriptor.length);
      EXPECT_TRUE(taken.bytes.empty() ||
                  (message.segment &&
                   message.segment->copy(message.descriptor.offset, taken.bytes.data(), message.descriptor.length)));
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

  PairEnds ends;
  const std::shared_ptr<RecordingLink> receiving_link = std::make_shared<RecordingLink>();
  const std::shared_ptr<RecordingLink> sending_link = std::make_shared<RecordingLink>();
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
