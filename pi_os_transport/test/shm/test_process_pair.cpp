#include "shm/process_pair.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/resource.h>
#include <unistd.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "shm/pair_ends.h"
#include "shm/shared_memory.h"

namespace pi_os_transport
{
namespace
{

/// While this object lives, this process gets no descriptors.
class NoDescriptors
{
public:
  NoDescriptors()
  {
    getrlimit(RLIMIT_NOFILE, &before_);
    const FileDescriptor next(dup(0));
    const rlimit none{static_cast<rlim_t>(next.get()), before_.rlim_max};
    setrlimit(RLIMIT_NOFILE, &none);
  }
  ~NoDescriptors() { setrlimit(RLIMIT_NOFILE, &before_); }
  NoDescriptors(const NoDescriptors&) = delete;
  NoDescriptors& operator=(const NoDescriptors&) = delete;

private:
  rlimit before_{};
};

bool readable(int fd)
{
  pollfd ready{fd, POLLIN, 0};
  return poll(&ready, 1, 0) == 1;
}

class ProcessPairTest : public ::testing::Test
{
protected:
  PairEnds ends_;
  const std::shared_ptr<RecordingLink> first_ = std::make_shared<RecordingLink>();
  const std::shared_ptr<RecordingLink> second_ = std::make_shared<RecordingLink>();
};

TEST_F(ProcessPairTest, BothKnowEachOtherAfterTheFirstPackets)
{
  EXPECT_TRUE(ends_.receiving->met());
  EXPECT_TRUE(ends_.sending->met());
  EXPECT_TRUE(ends_.sending->peerToken() == ends_.receiving_host.host->token);
  EXPECT_TRUE(ends_.receiving->peerToken() == ends_.sending_host.host->token);
}

TEST_F(ProcessPairTest, PacketsReachTheEndOfTheLinkThatTheyAreAbout)
{
  const uint32_t number = ends_.receiving->addReceiver(first_);
  ASSERT_TRUE(ends_.sending->addSender(number, second_));
  ends_.sending->send(Packet::of(Packet::WAITING, number, 5));
  ends_.receiving->send(Packet::of(Packet::SPACE, number | Packet::TO_SENDER, 6));
  ends_.receiving->send(Packet::of(Packet::SPACE, (number + 1) | Packet::TO_SENDER, 7));
  ASSERT_TRUE(ends_.receiving->receive());
  ASSERT_TRUE(ends_.sending->receive());
  ASSERT_EQ(1U, first_->packets.size());
  EXPECT_EQ(5U, first_->packets[0].values[0]);
  ASSERT_EQ(1U, second_->packets.size());
  EXPECT_EQ(6U, second_->packets[0].values[0]);
}

TEST_F(ProcessPairTest, NumbersComeNotAgainSoon)
{
  const uint32_t number = ends_.receiving->addReceiver(first_);
  ends_.receiving->leave(number);
  std::vector<uint32_t> numbers;
  for (uint32_t link = 0; link < NewsLayout::LINKS; ++link)
  {
    numbers.push_back(ends_.receiving->addReceiver(first_));
    ASSERT_NE(0U, numbers.back());
    ASSERT_NE(number, numbers.back());
  }
  EXPECT_EQ(0U, ends_.receiving->addReceiver(first_)) << "every place is taken";
  ends_.receiving->leave(numbers[7]);
  const uint32_t again = ends_.receiving->addReceiver(first_);
  EXPECT_EQ(numbers[7] % NewsLayout::LINKS, again % NewsLayout::LINKS);
  EXPECT_NE(numbers[7], again);
}

TEST_F(ProcessPairTest, RefusesLinksThatAreNotExpected)
{
  ends_.sending_host.accepts = false;
  const uint32_t number = ends_.receiving->addReceiver(first_);
  ends_.receiving->send(Packet::of(Packet::HELLO, number, 1, 2));
  ASSERT_TRUE(ends_.sending->receive());
  ASSERT_TRUE(ends_.receiving->receive());
  ASSERT_EQ(1U, first_->packets.size());
  EXPECT_EQ(uint32_t{Packet::ENDED}, first_->packets[0].type);
  EXPECT_EQ(static_cast<uint64_t>(LinkEnd::REFUSED), first_->packets[0].values[0]);
}

TEST_F(ProcessPairTest, AllLinksHearOfTheEndOfThePeer)
{
  ends_.receiving->addReceiver(first_);
  ASSERT_TRUE(ends_.receiving->addSender(4097, second_));
  EXPECT_FALSE(ends_.receiving->addSender(4097, first_)) << "the number is in use";
  ends_.sending->end();
  EXPECT_FALSE(ends_.receiving->receive());
  ends_.receiving->end();
  EXPECT_TRUE(first_->ended);
  EXPECT_TRUE(second_->ended);
  EXPECT_EQ(0U, ends_.receiving->addReceiver(first_));
  EXPECT_FALSE(ends_.receiving->send(Packet::of(Packet::SPACE, 1)));
}

TEST_F(ProcessPairTest, EndsAtAPacketThatIsNone)
{
  ends_.sending->sendBytes(std::vector<uint8_t>(7));
  EXPECT_FALSE(ends_.receiving->receive());
}

TEST_F(ProcessPairTest, OneBellForAllNewsUntilSomebodyLooks)
{
  const uint32_t numbers[] = {ends_.receiving->addReceiver(first_), ends_.receiving->addReceiver(second_)};
  EXPECT_FALSE(ends_.receiving->hasNews());
  for (int round = 1; round <= 3; ++round)
  {
    ends_.sending->wake(numbers[0], NETWORK_THREAD);
    ends_.sending->wake(numbers[1], NETWORK_THREAD);
    EXPECT_TRUE(ends_.receiving->hasNews());
    EXPECT_TRUE(readable(ends_.receiving->fd()));
    ASSERT_TRUE(ends_.receiving->receive());
    EXPECT_FALSE(readable(ends_.receiving->fd())) << "there was one packet";
    EXPECT_EQ(round, first_->served);
    EXPECT_EQ(round, second_->served);
  }
  ends_.receiving->removeReceiver(numbers[0]);
  ends_.sending->wake(numbers[0], NETWORK_THREAD);
  ASSERT_TRUE(ends_.receiving->receive());
  EXPECT_EQ(3, first_->served) << "it is not called any more";
}

TEST(ProcessPair, WakesTheThreadThatSleepsAndElseTheNetworkThread)
{
  std::string error;
  const FileDescriptor memory = makeSharedMemory("pi_os_test", sizeof(WakeLayout), &error);
  const SharedMapping mapping(memory.get(), sizeof(WakeLayout), true);
  auto* const layout = reinterpret_cast<WakeLayout*>(mapping.data());
  layout->magic = WakeLayout::MAGIC;
  sealSharedMemory(memory.get(), false);
  PairEnds ends(memory.get());
  const auto link = std::make_shared<RecordingLink>();
  const uint32_t number = ends.receiving->addReceiver(link);
  Sleeper sleeper(&layout->sleepers[5]);
  const uint32_t bell = sleeper.prepare();
  ends.sending->wake(number, FIRST_SPINNER + 5);
  EXPECT_EQ(bell + 1, layout->sleepers[5].bell.load());
  EXPECT_FALSE(readable(ends.receiving->fd()));
  sleeper.wakeUp();
  ends.receiving->serveNews();
  EXPECT_EQ(1, link->served);
  ends.sending->wake(number, FIRST_SPINNER + 5);
  EXPECT_EQ(bell + 1, layout->sleepers[5].bell.load()) << "it is awake";
  EXPECT_TRUE(readable(ends.receiving->fd()));
  ends.receiving->serveNews();
  ends.sending->wake(number, FIRST_SPINNER + 1000);  // no such place
  EXPECT_TRUE(readable(ends.receiving->fd()));
}

TEST_F(ProcessPairTest, PacketsWaitForAPeerThatDoesNotRead)
{
  const uint32_t number = ends_.receiving->addReceiver(first_);
  uint64_t sent = 0;
  while (!ends_.sending_host.wants_write)
  {
    ASSERT_TRUE(ends_.sending->send(Packet::of(Packet::WAITING, number, sent++)));
  }
  for (const uint64_t last = sent + 100; sent < last; ++sent)
  {
    ASSERT_TRUE(ends_.sending->send(Packet::of(Packet::WAITING, number, sent)));
  }
  while (first_->packets.size() < sent)
  {
    ASSERT_TRUE(ends_.receiving->receive());
    ends_.sending->flush();
  }
  EXPECT_FALSE(ends_.sending_host.wants_write);
  for (uint64_t index = 0; index < sent; ++index)
  {
    ASSERT_EQ(index, first_->packets[index].values[0]) << "they keep their order";
  }
}

TEST_F(ProcessPairTest, GivesUpAPeerThatNeverReads)
{
  while (ends_.sending->send(Packet::of(Packet::WAITING, 4097)))
  {
  }
  EXPECT_FALSE(ends_.sending->receive());
}

TEST_F(ProcessPairTest, SaysWhenThereIsNoRoomForADescriptor)
{
  SlotPool pool(1 << 20);
  const uint32_t number = ends_.receiving->addReceiver(first_);
  uint8_t* const message = pool.allocate(100);
  const uint32_t segment = pool.locate(message).segment;
  ASSERT_TRUE(ends_.sending->announce(pool, segment));
  {
    const NoDescriptors limit;
    ASSERT_TRUE(ends_.receiving->receive());
  }
  std::shared_ptr<MappedSegment> found;
  EXPECT_EQ(ProcessPair::Lookup::LOST, ends_.receiving->findSegment(segment, number, &found));
  ASSERT_EQ(1U, ends_.receiving_host.shortages.size());
  EXPECT_NE(std::string::npos, ends_.receiving_host.shortages[0].find("(ulimit -n)"));
  pool.release(message);
}

TEST_F(ProcessPairTest, TellsOfASegmentOnceForAllLinks)
{
  SlotPool pool(1 << 20);
  uint8_t* const message = pool.allocate(100);
  const uint32_t segment = pool.locate(message).segment;
  ASSERT_TRUE(ends_.sending->announce(pool, segment));
  ASSERT_TRUE(ends_.receiving->receive());
  ASSERT_TRUE(ends_.sending->announce(pool, segment));
  EXPECT_FALSE(readable(ends_.receiving->fd()));
  std::shared_ptr<MappedSegment> found;
  EXPECT_EQ(ProcessPair::Lookup::FOUND, ends_.receiving->findSegment(segment, 1, &found));
  ends_.sending->retire({segment, segment + 1});
  ASSERT_TRUE(ends_.receiving->receive());
  EXPECT_EQ(ProcessPair::Lookup::UNKNOWN, ends_.receiving->findSegment(segment, 1, &found));
  pool.release(message);
}

TEST_F(ProcessPairTest, ReadsTheSegmentThatAnotherThreadNeedsAndLeavesTheRestToTheNetworkThread)
{
  SlotPool pool(1 << 20);
  const uint32_t number = ends_.receiving->addReceiver(first_);
  uint8_t* const message = pool.allocate(100);
  const uint32_t segment = pool.locate(message).segment;
  ends_.sending->send(Packet::of(Packet::WAITING, number));
  ASSERT_TRUE(ends_.sending->announce(pool, segment));
  std::shared_ptr<MappedSegment> found;
  EXPECT_EQ(ProcessPair::Lookup::FOUND, ends_.receiving->findSegment(segment, number, &found));
  EXPECT_TRUE(first_->packets.empty());
  EXPECT_EQ(1, ends_.receiving_host.receive_soon);
  ASSERT_TRUE(ends_.receiving->receive());
  EXPECT_EQ(1U, first_->packets.size());
  pool.release(message);
}

TEST(ProcessPair, IsNotMadeWithoutDescriptors)
{
  std::pair<SideChannel, SideChannel> channels = connectedChannels();
  TestHost host;
  std::string shortage;
  const NoDescriptors limit;
  EXPECT_EQ(nullptr, ProcessPair::make(std::move(channels.first), host.host, &shortage));
  EXPECT_NE(std::string::npos, shortage.find("(ulimit -n)")) << shortage;
}

}  // namespace
}  // namespace pi_os_transport
