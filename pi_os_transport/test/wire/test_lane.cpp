#include "wire/lane.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "wire/fake_frame_transport.h"

namespace pi_os_transport
{
namespace
{

using std::chrono::milliseconds;

constexpr uint64_t INITIAL_WINDOW = 512 << 10;
constexpr uint64_t MIN_WINDOW = 16 << 10;
constexpr uint64_t MAX_WINDOW = 16 << 20;
constexpr uint64_t EXPRESS_WINDOW = 1 << 20;
constexpr size_t CHUNK = 32 << 10;

/// The lanes' clock: an answer takes 100 us, and what else passes is said.
SteadyTime lane_time{std::chrono::hours(1)};
SteadyTime laneTime()
{
  return lane_time;
}

class LaneTest : public ::testing::Test
{
protected:
  void SetUp() override
  {
    for (Lane* lane : {&express_, &bulk_})
    {
      connect(lane);
    }
  }
  void connect(Lane* lane)
  {
    lane->open(transport_.connect({}));
    lane->setConnected(true);
  }
  bool send(Lane* lane, size_t bytes = CHUNK, FrameType type = FrameType::FRAGMENT)
  {
    FrameHeader header;
    header.type = type;
    const iovec piece{payload_.data(), bytes};
    const bool sent = lane->send(header, &piece, 1, nullptr, nullptr);
    (lane == &bulk_ ? bulk_sent_ : express_sent_) += sent && Lane::isCounted(type) ? 1 : 0;
    return sent;
  }
  size_t fill(Lane* lane)
  {
    size_t frames = 0;
    for (; lane->ready(); ++frames)
    {
      EXPECT_TRUE(send(lane));
    }
    transport_.sent.clear();
    return frames;
  }
  bool acknowledge()
  {
    lane_time += std::chrono::microseconds(100);
    return bulk_.onAck(bulk_sent_);
  }
  /// The first acknowledgement starts the measurement of the idle link, the second one ends it.
  void measureIdleLink()
  {
    send(&bulk_);
    ASSERT_TRUE(acknowledge());
    send(&bulk_);
    ASSERT_TRUE(acknowledge());
  }

  Bytes payload_ = Bytes(MAX_PAYLOAD);
  FakeFrameTransport transport_;
  Lane express_{Traffic::EXPRESS, &transport_, laneTime};
  Lane bulk_{Traffic::BULK, &transport_, laneTime};
  uint64_t bulk_sent_ = 0;
  uint64_t express_sent_ = 0;
};

TEST_F(LaneTest, NeedsAConnectionThatTakesFrames)
{
  EXPECT_TRUE(bulk_.ready());
  transport_.capacity = 0;
  EXPECT_FALSE(bulk_.ready());
  EXPECT_FALSE(send(&bulk_));
  EXPECT_EQ(0U, bulk_.unackedBytes());
  EXPECT_EQ(0U, bulk_.sentBytes());
  transport_.capacity = 1;
  bulk_.setConnected(false);
  EXPECT_FALSE(bulk_.ready());
  EXPECT_FALSE(send(&bulk_));
}

TEST_F(LaneTest, HoldsBackWhatExceedsTheWindow)
{
  EXPECT_EQ(INITIAL_WINDOW, bulk_.window());
  const size_t frames = fill(&bulk_);
  EXPECT_EQ((INITIAL_WINDOW + CHUNK - 1) / (CHUNK + FrameHeader::BYTES), frames);
  EXPECT_EQ(frames * (CHUNK + FrameHeader::BYTES), bulk_.unackedBytes());
  EXPECT_EQ(bulk_.unackedBytes(), bulk_.sentBytes());
  ASSERT_TRUE(acknowledge());
  EXPECT_EQ(0U, bulk_.unackedBytes());
  EXPECT_TRUE(bulk_.ready());
}

TEST_F(LaneTest, LabelsFramesAndAsksForAcknowledgementsInTime)
{
  send(&express_);
  EXPECT_EQ(0U, transport_.sent.back().header.lane);
  transport_.sent.clear();
  uint64_t since_request = 0;
  while (bulk_.ready())
  {
    send(&bulk_);
    const FrameHeader& header = transport_.sent.back().header;
    EXPECT_EQ(1U, header.lane & ~ACK_NOW);
    since_request = (header.lane & ACK_NOW) != 0 ? 0 : since_request + CHUNK;
    EXPECT_LE(since_request, INITIAL_WINDOW / 3);
  }
  // What was asked for lets the sender go on while the rest is under way.
  EXPECT_LT(since_request, INITIAL_WINDOW);
}

TEST_F(LaneTest, AsksForAcknowledgementsBeforeAPublisherRunsOutOfPlaces)
{
  constexpr uint32_t MOST = 64;  // of the 256 places in a ring
  uint32_t since_request = 0;
  for (uint32_t frame = 0; frame < 10 * MOST; ++frame)
  {
    const iovec piece{payload_.data(), 1};
    ASSERT_TRUE(express_.send(FrameHeader::of(FrameType::MESSAGE), &piece, 1, nullptr, nullptr));
    since_request = (transport_.sent.back().header.lane & ACK_NOW) != 0 ? 0 : since_request + 1;
    ASSERT_LT(since_request, MOST);
  }
}

TEST_F(LaneTest, DoesNotCountSignsOfLife)
{
  send(&express_, 8, FrameType::PING);
  send(&express_, 8, FrameType::ACK);
  send(&express_, 8, FrameType::HELLO);
  EXPECT_EQ(0U, express_.unackedBytes());
  EXPECT_EQ(3 * (8 + FrameHeader::BYTES), express_.sentBytes());
  EXPECT_FALSE(express_.onAck(1));
}

TEST_F(LaneTest, WindowGrowsOnAFastLink)
{
  measureIdleLink();
  for (int round = 0; round < 2000 && bulk_.window() < MAX_WINDOW; ++round)
  {
    fill(&bulk_);
    ASSERT_TRUE(acknowledge());
  }
  EXPECT_EQ(MAX_WINDOW, bulk_.window());
  EXPECT_EQ(128U << 10, bulk_.fragmentBytes());
}

TEST_F(LaneTest, WindowDoesNotGrowUnused)
{
  measureIdleLink();
  for (int round = 0; round < 100; ++round)
  {
    send(&bulk_);
    ASSERT_TRUE(acknowledge());
  }
  EXPECT_LE(bulk_.window(), INITIAL_WINDOW);
}

TEST_F(LaneTest, WindowShrinksWhenFramesWait)
{
  measureIdleLink();
  for (int round = 0; round < 100 && bulk_.window() > MIN_WINDOW; ++round)
  {
    const uint64_t before = bulk_.window();
    fill(&bulk_);
    lane_time += milliseconds(8);  // the queue on the way
    ASSERT_TRUE(acknowledge());
    EXPECT_LE(bulk_.window(), before);
    EXPECT_GE(bulk_.window(), std::max(MIN_WINDOW, before / 4)) << "a single late answer says little";
  }
  EXPECT_EQ(MIN_WINDOW, bulk_.window());
  EXPECT_EQ(8U << 10, bulk_.fragmentBytes());
  EXPECT_GE(bulk_.rtt(), milliseconds(1));
}

TEST_F(LaneTest, WindowStaysWhenProcessesWaitAndTheNetworkDoesNot)
{
  constexpr milliseconds IDLE(20);
  transport_.round_trip = IDLE;
  measureIdleLink();
  for (const auto& [queues, window] : {std::make_pair(milliseconds(0), INITIAL_WINDOW),
                                       std::make_pair(milliseconds(2), INITIAL_WINDOW / 2),
                                       std::make_pair(milliseconds(0), INITIAL_WINDOW / 2)})
  {
    transport_.round_trip = IDLE + queues;
    fill(&bulk_);
    lane_time += milliseconds(20);  // the other bridge waits for a core
    ASSERT_TRUE(acknowledge());
    EXPECT_NEAR(static_cast<double>(window), static_cast<double>(bulk_.window()), 1000.0);
  }
}

TEST_F(LaneTest, MeasuresTheIdleLinkWithASingleFrame)
{
  send(&bulk_);
  send(&bulk_);
  ASSERT_TRUE(acknowledge());  // from here on nothing is known that is not older than allowed
  EXPECT_EQ(1U, fill(&bulk_));
  send(&bulk_, 16);
  EXPECT_NE(0U, transport_.sent.back().header.lane & ACK_NOW) << "every frame is to be answered at once";
  EXPECT_FALSE(bulk_.ready());
  ASSERT_TRUE(bulk_.onAck(bulk_sent_ - 1));
  EXPECT_FALSE(bulk_.ready()) << "the link is not empty yet";
  ASSERT_TRUE(acknowledge());
  EXPECT_EQ(1U, fill(&bulk_)) << "the last one was not alone";
  ASSERT_TRUE(acknowledge());
  EXPECT_LT(1U, fill(&bulk_));
}

TEST_F(LaneTest, MeasuresTheIdleLinkAnewAfterAWhile)
{
  measureIdleLink();
  fill(&bulk_);
  ASSERT_TRUE(acknowledge());
  EXPECT_LT(1U, fill(&bulk_));
  lane_time += milliseconds(5050);  // the age at which the last measurement counts no more
  ASSERT_TRUE(acknowledge());
  EXPECT_EQ(1U, fill(&bulk_));
  ASSERT_TRUE(acknowledge());
  EXPECT_LT(1U, fill(&bulk_));
}

TEST_F(LaneTest, ExpressDependsOnNothingThatBulkDoes)
{
  measureIdleLink();
  for (int round = 0; round < 100 && bulk_.window() > MIN_WINDOW; ++round)
  {
    fill(&bulk_);
    lane_time += milliseconds(8);
    ASSERT_TRUE(acknowledge());
  }
  fill(&bulk_);
  EXPECT_FALSE(bulk_.ready());
  fill(&express_);
  EXPECT_GE(express_.unackedBytes(), EXPRESS_WINDOW);
  EXPECT_LT(express_.unackedBytes(), EXPRESS_WINDOW + CHUNK + FrameHeader::BYTES);
  lane_time += milliseconds(8);
  ASSERT_TRUE(express_.onAck(1));
  EXPECT_TRUE(express_.ready()) << "late answers do not slow it down";
  fill(&express_);
  ASSERT_TRUE(express_.onAck(express_sent_));
  EXPECT_LT(1U, fill(&express_)) << "and nothing is measured with it";
  EXPECT_EQ(16U << 10, express_.fragmentBytes());
}

TEST_F(LaneTest, RefusesAcknowledgementsThatCannotBe)
{
  EXPECT_FALSE(bulk_.onAck(1));
  send(&bulk_);
  send(&bulk_);
  EXPECT_FALSE(bulk_.onAck(3));
  EXPECT_FALSE(bulk_.onAck(~uint64_t{0}));
  EXPECT_EQ(2 * (CHUNK + FrameHeader::BYTES), bulk_.unackedBytes());
  EXPECT_TRUE(bulk_.onAck(2));
  EXPECT_TRUE(bulk_.onAck(2)) << "nothing new";
  EXPECT_FALSE(bulk_.onAck(1)) << "older than the last one";
  EXPECT_FALSE(bulk_.onAck(3));
}

TEST_F(LaneTest, KeepsThePayloadUntilItIsAcknowledged)
{
  FrameHeader header;
  header.type = FrameType::FRAGMENT;
  std::vector<std::weak_ptr<const int>> kept;
  std::vector<int> told;
  for (int number = 0; number < 4; ++number)
  {
    const auto keep = std::make_shared<const int>(number);
    kept.push_back(keep);
    Lane::Acknowledged acknowledged;
    if (number != 1)
    {
      acknowledged = [&told, &kept, number]()
      {
        told.push_back(number);
        EXPECT_FALSE(kept[static_cast<size_t>(number)].expired()) << "still there while it is acknowledged";
      };
    }
    ASSERT_TRUE(express_.send(header, nullptr, 0, keep, acknowledged));
  }
  ASSERT_TRUE(express_.onAck(0));
  EXPECT_FALSE(kept[0].expired());
  ASSERT_TRUE(express_.onAck(3));
  EXPECT_EQ((std::vector<int>{0, 2}), told);
  EXPECT_TRUE(kept[0].expired() && kept[1].expired() && kept[2].expired());
  EXPECT_FALSE(kept[3].expired());
  ASSERT_TRUE(express_.onAck(4));
  EXPECT_TRUE(kept[3].expired());
}

TEST_F(LaneTest, MaySendWhileItIsBeingAcknowledged)
{
  FrameHeader header;
  header.type = FrameType::FRAGMENT;
  int left = 5;
  Lane::Acknowledged again = [&]()
  {
    if (--left > 0)
    {
      EXPECT_TRUE(bulk_.send(header, nullptr, 0, nullptr, again));
    }
  };
  ASSERT_TRUE(bulk_.send(header, nullptr, 0, nullptr, again));
  for (uint64_t frames = 1; frames <= 5; ++frames)
  {
    ASSERT_TRUE(bulk_.onAck(frames));
  }
  EXPECT_EQ(0, left);
  EXPECT_EQ(0U, bulk_.unackedBytes());
}

TEST_F(LaneTest, ResetForgetsWhatIsUnderWay)
{
  FrameHeader header;
  header.type = FrameType::FRAGMENT;
  auto keep = std::make_shared<const int>(0);
  const std::weak_ptr<const int> kept = keep;
  ASSERT_TRUE(bulk_.send(header, nullptr, 0, std::move(keep), nullptr));
  fill(&bulk_);
  bulk_.reset();
  EXPECT_TRUE(kept.expired());
  EXPECT_EQ(0U, bulk_.connection());
  EXPECT_FALSE(bulk_.connected());
  EXPECT_FALSE(bulk_.ready());
  EXPECT_EQ(0U, bulk_.unackedBytes());
  EXPECT_EQ(INITIAL_WINDOW, bulk_.window());

  connect(&bulk_);
  EXPECT_TRUE(bulk_.ready());
  EXPECT_FALSE(bulk_.onAck(1)) << "of the connection before";
  bulk_sent_ = 0;
  send(&bulk_);
  EXPECT_TRUE(bulk_.onAck(1)) << "frames are counted anew";
}

TEST_F(LaneTest, ResetAcknowledgesNothing)
{
  FrameHeader header;
  header.type = FrameType::FRAGMENT;
  bool told = false;
  ASSERT_TRUE(bulk_.send(header, nullptr, 0, nullptr, [&told]() { told = true; }));
  bulk_.reset();
  EXPECT_FALSE(told);
}

}  // namespace
}  // namespace pi_os_transport
