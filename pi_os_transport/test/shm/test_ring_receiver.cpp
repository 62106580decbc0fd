#include "shm/ring_receiver.h"

#include <gtest/gtest.h>

#include <cstring>
#include <memory>
#include <string>
#include <utility>

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
  HostilePublisher() : receiver(std::make_unique<RingReceiver>(ends.receiving, link)) {}

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

  bool offer()
  {
    FileDescriptor ring = memory(sizeof(RingLayout), 0, false);
    const SharedMapping mapping(ring.get(), sizeof(RingLayout), true);
    RingProducer(reinterpret_cast<RingLayout*>(mapping.data()), 42);
    sealSharedMemory(ring.get(), false);
    return offerMemory(std::move(ring));
  }

  bool offerMemory(FileDescriptor ring)
  {
    EXPECT_TRUE(ends.sending->send(Packet::of(Packet::OFFER, receiver->number(), 1 << 20), std::move(ring)));
    EXPECT_TRUE(ends.receiving->receive());
    return receiver->onOffer(link->packets.back(), &link->last_descriptors);
  }

  void segment(uint32_t id, FileDescriptor memory, uint64_t length)
  {
    ASSERT_TRUE(ends.sending->send(Packet::of(Packet::SEGMENT, 0, id, length), std::move(memory)));
    ASSERT_TRUE(ends.receiving->receive());
  }

  RingReceiver::Take find(uint32_t segment, uint64_t offset, uint32_t length)
  {
    Descriptor descriptor;
    descriptor.segment = segment;
    descriptor.offset = offset;
    descriptor.length = length;
    found.reset();
    return receiver->find(descriptor, &found);
  }

  PairEnds ends;
  const std::shared_ptr<RecordingLink> link = std::make_shared<RecordingLink>();
  std::unique_ptr<RingReceiver> receiver;
  std::shared_ptr<MappedSegment> found;
};

using Take = RingReceiver::Take;

TEST(RingReceiver, RefusesMemoryThatIsUnsealedTooSmallOrNoRing)
{
  HostilePublisher publisher;
  EXPECT_FALSE(publisher.offerMemory(HostilePublisher::memory(sizeof(RingLayout), 0, false)));
  EXPECT_FALSE(publisher.offerMemory(HostilePublisher::memory(sizeof(RingLayout) - 1, 0)));
  EXPECT_FALSE(publisher.offerMemory(HostilePublisher::memory(sizeof(RingLayout), 0)));
  EXPECT_FALSE(publisher.receiver->hasRing());
  EXPECT_TRUE(publisher.offer());
  EXPECT_TRUE(publisher.receiver->hasRing());
}

TEST(RingReceiver, FindsNothingOutsideOfASegment)
{
  HostilePublisher publisher;
  publisher.segment(1, HostilePublisher::memory(4096, 7), 4096);
  EXPECT_EQ(Take::TAKEN, publisher.find(1, 4, 4092));
  EXPECT_NE(nullptr, publisher.found);
  EXPECT_EQ(Take::TAKEN, publisher.find(1, 4, 4093));
  EXPECT_EQ(nullptr, publisher.found);
  publisher.find(1, 4100, 0);
  EXPECT_EQ(nullptr, publisher.found);
  publisher.find(1, (uint64_t{1} << 34) - 4, 0xffffffff);
  EXPECT_EQ(nullptr, publisher.found);
}

TEST(RingReceiver, WaitsForASegmentAndIsServedWhenItComes)
{
  HostilePublisher publisher;
  EXPECT_EQ(Take::WAITING, publisher.find(2, 0, 1));
  EXPECT_EQ(0, publisher.link->served);
  publisher.segment(2, HostilePublisher::memory(4096, 7), 4096);
  EXPECT_EQ(1, publisher.link->served);
  EXPECT_EQ(Take::TAKEN, publisher.find(2, 0, 1));
  ASSERT_NE(nullptr, publisher.found);
  EXPECT_EQ(7, *publisher.found->data());
}

TEST(RingReceiver, WaitsForNoSegmentOfAPeerThatHasEnded)
{
  HostilePublisher publisher;
  publisher.ends.receiving->end();
  EXPECT_TRUE(publisher.link->ended);
  EXPECT_EQ(Take::TAKEN, publisher.find(2, 0, 1));
  EXPECT_EQ(nullptr, publisher.found);
}

TEST(RingReceiver, KnowsWhichPeerSentASegment)
{
  // The second one must not get its messages read from the memory of the first one.
  HostilePublisher foreign;
  HostilePublisher genuine;
  foreign.segment(1, HostilePublisher::memory(4096, 6), 4096);
  genuine.segment(1, HostilePublisher::memory(4096, 7), 4096);
  EXPECT_EQ(Take::TAKEN, genuine.find(1, 0, 1));
  ASSERT_NE(nullptr, genuine.found);
  EXPECT_EQ(7, *genuine.found->data());
}

TEST(RingReceiver, TakesNothingThatItCannotRead)
{
  HostilePublisher publisher;
  publisher.segment(1, HostilePublisher::memory(4096, 7), 1 << 30);  // longer than it is
  publisher.segment(2, HostilePublisher::memory(4096, 7, false), 4096);
  EXPECT_EQ(Take::UNREADABLE, publisher.find(1, 0, 1));
  EXPECT_EQ(Take::UNREADABLE, publisher.find(2, 0, 1));
}

}  // namespace
}  // namespace pi_os_transport
