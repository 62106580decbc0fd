// Everything that two processes of different builds share, byte by byte. Whoever changes one of these raises
// PROTOCOL_VERSION and pins anew: with the old number two builds would take each other's memory for their own.

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <type_traits>
#include <vector>

#include "shm/descriptor_ring.h"
#include "shm/ring_sender.h"
#include "shm/side_channel.h"
#include "shm/wake_board.h"

namespace pi_os_transport
{
namespace
{

constexpr uint32_t PINNED_VERSION = 4;

template <typename Object>
std::vector<uint8_t> bytesOf(const Object& object, size_t offset, size_t count)
{
  std::vector<uint8_t> bytes(count);
  std::memcpy(bytes.data(), reinterpret_cast<const uint8_t*>(&object) + offset, count);
  return bytes;
}

TEST(SharedLayout, IsPinnedForThisVersion)
{
  ASSERT_EQ(PINNED_VERSION, PROTOCOL_VERSION) << "pin the layout of the new version in this file";
}

TEST(SharedLayout, RingHasItsFieldsInPlace)
{
  EXPECT_TRUE(std::is_standard_layout_v<RingLayout>);
  EXPECT_EQ(256U, RingLayout::CAPACITY);
  EXPECT_EQ(0x34676e69724f5350U, RingLayout::MAGIC);
  EXPECT_EQ(0U, offsetof(RingLayout, magic));
  EXPECT_EQ(8U, offsetof(RingLayout, nonce));
  EXPECT_EQ(64U, offsetof(RingLayout, tail));
  EXPECT_EQ(128U, offsetof(RingLayout, head));
  EXPECT_EQ(132U, offsetof(RingLayout, armed));
  EXPECT_EQ(192U, offsetof(RingLayout, release_count));
  EXPECT_EQ(256U, offsetof(RingLayout, released));
  EXPECT_EQ(512U, offsetof(RingLayout, entries));
  EXPECT_EQ(32U, sizeof(RingLayout::Entry));
  EXPECT_EQ(8704U, sizeof(RingLayout));
  EXPECT_EQ(64U, alignof(RingLayout));
}

TEST(SharedLayout, DescriptorsHaveTheirBits)
{
  auto layout = std::make_unique<RingLayout>();
  RingProducer producer(layout.get(), 0x1122334455667788);
  Descriptor descriptor;
  descriptor.segment = 0x01020304;
  descriptor.length = 0x05060708;
  descriptor.offset = uint64_t{4} * 0x090a0b0c + 2;
  descriptor.after_tcp = 0x0d0e0f10;
  descriptor.serial = 0x11121314151617;
  descriptor.stamp_ns = 0x191a1b1c1d1e1f20;
  uint32_t doorbell = 0;
  producer.push(descriptor, &doorbell);
  // On little-endian machines, the only ones that both ends can run on: they are one machine.
  EXPECT_EQ((std::vector<uint8_t>{0x50, 0x53, 0x4f, 0x72, 0x69, 0x6e, 0x67, 0x34, 0x88, 0x77, 0x66, 0x55, 0x44, 0x33,
                                  0x22, 0x11}),
            bytesOf(*layout, 0, 16));
  EXPECT_EQ((std::vector<uint8_t>{0x08, 0x07, 0x06, 0x85, 0x04, 0x03, 0x02, 0x01, 0x10, 0x0f, 0x0e,
                                  0x0d, 0x0c, 0x0b, 0x0a, 0x09, 0x00, 0x17, 0x16, 0x15, 0x14, 0x13,
                                  0x12, 0x11, 0x20, 0x1f, 0x1e, 0x1d, 0x1c, 0x1b, 0x1a, 0x19}),
            bytesOf(*layout, offsetof(RingLayout, entries), 32));
  EXPECT_EQ((std::vector<uint8_t>{1, 0, 0, 0}), bytesOf(*layout, offsetof(RingLayout, tail), 4));
  EXPECT_EQ(0U, Descriptor::LINK_START);
}

TEST(SharedLayout, PacketsHaveTheirFieldsInPlace)
{
  EXPECT_TRUE(std::is_trivially_copyable_v<Packet>);
  EXPECT_EQ(0U, offsetof(Packet, version));
  EXPECT_EQ(4U, offsetof(Packet, type));
  EXPECT_EQ(8U, offsetof(Packet, link));
  EXPECT_EQ(16U, offsetof(Packet, values));
  EXPECT_EQ(40U, sizeof(Packet));
  EXPECT_EQ(0x80000000U, uint32_t{Packet::TO_SENDER});
  const std::vector<uint32_t> types{Packet::HELLO, Packet::OFFER,   Packet::PROOF,   Packet::SEGMENT, Packet::RETIRED,
                                    Packet::ENDED, Packet::WAITING, Packet::SPACE,   Packet::QUERY,   Packet::STATE,
                                    Packet::MEET,  Packet::BELL,    Packet::DECLINED};
  EXPECT_EQ((std::vector<uint32_t>{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13}), types);
  EXPECT_EQ(3U, SideChannel::MAX_DESCRIPTORS);
  EXPECT_EQ(3U, static_cast<uint32_t>(LinkEnd::BACK_TO_TCP));
}

TEST(SharedLayout, BoardsHaveTheirFieldsInPlace)
{
  EXPECT_EQ(4096U, NewsLayout::LINKS);
  EXPECT_EQ(0x347377656e4f5350U, NewsLayout::MAGIC);
  EXPECT_EQ(0U, offsetof(NewsLayout, magic));
  EXPECT_EQ(64U, offsetof(NewsLayout, summary));
  EXPECT_EQ(128U, offsetof(NewsLayout, links));
  EXPECT_EQ(640U, sizeof(NewsLayout));
  EXPECT_EQ(63U, WakeLayout::SLEEPERS);
  EXPECT_EQ(0x34656b61774f5350U, WakeLayout::MAGIC);
  EXPECT_EQ(0U, offsetof(WakeLayout, magic));
  EXPECT_EQ(64U, offsetof(WakeLayout, sleepers));
  EXPECT_EQ(0U, offsetof(WakeLayout::Sleeper, asleep));
  EXPECT_EQ(4U, offsetof(WakeLayout::Sleeper, bell));
  EXPECT_EQ(64U, sizeof(WakeLayout::Sleeper));
  EXPECT_EQ(4096U, sizeof(WakeLayout));
}

TEST(SharedLayout, DoorbellsAndPrefixAreNumbered)
{
  EXPECT_EQ(1U, static_cast<uint32_t>(NETWORK_THREAD));
  EXPECT_EQ(2U, static_cast<uint32_t>(WAITING_THREAD));
  EXPECT_EQ(3U, static_cast<uint32_t>(FIRST_SPINNER));
  EXPECT_EQ(4U, LENGTH_PREFIX);
}

}  // namespace
}  // namespace pi_os_transport
