#include "shm/descriptor_ring.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <random>
#include <thread>
#include <vector>

namespace pi_os_transport
{
namespace
{

constexpr uint32_t CAPACITY = RingLayout::CAPACITY;

class DescriptorRing : public ::testing::Test
{
protected:
  DescriptorRing() : layout_(new RingLayout{}), producer_(layout_.get(), 42), consumer_(layout_.get()) {}

  Descriptor numbered(uint32_t number, uint32_t after_tcp = 0)
  {
    return Descriptor{number, number + 1, 4 * number, after_tcp};
  }

  RingProducer::Push push(const Descriptor& descriptor) { return producer_.push(descriptor, &doorbell_); }

  RingConsumer::Take take(uint32_t tcp_delivered = 0) { return consumer_.take(tcp_delivered, false, &taken_, &place_); }

  std::unique_ptr<RingLayout> layout_;
  RingProducer producer_;
  RingConsumer consumer_;
  Descriptor taken_;
  uint32_t place_ = 0;
  uint32_t doorbell_ = 0;
};

TEST_F(DescriptorRing, HandsDescriptorsOverUnchangedAndInOrder)
{
  const Descriptor large{0xfffffffe, (uint32_t{1} << 30) - 1, (uint64_t{1} << 34) - 1, 7, (uint64_t{1} << 56) - 1};
  push(numbered(1));
  push(large);
  ASSERT_EQ(RingConsumer::Take::TAKEN, take());
  EXPECT_EQ(1U, taken_.segment);
  EXPECT_EQ(2U, taken_.length);
  EXPECT_EQ(4U, taken_.offset);
  ASSERT_EQ(RingConsumer::Take::TAKEN, take(7));
  EXPECT_EQ(large.segment, taken_.segment);
  EXPECT_EQ(large.length, taken_.length);
  EXPECT_EQ(large.offset, taken_.offset);
  EXPECT_EQ(large.after_tcp, taken_.after_tcp);
  EXPECT_EQ(large.serial, taken_.serial);
  EXPECT_EQ(RingConsumer::Take::EMPTY, take(7));
}

TEST_F(DescriptorRing, AsksForADoorbellOnlyWhenTheConsumerSleeps)
{
  push(numbered(0));
  EXPECT_EQ(0U, doorbell_);
  ASSERT_EQ(RingConsumer::Take::TAKEN, take());
  ASSERT_EQ(RingConsumer::Take::EMPTY, take());
  push(numbered(1));
  EXPECT_EQ(1U, doorbell_);
  push(numbered(2));
  EXPECT_EQ(0U, doorbell_);
}

TEST_F(DescriptorRing, AsksForTheDoorbellThatTheConsumerChose)
{
  ASSERT_EQ(RingConsumer::Take::EMPTY, take());
  consumer_.useDoorbell(2);
  ASSERT_EQ(RingConsumer::Take::EMPTY, take());
  push(numbered(0));
  EXPECT_EQ(2U, doorbell_);
}

TEST_F(DescriptorRing, RefusesToOverwriteWhatIsNotReleased)
{
  for (uint32_t i = 0; i < CAPACITY; ++i)
  {
    ASSERT_NE(RingProducer::Push::FULL, push(numbered(i)));
  }
  EXPECT_EQ(RingProducer::Push::FULL, push(numbered(CAPACITY)));
  ASSERT_EQ(RingConsumer::Take::TAKEN, take());
  EXPECT_EQ(RingProducer::Push::FULL, push(numbered(CAPACITY))) << "taken, but still being read";
  consumer_.release(place_);
  producer_.collect([](uint32_t) {});
  EXPECT_NE(RingProducer::Push::FULL, push(numbered(CAPACITY)));
}

TEST_F(DescriptorRing, CollectsEachReleaseOnceAndInAnyOrder)
{
  std::vector<uint32_t> places;
  for (uint32_t i = 0; i < 3; ++i)
  {
    push(numbered(i));
    take();
    places.push_back(place_);
  }
  std::vector<uint32_t> collected;
  const auto collect = [&]() { producer_.collect([&](uint32_t place) { collected.push_back(place); }); };
  consumer_.release(places[2]);
  collect();
  EXPECT_EQ(std::vector<uint32_t>{places[2]}, collected);
  collect();
  EXPECT_EQ(1U, collected.size());
  consumer_.release(places[0]);
  consumer_.release(places[1]);
  collect();
  EXPECT_EQ((std::vector<uint32_t>{places[2], places[0], places[1]}), collected);
}

TEST_F(DescriptorRing, AMessageHeldForLongTakesNoPlaceFromOthers)
{
  push(numbered(0));
  take();
  const uint32_t held = place_;
  for (uint32_t i = 1; i < 3 * CAPACITY; ++i)
  {
    ASSERT_EQ(RingProducer::Push::WRITTEN, push(numbered(i)));
    ASSERT_EQ(RingConsumer::Take::TAKEN, take());
    ASSERT_EQ(i, taken_.segment);
    ASSERT_NE(held, place_);
    consumer_.release(place_);
    producer_.collect([held](uint32_t ticket) { EXPECT_NE(held, ticket); });
  }
  consumer_.release(held);
  producer_.collect([held](uint32_t ticket) { EXPECT_EQ(held, ticket); });
  EXPECT_TRUE(producer_.idle());
}

TEST_F(DescriptorRing, AReleaseOfAnOlderMessageLeavesTheNewerOneOfItsPlace)
{
  push(numbered(0));
  take();
  const uint32_t old = place_;
  for (uint32_t i = 1; i <= CAPACITY; ++i)
  {
    push(numbered(i));
    if (i < CAPACITY)
    {
      take();
      consumer_.release(place_);
      producer_.collect([](uint32_t) {});
    }
  }
  // Message CAPACITY lies at the place of message 0, which is still held.
  consumer_.release(old);
  std::vector<uint32_t> collected;
  producer_.collect([&](uint32_t ticket) { collected.push_back(ticket); });
  EXPECT_EQ(std::vector<uint32_t>{old}, collected);
  const int newest = producer_.ticketOf(CAPACITY);
  EXPECT_GE(newest, 0);
  EXPECT_EQ(newest, producer_.dropOldest());
}

TEST_F(DescriptorRing, APeerCannotReleaseWhatItHasNotTaken)
{
  push(numbered(0));
  consumer_.release(static_cast<uint32_t>(producer_.ticketOf(0)));
  producer_.collect([](uint32_t) { ADD_FAILURE() << "collected"; });
  EXPECT_GE(producer_.dropOldest(), 0);
  EXPECT_EQ(-1, producer_.dropOldest());
}

TEST_F(DescriptorRing, DropsTheOldestThatIsNotTaken)
{
  for (uint32_t i = 0; i < 4; ++i)
  {
    push(numbered(i));
  }
  take();  // 0 belongs to the consumer now
  EXPECT_EQ(1, producer_.dropOldest());
  EXPECT_EQ(2U, producer_.inFlight());
  ASSERT_EQ(RingConsumer::Take::TAKEN, take());
  EXPECT_EQ(2U, taken_.segment);
  take();
  EXPECT_EQ(-1, producer_.dropOldest());
}

TEST_F(DescriptorRing, WaitsForMessagesThatCameOverTcpBefore)
{
  push(numbered(0, 2));
  EXPECT_EQ(RingConsumer::Take::WAITING, take(0));
  EXPECT_EQ(RingConsumer::Take::WAITING, take(1));
  EXPECT_EQ(RingConsumer::Take::TAKEN, take(2));
}

TEST_F(DescriptorRing, TcpCountMayWrapAround)
{
  push(numbered(0, 1));  // 2^32 + 1 messages have gone over TCPROS
  EXPECT_EQ(RingConsumer::Take::WAITING, take(0xffffffff));
  EXPECT_EQ(RingConsumer::Take::TAKEN, take(1));
}

TEST_F(DescriptorRing, GivesUpWaitingWhenTold)
{
  push(numbered(0, 5));
  EXPECT_EQ(RingConsumer::Take::TAKEN, consumer_.take(0, true, &taken_, &place_));
}

TEST_F(DescriptorRing, AbandonReturnsAllThatIsHeld)
{
  for (uint32_t i = 0; i < 5; ++i)
  {
    push(numbered(i));
  }
  take();
  take();
  std::vector<uint32_t> places;
  producer_.abandon([&](uint32_t place) { places.push_back(place); });
  EXPECT_EQ((std::vector<uint32_t>{0, 1, 2, 3, 4}), places);
  producer_.abandon([&](uint32_t) { ADD_FAILURE() << "abandoned twice"; });
}

TEST_F(DescriptorRing, NoticesAPeerThatWritesNonsense)
{
  push(numbered(0));
  layout_->head.store(77);
  EXPECT_GT(producer_.inFlight(), CAPACITY);
  EXPECT_EQ(-1, producer_.dropOldest());
}

TEST_F(DescriptorRing, GivesNothingBackTwiceToAPeerThatMovesTheHeadBack)
{
  push(numbered(0));
  push(numbered(1));
  ASSERT_EQ(RingConsumer::Take::TAKEN, take());
  consumer_.release(place_);
  producer_.collect([](uint32_t) {});
  layout_->head.store(0);
  EXPECT_GT(producer_.inFlight(), CAPACITY);
  EXPECT_EQ(-1, producer_.dropOldest());
}

TEST_F(DescriptorRing, GivesEverythingBackOnceWhateverAPeerReleasesThatItNeverTook)
{
  push(numbered(0));
  push(numbered(1));
  consumer_.release(1);
  consumer_.release(0);
  producer_.collect([](uint32_t) { ADD_FAILURE() << "it was not taken"; });
  EXPECT_EQ(0, producer_.dropOldest());
  EXPECT_EQ(1, producer_.dropOldest());
  EXPECT_EQ(-1, producer_.dropOldest());
}

TEST_F(DescriptorRing, TakesNothingFromAPublisherThatLiesAboutItsTail)
{
  push(numbered(0));
  layout_->tail.store(CAPACITY + 1);
  EXPECT_EQ(RingConsumer::Take::EMPTY, take());
  EXPECT_TRUE(consumer_.broken());
  EXPECT_LE(consumer_.available(), CAPACITY);
}

TEST_F(DescriptorRing, AFullRingIsNotBroken)
{
  for (uint32_t i = 0; i < CAPACITY; ++i)
  {
    push(numbered(i));
  }
  EXPECT_EQ(RingConsumer::Take::TAKEN, take());
  EXPECT_FALSE(consumer_.broken());
}

TEST_F(DescriptorRing, IndicesMayWrapAround)
{
  for (uint32_t i = 0; i < 10 * CAPACITY + 3; ++i)
  {
    ASSERT_NE(RingProducer::Push::FULL, push(numbered(i)));
    ASSERT_EQ(RingConsumer::Take::TAKEN, take());
    ASSERT_EQ(i, taken_.segment);
    consumer_.release(place_);
    producer_.collect([](uint32_t) {});
  }
}

/// One thread pushes and drops, one takes, two release: every message is taken or dropped exactly once and what is
/// taken comes whole and in order.
TEST_F(DescriptorRing, KeepsEveryMessageUnderConcurrentDrops)
{
  constexpr uint32_t MESSAGES = 200000;
  std::atomic<bool> done{false};
  std::vector<uint32_t> received;
  received.reserve(MESSAGES);
  std::thread consumer(
      [&]()
      {
        Descriptor descriptor;
        uint32_t place = 0;
        for (;;)
        {
          const bool last_round = done.load();
          if (consumer_.take(0, false, &descriptor, &place) == RingConsumer::Take::TAKEN)
          {
            ASSERT_EQ(descriptor.segment + 1, descriptor.length);
            ASSERT_EQ(4 * uint64_t{descriptor.segment}, descriptor.offset);
            received.push_back(descriptor.segment);
            consumer_.release(place);
          }
          else if (last_round)
          {
            return;
          }
        }
      });
  std::mt19937 random(1);
  uint64_t dropped = 0;
  uint64_t collected = 0;
  for (uint32_t i = 0; i < MESSAGES;)
  {
    producer_.collect([&](uint32_t) { ++collected; });
    if (producer_.inFlight() > random() % CAPACITY && producer_.dropOldest() >= 0)
    {
      ++dropped;
    }
    if (push(numbered(i)) != RingProducer::Push::FULL)
    {
      ++i;
    }
  }
  done = true;
  consumer.join();
  producer_.collect([&](uint32_t) { ++collected; });
  EXPECT_TRUE(std::is_sorted(received.begin(), received.end()));
  EXPECT_EQ(received.end(), std::adjacent_find(received.begin(), received.end()));
  EXPECT_EQ(uint64_t{MESSAGES}, received.size() + dropped);
  EXPECT_EQ(received.size(), collected);
}

}  // namespace
}  // namespace pi_os_transport
