#include "shm/ring_sender.h"

#include <gtest/gtest.h>
#include <poll.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "shm/ring_pair.h"

namespace pi_os_transport
{
namespace
{

using Bytes = std::vector<uint8_t>;
using Push = RingSender::Push;

constexpr size_t LARGE = 600 << 10;  // two of them are more than sockets would hold

class RingSenderTest : public ::testing::Test
{
protected:
  Push push(const Bytes& bytes, size_t max_queue = 0, uint64_t serial = 0, uint32_t after_tcp = 0)
  {
    uint8_t* const buffer = poolMessage(&pool_, bytes);
    const Push result = sender().push(buffer, static_cast<uint32_t>(bytes.size()), max_queue, after_tcp, serial);
    if (result != Push::WRITTEN)
    {
      pool_.release(buffer);
    }
    return result;
  }
  RingSender& sender() { return *pair_.sender; }
  uint32_t liveSlots() const { return pool_.usage().live_slots; }
  /// Gives back what takeBack() returned.
  Bytes bytesOf(const RingSender::Message& message)
  {
    const Bytes bytes(message.buffer + LENGTH_PREFIX, message.buffer + LENGTH_PREFIX + message.length);
    pool_.release(message.buffer);
    return bytes;
  }

  SlotPool pool_{64 << 20};
  RingPair pair_{&pool_};
};

TEST_F(RingSenderTest, HandsMessagesOverWithTheirSerial)
{
  ASSERT_EQ(Push::WRITTEN, push(patternOf(1, 1000), 0, 41, 7));
  ASSERT_EQ(Push::WRITTEN, push({}, 0, 42, 8));
  std::optional<RingPair::Taken> taken = pair_.take();
  ASSERT_TRUE(taken);
  EXPECT_EQ(patternOf(1, 1000), taken->bytes);
  EXPECT_EQ(41U, taken->descriptor.serial);
  EXPECT_EQ(7U, taken->descriptor.after_tcp);
  taken = pair_.take();
  ASSERT_TRUE(taken);
  EXPECT_EQ(Bytes(), taken->bytes);
  EXPECT_EQ(42U, taken->descriptor.serial);
  EXPECT_FALSE(pair_.take());
  EXPECT_EQ(2U, sender().sent());
}

TEST_F(RingSenderTest, OffersMemoryThatTheSubscriberProves)
{
  RingPair pair(&pool_, 12345);
  EXPECT_EQ(12345U, pair.receiver->leaseBudget());
  ASSERT_TRUE(pair.receiver->sendProof());
  ASSERT_TRUE(pair.ends.sending->receive());
  ASSERT_EQ(1U, pair.sending_link->packets.size());
  Packet packet = pair.sending_link->packets.front();
  EXPECT_TRUE(pair.sender->isProof(packet));
  ++packet.values[0];
  EXPECT_FALSE(pair.sender->isProof(packet));
}

TEST_F(RingSenderTest, DoesNotOpenTowardsASubscriberThatLeft)
{
  PairEnds ends;
  RingSender sender(&pool_, 1);
  std::string error = "old";
  ends.receiving->end();
  ends.sending->end();
  EXPECT_FALSE(sender.open(ends.sending, 4096, &error));
  EXPECT_EQ("", error);
  EXPECT_FALSE(sender.isOpen());
  EXPECT_TRUE(sender.idle());
  EXPECT_TRUE(sender.takeBack().empty());
  EXPECT_TRUE(sender.takeBackTaken().empty());
}

TEST_F(RingSenderTest, StartCarriesQueueSizeLatchingAndCount)
{
  ASSERT_TRUE(sender().pushStart(5, true, 9));
  const std::optional<RingPair::Taken> taken = pair_.take();
  ASSERT_TRUE(taken);
  EXPECT_EQ(uint32_t{Descriptor::LINK_START}, taken->descriptor.segment);
  EXPECT_EQ(5U, taken->descriptor.length);
  EXPECT_EQ(1U, taken->descriptor.serial);
  EXPECT_EQ(9U, taken->descriptor.after_tcp);
  EXPECT_EQ(0U, sender().sent()) << "it is no message";
  ASSERT_TRUE(sender().pushStart(0, false, 0));
  EXPECT_EQ(0U, pair_.take()->descriptor.serial);
}

TEST_F(RingSenderTest, StartNeedsAPlace)
{
  for (uint32_t place = 0; place < RingLayout::CAPACITY; ++place)
  {
    ASSERT_TRUE(sender().pushStart(1, false, place));
  }
  EXPECT_FALSE(sender().pushStart(1, false, 0));
  EXPECT_EQ(Push::FULL, push({1}));
}

TEST_F(RingSenderTest, TakesBackWhatIsNotTakenOldestFirst)
{
  ASSERT_TRUE(sender().pushStart(0, false, 0));
  for (uint32_t number = 0; number < 5; ++number)
  {
    ASSERT_EQ(Push::WRITTEN, push(patternOf(number, 100 + number)));
  }
  ASSERT_TRUE(pair_.take());  // the start
  const std::optional<RingPair::Taken> first = pair_.take();
  ASSERT_TRUE(first);
  EXPECT_EQ(4U, sender().untaken());
  const std::vector<RingSender::Message> back = sender().takeBack();
  ASSERT_EQ(4U, back.size());
  for (uint32_t number = 1; number < 5; ++number)
  {
    EXPECT_EQ(patternOf(number, 100 + number), bytesOf(back[number - 1]));
  }
  EXPECT_FALSE(pair_.take());
  EXPECT_TRUE(sender().takeBack().empty());
  EXPECT_EQ(1U, liveSlots()) << "the subscriber still reads the first one";
  pair_.receiver->release(first->place);
  sender().collect();
  EXPECT_EQ(0U, liveSlots());
}

TEST_F(RingSenderTest, TakingBackLeavesOutAStartThatNobodyTook)
{
  ASSERT_TRUE(sender().pushStart(0, false, 0));
  ASSERT_EQ(Push::WRITTEN, push({1, 2, 3}));
  const std::vector<RingSender::Message> back = sender().takeBack();
  ASSERT_EQ(1U, back.size());
  EXPECT_EQ((Bytes{1, 2, 3}), bytesOf(back[0]));
}

TEST_F(RingSenderTest, TakesBackWhatIsTakenAndNotReleasedInOrder)
{
  EXPECT_TRUE(sender().takeBackTaken().empty()) << "nothing was sent";
  std::vector<RingPair::Taken> taken;
  for (uint32_t number = 1; number <= 300; ++number)  // tickets are used again, in another order
  {
    ASSERT_EQ(Push::WRITTEN, push(patternOf(number, 100 + number), 0, 0, number));
    taken.push_back(*pair_.take());
    if (number % 100 != 0)
    {
      pair_.receiver->release(taken.back().place);
    }
  }
  EXPECT_EQ(0U, sender().untaken());
  ASSERT_EQ(Push::WRITTEN, push({1}, 0, 0, 301));
  EXPECT_EQ(1U, sender().takeBack().size());
  const std::vector<RingSender::Message> back = sender().takeBackTaken();
  ASSERT_EQ(3U, back.size());
  for (uint32_t index = 0; index < 3; ++index)
  {
    const uint32_t number = 100 * (index + 1);
    EXPECT_EQ(number, back[index].after_tcp);
    EXPECT_EQ(patternOf(number, 100 + number), bytesOf(back[index]));
    pair_.receiver->release(taken[number - 1].place);
  }
  sender().collect();
  EXPECT_TRUE(sender().takeBackTaken().empty());
}

TEST_F(RingSenderTest, CountsTheBytesThatAreNotTaken)
{
  ASSERT_TRUE(sender().pushStart(0, false, 0));
  EXPECT_EQ(0U, sender().untakenBytes());
  ASSERT_EQ(Push::WRITTEN, push(patternOf(1, 100)));
  ASSERT_EQ(Push::WRITTEN, push(patternOf(2, 30)));
  EXPECT_EQ(130U, sender().untakenBytes());
  ASSERT_TRUE(pair_.take());
  ASSERT_TRUE(pair_.take());
  EXPECT_EQ(30U, sender().untakenBytes());
}

TEST_F(RingSenderTest, IsIdleWhenTheSubscriberHoldsNothing)
{
  EXPECT_TRUE(sender().idle());
  ASSERT_EQ(Push::WRITTEN, push({1}));
  EXPECT_FALSE(sender().idle());
  const std::optional<RingPair::Taken> taken = pair_.take();
  sender().collect();
  EXPECT_FALSE(sender().idle());
  EXPECT_EQ(0U, sender().untaken());
  pair_.receiver->release(taken->place);
  sender().collect();
  EXPECT_TRUE(sender().idle());
}

TEST_F(RingSenderTest, DropsTheOldestOfLargeMessagesOnly)
{
  for (uint32_t number = 0; number < 10; ++number)
  {
    ASSERT_EQ(Push::WRITTEN, push({1}, 1));
  }
  EXPECT_EQ(0U, sender().dropped()) << "so little waits in sockets as well";
  pair_.takeMessages();
  for (uint32_t number = 0; number < 5; ++number)
  {
    ASSERT_EQ(Push::WRITTEN, push(patternOf(number, LARGE), 1));
  }
  EXPECT_EQ(3U, sender().dropped());
  const std::vector<Bytes> taken = pair_.takeMessages();
  ASSERT_EQ(2U, taken.size());
  EXPECT_EQ(patternOf(3, LARGE), taken[0]);
  EXPECT_EQ(patternOf(4, LARGE), taken[1]);
}

/// A link whose start is dropped never carries anything: whoever reads it passes over what comes before the start.
TEST_F(RingSenderTest, NeverDropsTheStart)
{
  ASSERT_TRUE(sender().pushStart(1, false, 0));
  bool full = false;
  for (uint32_t number = 0; number < 4; ++number)
  {
    full = push(patternOf(number, LARGE), 1) == Push::FULL || full;
  }
  EXPECT_TRUE(full) << "what would drop it has to wait";
  const std::optional<RingPair::Taken> first = pair_.take();
  ASSERT_TRUE(first);
  EXPECT_EQ(uint32_t{Descriptor::LINK_START}, first->descriptor.segment);
}

TEST_F(RingSenderTest, SubscriberMayPinNoMoreThanItsBudget)
{
  RingPair small(&pool_, 1000);
  const auto pushTo = [&](size_t bytes)
  {
    uint8_t* const buffer = poolMessage(&pool_, Bytes(bytes));
    const Push result = small.sender->push(buffer, static_cast<uint32_t>(bytes), 0, 0, 0);
    if (result != Push::WRITTEN)
    {
      pool_.release(buffer);
    }
    return result;
  };
  EXPECT_EQ(Push::WRITTEN, pushTo(900));
  EXPECT_EQ(Push::WRITTEN, pushTo(900)) << "two always fit, or nothing would flow";
  EXPECT_EQ(Push::FULL, pushTo(900));
  EXPECT_EQ(2U, small.takeMessages().size());
  EXPECT_EQ(Push::WRITTEN, pushTo(900));
}

TEST_F(RingSenderTest, ClosingGivesEverythingBack)
{
  for (uint32_t number = 0; number < 5; ++number)
  {
    ASSERT_EQ(Push::WRITTEN, push(patternOf(number, 1000)));
  }
  ASSERT_TRUE(pair_.take());
  EXPECT_EQ(5U, liveSlots());
  sender().close();
  EXPECT_EQ(0U, liveSlots());
  EXPECT_FALSE(sender().isOpen());
  EXPECT_TRUE(sender().idle());
}

TEST_F(RingSenderTest, TellsSegmentsOnceAndAnewAfterTheyWereRetired)
{
  ASSERT_EQ(Push::WRITTEN, push(patternOf(1, LARGE)));
  EXPECT_EQ(1U, pair_.takeMessages().size());
  sender().collect();
  pool_.trim();
  const std::vector<uint32_t> retired = pool_.takeRetired();
  ASSERT_FALSE(retired.empty());
  pair_.ends.sending->retire(retired);
  ASSERT_EQ(Push::WRITTEN, push(patternOf(2, LARGE)));
  const std::vector<Bytes> taken = pair_.takeMessages();
  ASSERT_EQ(1U, taken.size());
  EXPECT_EQ(patternOf(2, LARGE), taken[0]);
}

TEST_F(RingSenderTest, RingsTheDoorbellOfASubscriberThatSleeps)
{
  pollfd bell{pair_.ends.receiving->fd(), POLLIN, 0};
  ASSERT_EQ(Push::WRITTEN, push({0}));
  EXPECT_EQ(1U, pair_.takeMessages().size());  // it is about to sleep
  EXPECT_TRUE(pair_.ends.receiving->receive());
  EXPECT_EQ(0, poll(&bell, 1, 0));
  ASSERT_EQ(Push::WRITTEN, push({1}));
  EXPECT_EQ(1, poll(&bell, 1, 0));
  ASSERT_EQ(Push::WRITTEN, push({2}));
  EXPECT_EQ(0, pair_.receiving_link->served);
  EXPECT_TRUE(pair_.ends.receiving->receive());
  EXPECT_EQ(1, pair_.receiving_link->served) << "once for both";
  EXPECT_EQ(0, poll(&bell, 1, 0));
}

/// A subscriber that does with the ring what it likes.
class HostileSubscriber : public ::testing::Test
{
protected:
  HostileSubscriber()
  {
    const uint32_t number = ends_.receiving->addReceiver(link_);
    std::string error;
    EXPECT_TRUE(sender_.open(ends_.sending, number, &error)) << error;
    EXPECT_TRUE(ends_.receiving->receive());
    mapping_ = SharedMapping(link_->last_descriptors[0].get(), sizeof(RingLayout), true);
  }
  Push push(uint32_t seed, size_t max_queue)
  {
    uint8_t* const buffer = poolMessage(&pool_, patternOf(seed, LARGE));
    const Push result = sender_.push(buffer, LARGE, max_queue, 0, 0);
    if (result != Push::WRITTEN)
    {
      pool_.release(buffer);
    }
    return result;
  }
  RingLayout& ring() { return *reinterpret_cast<RingLayout*>(mapping_.data()); }

  SlotPool pool_{64 << 20};
  PairEnds ends_;
  const std::shared_ptr<RecordingLink> link_ = std::make_shared<RecordingLink>();
  RingSender sender_{&pool_, 64 << 20};
  SharedMapping mapping_;
};

TEST_F(HostileSubscriber, CannotFreeAMessageTwiceByMovingTheHeadBack)
{
  ASSERT_EQ(Push::WRITTEN, push(1, 1));
  ASSERT_EQ(Push::WRITTEN, push(2, 1));
  RingConsumer consumer(&ring());
  Descriptor descriptor;
  uint32_t place = 0;
  for (int i = 0; i < 2; ++i)
  {
    ASSERT_EQ(RingConsumer::Take::TAKEN, consumer.take(0, true, &descriptor, &place));
    consumer.release(place);
  }
  sender_.collect();
  ASSERT_EQ(0U, pool_.usage().live_slots);
  ring().head.store(0);
  EXPECT_EQ(Push::BROKEN, push(3, 1));
  EXPECT_EQ(0U, pool_.usage().live_slots);
}

TEST_F(HostileSubscriber, CannotFreeAMessageByReleasingWhatItNeverTook)
{
  ASSERT_EQ(Push::WRITTEN, push(1, 1));
  ASSERT_EQ(Push::WRITTEN, push(2, 1));
  RingConsumer(&ring()).release(1);
  EXPECT_EQ(Push::WRITTEN, push(3, 1));  // the first one was dropped for it
  EXPECT_EQ(2U, pool_.usage().live_slots);
}

}  // namespace
}  // namespace pi_os_transport
