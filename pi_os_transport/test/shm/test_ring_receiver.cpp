#include "shm/ring_receiver.h"

#include <gtest/gtest.h>
#include <sys/eventfd.h>

#include <array>
#include <cstring>
#include <memory>
#include <string>

#include "shm/ring_pair.h"
#include "shm/shared_memory.h"

namespace pi_os_transport
{
namespace
{

/// A publisher that says to a subscriber what it likes.
class HostilePublisher
{
public:
  explicit HostilePublisher(const Token& pool) : pool_(pool)
  {
    const std::string name = "pi_os_test/" + Token::random().toString();
    SideChannel listener = SideChannel::listen(name);
    receiver = std::make_unique<RingReceiver>(SideChannel::connect(name));
    channel = listener.accept();
  }

  /// @return the descriptor of memory of `length` bytes that are all `content`.
  static FileDescriptor memory(uint64_t length, uint8_t content, bool sealed = true)
  {
    std::string error;
    FileDescriptor made = makeSharedMemory("pi_os_test", length, &error);
    EXPECT_TRUE(made) << error;
    std::memset(SharedMapping(made.get(), length, true).data(), content, length);
    if (sealed)
    {
      sealSharedMemory(made.get(), true);
    }
    return made;
  }

  void offer()
  {
    FileDescriptor ring = memory(sizeof(RingLayout), 0, false);
    const SharedMapping mapping(ring.get(), sizeof(RingLayout), true);
    RingProducer producer(reinterpret_cast<RingLayout*>(mapping.data()), 42);
    sealSharedMemory(ring.get(), false);
    offerMemory(ring.get());
  }

  void offerMemory(int ring)
  {
    const FileDescriptor doorbell(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
    Packet packet;
    packet.type = Packet::OFFER;
    packet.values = {pool_.high, pool_.low, 1 << 20};
    ASSERT_TRUE(channel.send(packet, {ring, doorbell.get(), doorbell.get()}));
    receiver->readPackets();
  }

  void segment(uint32_t id, const FileDescriptor& memory, uint64_t length)
  {
    Packet packet;
    packet.type = Packet::SEGMENT;
    packet.values = {id, length, 0};
    ASSERT_TRUE(channel.send(packet, {memory.get()}));
    receiver->readPackets();
  }

  std::unique_ptr<RingReceiver> receiver;
  SideChannel channel;

private:
  const Token pool_;
};

Descriptor descriptorOf(uint32_t segment, uint64_t offset, uint32_t length)
{
  Descriptor descriptor;
  descriptor.segment = segment;
  descriptor.offset = offset;
  descriptor.length = length;
  return descriptor;
}

TEST(RingReceiver, RefusesMemoryThatIsUnsealedTooSmallOrNoRing)
{
  HostilePublisher publisher(Token::random());
  publisher.offerMemory(HostilePublisher::memory(sizeof(RingLayout), 0, false).get());
  publisher.offerMemory(HostilePublisher::memory(sizeof(RingLayout) - 1, 0).get());
  publisher.offerMemory(HostilePublisher::memory(sizeof(RingLayout), 0).get());
  EXPECT_FALSE(publisher.receiver->hasRing());
  publisher.offer();
  EXPECT_TRUE(publisher.receiver->hasRing());
}

TEST(RingReceiver, FindsNothingOutsideOfASegment)
{
  HostilePublisher publisher(Token::random());
  publisher.offer();
  publisher.segment(1, HostilePublisher::memory(4096, 7), 4096);
  EXPECT_NE(nullptr, publisher.receiver->find(descriptorOf(1, 4, 4092)));
  EXPECT_EQ(nullptr, publisher.receiver->find(descriptorOf(1, 4, 4093)));
  EXPECT_EQ(nullptr, publisher.receiver->find(descriptorOf(1, 4100, 0)));
  EXPECT_EQ(nullptr, publisher.receiver->find(descriptorOf(1, (uint64_t{1} << 34) - 4, 0xffffffff)));
  EXPECT_EQ(nullptr, publisher.receiver->find(descriptorOf(2, 0, 1)));
}

TEST(RingReceiver, KnowsASegmentByItsMemoryNotByWhatAPeerSaysOfIt)
{
  // Both claim to be the same pool: the second one must not get its messages read from the memory of the first one.
  const Token pool = Token::random();
  HostilePublisher foreign(pool);
  HostilePublisher genuine(pool);
  foreign.offer();
  genuine.offer();
  foreign.segment(1, HostilePublisher::memory(4096, 6), 4096);
  genuine.segment(1, HostilePublisher::memory(4096, 7), 4096);
  const std::shared_ptr<MappedSegment> segment = genuine.receiver->find(descriptorOf(1, 0, 1));
  ASSERT_NE(nullptr, segment);
  EXPECT_EQ(7, *segment->data());
}

TEST(RingReceiver, MapsASegmentOfTwoLinksOnce)
{
  const FileDescriptor memory = HostilePublisher::memory(4096, 7);
  HostilePublisher first(Token::random());
  HostilePublisher second(Token::random());
  first.offer();
  second.offer();
  first.segment(1, memory, 4096);
  second.segment(1, memory, 4096);
  EXPECT_EQ(first.receiver->find(descriptorOf(1, 0, 1)), second.receiver->find(descriptorOf(1, 0, 1)));
}

TEST(RingReceiver, TrustsNoLengthBeyondTheMemory)
{
  HostilePublisher publisher(Token::random());
  publisher.offer();
  publisher.segment(1, HostilePublisher::memory(4096, 7), 1 << 30);
  EXPECT_EQ(nullptr, publisher.receiver->find(descriptorOf(1, 0, 1)));
}

}  // namespace
}  // namespace pi_os_transport
