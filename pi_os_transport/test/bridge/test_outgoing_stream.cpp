#include "bridge/outgoing_stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "bridge/incoming_stream.h"
#include "shm/ring_pair.h"
#include "wire/fake_frame_transport.h"

namespace pi_os_transport
{
namespace
{

using Frame = FakeFrameTransport::Frame;
using std::chrono::milliseconds;

constexpr size_t SMALL = 16 << 10;

std::vector<LinkEntry> entriesIn(const Frame& frame)
{
  PayloadReader in(frame.payload.data(), frame.payload.size());
  std::vector<LinkEntry> entries;
  for (uint32_t index = 0; index < (frame.header.count & ~COMPRESSED); ++index)
  {
    entries.push_back(LinkEntry::read(&in));
  }
  EXPECT_TRUE(in.ok());
  return entries;
}

std::vector<uint32_t> linksIn(const Frame& frame)
{
  std::vector<uint32_t> links;
  for (const LinkEntry& entry : entriesIn(frame))
  {
    links.push_back(entry.link);
  }
  return links;
}

/// The message that a MESSAGE frame carries.
Bytes bytesIn(const Frame& frame)
{
  const size_t start = entriesIn(frame).size() * LinkEntry::BYTES;
  return Bytes(frame.payload.begin() + static_cast<std::ptrdiff_t>(start), frame.payload.end());
}

std::vector<FrameType> typesOf(const std::vector<Frame>& frames)
{
  std::vector<FrameType> types;
  for (const Frame& frame : frames)
  {
    types.push_back(frame.header.type);
  }
  return types;
}

class OutgoingStreamTest : public ::testing::Test
{
protected:
  static constexpr uint32_t MAX_MESSAGE = 4 << 20;

  struct Publisher
  {
    explicit Publisher(SlotPool* pool) : pair(pool) {}
    RingPair pair;
    std::shared_ptr<OutgoingLink> link;
  };

  void SetUp() override { session_.meet(); }
  void TearDown() override
  {
    stream_.reset();
    publishers_.clear();
    session_.peer.reset();
    EXPECT_EQ(0U, pool_.usage().live_slots);
  }

  void makeStream(const TopicOptions& options = {}, OutgoingStream::Compress compress = nullptr)
  {
    stream_ = std::make_shared<OutgoingStream>(STREAM, session_.peer.get(), &loop_, options, std::move(compress),
                                               "/topic", "/publisher", MAX_MESSAGE);
    stream_->on_link_done = [this](const std::shared_ptr<OutgoingLink>& link)
    {
      done_.push_back(link->id);
      stream_->remove(link);
    };
    stream_->on_too_large = [this](const std::shared_ptr<OutgoingLink>& link)
    {
      too_large_.push_back(link->id);
      link->state = OutgoingLink::State::CLOSING;
    };
    session_.on_interrupted = [this]() { stream_->rewind(); };
    session_.on_up = [this]() { session_.peer->offer(stream_); };
  }
  /// Adds a link that the publisher has not started yet.
  Publisher& add(uint32_t id)
  {
    publishers_[id] = std::make_unique<Publisher>(&pool_);
    Publisher& publisher = *publishers_[id];
    publisher.link = std::make_shared<OutgoingLink>(id, publisher.pair.receiver);
    publisher.link->state = OutgoingLink::State::CARRYING;
    stream_->add(publisher.link);
    return publisher;
  }
  /// Adds links and lets them start.
  void start(const std::vector<uint32_t>& ids, size_t max_queue = 0, bool latched = false)
  {
    for (const uint32_t id : ids)
    {
      ASSERT_TRUE(add(id).pair.sender->pushStart(max_queue, latched, 0));
    }
    pump();
    EXPECT_EQ(ids.size(), session_.takeAll().size());
  }
  void push(uint32_t id, const uint8_t* buffer, size_t length, uint64_t serial)
  {
    pool_.addReference(buffer);
    ASSERT_EQ(RingSender::Push::WRITTEN,
              publishers_.at(id)->pair.sender->push(buffer, static_cast<uint32_t>(length), 0, 0, serial));
  }
  void publish(const Bytes& bytes, const std::vector<uint32_t>& ids)
  {
    uint8_t* const buffer = poolMessage(&pool_, bytes);
    ++serial_;
    for (const uint32_t id : ids)
    {
      push(id, buffer, bytes.size(), serial_);
    }
    pool_.release(buffer);
  }
  void pump()
  {
    session_.peer->offer(stream_);
    session_.peer->pump();
  }
  std::vector<Frame> publishAndTake(const Bytes& bytes, const std::vector<uint32_t>& ids)
  {
    publish(bytes, ids);
    pump();
    return session_.take();
  }
  void acknowledgeAll() { session_.acknowledgeAll(); }
  uint32_t liveSlots()
  {
    for (const auto& publisher : publishers_)
    {
      publisher.second->pair.sender->collect();
    }
    return pool_.usage().live_slots;
  }
  /// The messages in frames, whole or in fragments.
  static std::vector<Bytes> messagesIn(const std::vector<Frame>& frames)
  {
    std::vector<Bytes> messages;
    for (const Frame& frame : frames)
    {
      if (frame.header.type == FrameType::MESSAGE)
      {
        messages.push_back(bytesIn(frame));
      }
      else if (frame.header.type == FrameType::BEGIN)
      {
        messages.emplace_back();
      }
      else if (frame.header.type == FrameType::FRAGMENT)
      {
        EXPECT_EQ(frame.header.offset, messages.back().size());
        messages.back().insert(messages.back().end(), frame.payload.begin(), frame.payload.end());
      }
    }
    return messages;
  }

  static constexpr uint32_t STREAM = 77;
  EventLoop loop_;
  SlotPool pool_{256 << 20};
  FakeSession session_{&loop_};
  std::map<uint32_t, std::unique_ptr<Publisher>> publishers_;
  std::shared_ptr<OutgoingStream> stream_;
  uint64_t serial_ = 0;
  std::vector<uint32_t> done_;
  std::vector<uint32_t> too_large_;
};

TEST_F(OutgoingStreamTest, TellsTheStartBeforeTheFirstMessage)
{
  makeStream();
  RingPair& pair = add(1).pair;
  ASSERT_TRUE(pair.sender->pushStart(7, true, 5));
  const std::vector<Frame> frames = publishAndTake({1}, {1});
  ASSERT_EQ((std::vector<FrameType>{FrameType::LINK_START, FrameType::MESSAGE}), typesOf(frames));
  EXPECT_EQ(1U, frames[0].header.id);
  EXPECT_EQ(5U, frames[0].header.count);
  EXPECT_EQ(7U, frames[0].header.offset);
  EXPECT_EQ(STREAM, frames[1].header.id);
  EXPECT_EQ(session_.other_secret, frames[1].header.session);
  EXPECT_TRUE(publishers_.at(1)->link->latched);
  EXPECT_EQ(2U, publishers_.at(1)->link->unacked);
  acknowledgeAll();
  EXPECT_EQ(0U, publishers_.at(1)->link->unacked);
}

TEST_F(OutgoingStreamTest, SendsOneFrameForSeveralLinks)
{
  makeStream();
  start({1, 2, 3});
  const Bytes bytes = patternOf(1, 1000);
  std::vector<Frame> frames = publishAndTake(bytes, {1, 2, 3});
  ASSERT_EQ(1U, frames.size());
  EXPECT_EQ((std::vector<uint32_t>{1, 2, 3}), linksIn(frames[0]));
  EXPECT_EQ(bytes, bytesIn(frames[0]));
  EXPECT_EQ(bytes.size(), frames[0].header.offset);
  frames = publishAndTake({2}, {2, 3});
  ASSERT_EQ(1U, frames.size());
  const std::vector<LinkEntry> entries = entriesIn(frames[0]);
  ASSERT_EQ(2U, entries.size());
  EXPECT_EQ(2U, entries[0].link);
  EXPECT_EQ(2U, entries[0].sequence);
  frames = publishAndTake({3}, {1});
  EXPECT_EQ(2U, entriesIn(frames[0])[0].sequence) << "each link counts for itself";
  EXPECT_EQ(3U, stream_->counters().messages);
  EXPECT_EQ(1002U, stream_->counters().bytes);
}

TEST_F(OutgoingStreamTest, SendsEmptyMessages)
{
  makeStream();
  start({1, 2});
  const std::vector<Frame> frames = publishAndTake({}, {1, 2});
  ASSERT_EQ(1U, frames.size());
  EXPECT_EQ((std::vector<uint32_t>{1, 2}), linksIn(frames[0]));
  EXPECT_EQ(Bytes(), bytesIn(frames[0]));
  acknowledgeAll();
  EXPECT_EQ(0U, liveSlots());
}

TEST_F(OutgoingStreamTest, AttachesALinkWhoseCopyComesLater)
{
  makeStream();
  start({1, 2});
  for (const size_t size : {size_t{10}, size_t{200000}})
  {
    const Bytes bytes = patternOf(1, size);
    uint8_t* const buffer = poolMessage(&pool_, bytes);
    ++serial_;
    push(1, buffer, size, serial_);
    pump();
    EXPECT_EQ(std::vector<Bytes>{bytes}, messagesIn(session_.takeAll()));
    push(2, buffer, size, serial_);
    pool_.release(buffer);
    pump();
    const std::vector<Frame> frames = session_.takeAll();
    ASSERT_EQ(std::vector<FrameType>{FrameType::ATTACH}, typesOf(frames));
    EXPECT_EQ(std::vector<uint32_t>{2}, linksIn(frames[0]));
    EXPECT_EQ(STREAM, frames[0].header.id);
  }
  EXPECT_EQ(2U, stream_->counters().messages);
  EXPECT_EQ(0U, liveSlots());
}

TEST_F(OutgoingStreamTest, AttachesOnlyToTheLastMessage)
{
  makeStream();
  start({1, 2});
  uint8_t* const buffer = poolMessage(&pool_, {1});
  push(1, buffer, 1, 1001);
  serial_ = 1001;
  publish({2}, {1});
  push(2, buffer, 1, 1001);
  pool_.release(buffer);
  pump();
  const std::vector<Frame> frames = session_.takeAll();
  EXPECT_EQ((std::vector<Bytes>{{1}, {2}}), messagesIn(frames));
  EXPECT_EQ((std::vector<uint32_t>{1, 2}), linksIn(frames[0]));
  uint8_t* const late = poolMessage(&pool_, {2});
  push(2, late, 1, 1001);  // not the last one any more: goes again
  pool_.release(late);
  pump();
  EXPECT_EQ(std::vector<FrameType>{FrameType::MESSAGE}, typesOf(session_.takeAll()));
}

TEST_F(OutgoingStreamTest, MessagesWithoutASerialHaveNothingInCommon)
{
  makeStream();
  start({1, 2});
  uint8_t* const buffer = poolMessage(&pool_, {1});
  push(1, buffer, 1, 0);
  push(2, buffer, 1, 0);
  pool_.release(buffer);
  pump();
  EXPECT_EQ((std::vector<FrameType>{FrameType::MESSAGE, FrameType::MESSAGE}), typesOf(session_.takeAll()));
}

TEST_F(OutgoingStreamTest, SmallMessagesStayUntilTheyAreAcknowledged)
{
  makeStream();
  start({1, 2});
  EXPECT_EQ(1U, publishAndTake(patternOf(1, SMALL), {1, 2}).size());
  EXPECT_EQ(1U, liveSlots());
  EXPECT_EQ(1U, publishers_.at(1)->link->unacked);
  acknowledgeAll();
  EXPECT_EQ(0U, liveSlots());
}

TEST_F(OutgoingStreamTest, WhatArrivedAtAPausedLinkStaysUntilTheSubscriberHasIt)
{
  makeStream();
  start({1, 2});
  publishAndTake({1}, {1, 2});
  OutgoingLink& link = *publishers_.at(1)->link;
  link.paused = true;
  acknowledgeAll();
  EXPECT_EQ(1U, liveSlots());
  EXPECT_EQ(0U, link.unacked);
  link.paused = false;
  link.onResumed();
  EXPECT_EQ(0U, liveSlots());
}

TEST_F(OutgoingStreamTest, ThePublisherTakesBackWhatHasNotArrived)
{
  makeStream();
  start({1});
  publishAndTake({1}, {1});
  acknowledgeAll();
  publishAndTake({2}, {1});
  publishAndTake(patternOf(3, SMALL + 1), {1});
  stream_->abandon();
  const std::vector<RingSender::Message> back = publishers_.at(1)->pair.sender->takeBackTaken();
  ASSERT_EQ(2U, back.size());
  EXPECT_EQ(1U, back[0].length);
  EXPECT_EQ(SMALL + 1, back[1].length);
  for (const RingSender::Message& message : back)
  {
    pool_.release(message.buffer);
  }
}

TEST_F(OutgoingStreamTest, LargeMessagesStayUntilTheyAreAcknowledged)
{
  makeStream();
  start({1, 2});
  const Bytes bytes = patternOf(1, SMALL + 1);
  EXPECT_EQ(std::vector<Bytes>{bytes}, messagesIn(publishAndTake(bytes, {1, 2})));
  EXPECT_EQ(1U, liveSlots());
  session_.acknowledge(Traffic::BULK, 1);
  EXPECT_EQ(1U, liveSlots()) << "only its first frame has arrived";
  session_.acknowledge(Traffic::BULK, 1);
  EXPECT_EQ(0U, liveSlots());
  EXPECT_TRUE(stream_->idle());
}

TEST_F(OutgoingStreamTest, SendsLargeMessagesInFragments)
{
  makeStream();
  start({1});
  const Bytes bytes = patternOf(3, 2000001);
  publish(bytes, {1});
  pump();
  std::vector<Frame> frames = session_.takeAll();
  ASSERT_LT(2U, frames.size());
  EXPECT_EQ(FrameType::BEGIN, frames[0].header.type);
  EXPECT_EQ(bytes.size(), frames[0].header.offset);
  EXPECT_EQ(std::vector<uint32_t>{1}, linksIn(frames[0]));
  for (size_t index = 1; index < frames.size(); ++index)
  {
    EXPECT_EQ(FrameType::FRAGMENT, frames[index].header.type);
    EXPECT_EQ(Traffic::BULK, session_.trafficOf(frames[index]));
    EXPECT_GT(frames[index].payload.size(), 0U);
  }
  EXPECT_LE(frames[1].payload.size(), 32U << 10);
  EXPECT_EQ(std::vector<Bytes>{bytes}, messagesIn(frames));
}

TEST_F(OutgoingStreamTest, FollowsTheWindow)
{
  makeStream();
  start({1});
  publish(patternOf(3, 4 << 20), {1});
  pump();
  const Lane& bulk = session_.peer->lane(Traffic::BULK);
  EXPECT_FALSE(bulk.ready());
  EXPECT_LT(bulk.unackedBytes(), bulk.window() + MAX_PAYLOAD);
  EXPECT_GT(messagesIn(session_.takeAll())[0].size(), 0U);
}

TEST_F(OutgoingStreamTest, KeepsTheOrderBetweenExpressAndBulk)
{
  makeStream();
  start({1});
  const Bytes large = patternOf(1, 20000);
  EXPECT_EQ(1U, publishAndTake({1}, {1}).size());
  EXPECT_EQ(0U, publishAndTake(large, {1}).size()) << "what went as EXPRESS has to arrive first";
  EXPECT_EQ(0U, publishAndTake({2}, {1}).size());
  session_.acknowledge(Traffic::EXPRESS);
  std::vector<Frame> frames = session_.take();
  ASSERT_EQ((std::vector<FrameType>{FrameType::BEGIN, FrameType::FRAGMENT, FrameType::MESSAGE}), typesOf(frames));
  for (const Frame& frame : frames)
  {
    EXPECT_EQ(Traffic::BULK, session_.trafficOf(frame)) << "a small one after it does not wait, but goes behind it";
  }
  EXPECT_EQ((std::vector<Bytes>{large, {2}}), messagesIn(frames));
  acknowledgeAll();
  frames = publishAndTake({3}, {1});
  ASSERT_EQ(1U, frames.size());
  EXPECT_EQ(Traffic::EXPRESS, session_.trafficOf(frames[0])) << "nothing is under way any more";
}

TEST_F(OutgoingStreamTest, PrioritiesChooseTheTraffic)
{
  const Bytes large = patternOf(1, 100000);
  for (const auto& [priority, traffic] : {std::make_pair(TopicOptions::Priority::HIGH, Traffic::EXPRESS),
                                          std::make_pair(TopicOptions::Priority::LOW, Traffic::BULK)})
  {
    TopicOptions options;
    options.priority = priority;
    makeStream(options);
    start({1});
    publish({1}, {1});
    publish(large, {1});
    pump();
    const std::vector<Frame> frames = session_.takeAll();
    EXPECT_EQ((std::vector<Bytes>{{1}, large}), messagesIn(frames));
    for (const Frame& frame : frames)
    {
      EXPECT_EQ(traffic, session_.trafficOf(frame));
    }
  }
}

TEST_F(OutgoingStreamTest, RewindSendsWhatIsNotAcknowledgedAgainInOrder)
{
  makeStream();
  start({1, 2});
  const Bytes large = patternOf(1, 300000);
  publishAndTake({1}, {1, 2});
  acknowledgeAll();
  publishAndTake({2}, {1, 2});
  publishAndTake({3}, {2});
  publishAndTake(large, {1});
  session_.interrupt();
  session_.meet();
  std::vector<Frame> frames = session_.take();  // meet() has taken what went at once
  EXPECT_EQ(0U, frames.size());
  session_.interrupt();
  ASSERT_NO_FATAL_FAILURE(session_.connect());
  ASSERT_TRUE(session_.greet());
  frames = session_.takeAll();
  EXPECT_EQ((std::vector<Bytes>{{2}, {3}, large}), messagesIn(frames));
  EXPECT_EQ((std::vector<uint32_t>{1, 2}), linksIn(frames[0]));
  EXPECT_EQ(2U, entriesIn(frames[0])[0].sequence) << "the same as before, so that the peer knows it";
  for (const Frame& frame : frames)
  {
    EXPECT_EQ(session_.other_secret, frame.header.session);
  }
  acknowledgeAll();
  EXPECT_EQ(0U, liveSlots());
}

TEST_F(OutgoingStreamTest, RewindBeginsAnInterruptedMessageAnew)
{
  makeStream();
  start({1});
  const Bytes large = patternOf(1, 3 << 20);
  publish(large, {1});
  pump();
  session_.take();
  session_.acknowledge(Traffic::BULK, 3);
  session_.interrupt();
  ASSERT_NO_FATAL_FAILURE(session_.connect());
  ASSERT_TRUE(session_.greet());
  const std::vector<Frame> frames = session_.takeAll();
  EXPECT_EQ(FrameType::BEGIN, frames[0].header.type);
  EXPECT_EQ(std::vector<Bytes>{large}, messagesIn(frames));
}

TEST_F(OutgoingStreamTest, RewindDropsTheOldestBeyondTheQueueAndASocket)
{
  makeStream();
  start({1}, 1);
  start({2}, 0);
  const Bytes large = patternOf(1, 2 * SOCKET_BYTES);
  publishAndTake(large, {1, 2});
  publish({6}, {1});  // still in the ring: has the newest place in the queue
  EXPECT_EQ(2U, liveSlots());
  session_.interrupt();
  EXPECT_EQ(1U, stream_->counters().superseded);
  ASSERT_NO_FATAL_FAILURE(session_.connect());
  ASSERT_TRUE(session_.greet());
  const std::vector<Frame> frames = session_.takeAll();
  EXPECT_EQ((std::vector<Bytes>{large, {6}}), messagesIn(frames));
  EXPECT_EQ(std::vector<uint32_t>{2}, linksIn(frames[0]));
  acknowledgeAll();
  EXPECT_EQ(0U, liveSlots());
  EXPECT_EQ(0U, publishers_.at(1)->link->unacked);
}

TEST_F(OutgoingStreamTest, RewindKeepsWhatASocketWouldHold)
{
  makeStream();
  start({1}, 1);
  std::vector<Bytes> messages;
  for (uint32_t number = 0; number < 200; ++number)
  {
    messages.push_back(patternOf(number, 1000));
    publishAndTake(messages.back(), {1});
  }
  session_.interrupt();
  EXPECT_EQ(0U, stream_->counters().superseded);
  ASSERT_NO_FATAL_FAILURE(session_.connect());
  ASSERT_TRUE(session_.greet());
  EXPECT_EQ(messages, messagesIn(session_.takeAll()));
}

TEST_F(OutgoingStreamTest, RewindReleasesWhatItDrops)
{
  makeStream();
  start({1}, 1);
  publishAndTake(patternOf(1, 2 * SOCKET_BYTES), {1});
  publish({6}, {1});
  EXPECT_EQ(2U, liveSlots());
  session_.interrupt();
  EXPECT_EQ(1U, liveSlots());
}

TEST_F(OutgoingStreamTest, RewindMakesMessagesOfAttachments)
{
  makeStream();
  start({1, 2});
  uint8_t* const buffer = poolMessage(&pool_, patternOf(1, 50000));
  push(1, buffer, 50000, 1001);
  pump();
  session_.takeAll();
  push(2, buffer, 50000, 1001);
  pool_.release(buffer);
  pump();
  ASSERT_EQ(std::vector<FrameType>{FrameType::ATTACH}, typesOf(session_.take()));
  session_.interrupt();
  ASSERT_NO_FATAL_FAILURE(session_.connect());
  ASSERT_TRUE(session_.greet());
  const std::vector<Frame> frames = session_.takeAll();
  EXPECT_EQ(std::vector<uint32_t>{2}, linksIn(frames[0]));
  EXPECT_EQ(std::vector<Bytes>{patternOf(1, 50000)}, messagesIn(frames));
}

TEST_F(OutgoingStreamTest, TellsTheStartAgainAfterAnInterruption)
{
  makeStream();
  ASSERT_TRUE(add(1).pair.sender->pushStart(1, false, 0));
  publishAndTake({1}, {1});
  session_.interrupt();
  ASSERT_NO_FATAL_FAILURE(session_.connect());
  ASSERT_TRUE(session_.greet());
  EXPECT_EQ((std::vector<FrameType>{FrameType::LINK_START, FrameType::MESSAGE}), typesOf(session_.takeAll()));
}

TEST_F(OutgoingStreamTest, AbandonCountsWhatNobodyCanSendAgain)
{
  makeStream();
  start({1});
  publishAndTake({1}, {1});
  acknowledgeAll();
  publishAndTake({2}, {1});
  publishAndTake({3}, {1});
  publishers_.at(1)->link->publisher_gone = true;
  stream_->abandon();
  EXPECT_EQ(2U, stream_->counters().lost);
  EXPECT_TRUE(stream_->idle());
}

TEST_F(OutgoingStreamTest, APausedLinkKeepsItsMessages)
{
  makeStream();
  start({1, 2});
  publishers_.at(1)->link->paused = true;
  std::vector<Frame> frames = publishAndTake({1}, {1, 2});
  ASSERT_EQ(1U, frames.size());
  EXPECT_EQ(std::vector<uint32_t>{2}, linksIn(frames[0]));
  publish({2}, {1, 2});
  pump();
  session_.takeAll();
  publishers_.at(1)->link->paused = false;
  pump();
  frames = session_.takeAll();
  for (const Frame& frame : frames)
  {
    EXPECT_EQ(std::vector<uint32_t>{1}, linksIn(frame));
  }
  EXPECT_EQ((std::vector<Bytes>{{1}, {2}}), messagesIn(frames));
}

TEST_F(OutgoingStreamTest, TellsWhenTheLastMessageOfALinkHasArrived)
{
  makeStream();
  start({1, 2});
  publish({1}, {1, 2});
  publish({2}, {1});
  pump();
  session_.take();
  publishers_.at(1)->link->publisher_gone = true;
  publishers_.at(2)->link->state = OutgoingLink::State::CLOSING;
  session_.acknowledge(Traffic::EXPRESS, 1);
  EXPECT_EQ(std::vector<uint32_t>{2}, done_);
  session_.acknowledge(Traffic::EXPRESS, 1);
  EXPECT_EQ((std::vector<uint32_t>{2, 1}), done_);
}

TEST_F(OutgoingStreamTest, APublisherThatEndedIsReadToTheEnd)
{
  makeStream();
  start({1});
  publish({1}, {1});
  publishers_.at(1)->link->publisher_gone = true;
  EXPECT_FALSE(publishers_.at(1)->link->isDone());
  pump();
  EXPECT_EQ((std::vector<Bytes>{{1}}), messagesIn(session_.takeAll()));
  EXPECT_EQ(std::vector<uint32_t>{1}, done_);
}

TEST_F(OutgoingStreamTest, HandsTooLargeMessagesBack)
{
  makeStream();
  start({1, 2});
  publish(Bytes(MAX_MESSAGE + 1), {1});
  publish({2}, {2});
  pump();
  EXPECT_EQ(std::vector<uint32_t>{1}, too_large_);
  EXPECT_EQ((std::vector<Bytes>{{2}}), messagesIn(session_.takeAll()));
  EXPECT_EQ(1U, publishers_.at(1)->pair.sender->untaken());
}

TEST_F(OutgoingStreamTest, KeepLatestSendsOnlyTheNewest)
{
  TopicOptions options;
  options.keep_latest = true;
  makeStream(options);
  start({1});
  for (uint8_t number = 1; number <= 5; ++number)
  {
    publish({number}, {1});
  }
  pump();
  EXPECT_EQ((std::vector<Bytes>{{5}}), messagesIn(session_.takeAll()));
  EXPECT_EQ(4U, stream_->counters().superseded);
  EXPECT_EQ(0U, liveSlots());
}

TEST_F(OutgoingStreamTest, RateLimitDropsWhatComesTooEarly)
{
  TopicOptions options;
  options.rate_limit_hz = 0.001;
  makeStream(options);
  start({1, 2});
  for (uint8_t number = 1; number <= 6; ++number)
  {
    publish({number}, {1, 2});
  }
  pump();
  const std::vector<Bytes> sent = messagesIn(session_.takeAll());
  EXPECT_LE(sent.size(), 2U);
  EXPECT_EQ((Bytes{1}), sent[0]);
  EXPECT_EQ(6U, sent.size() + stream_->counters().rate_limited);
  EXPECT_EQ(0U, liveSlots());
}

/// After a pause one message may leave, not two.
TEST_F(OutgoingStreamTest, RateLimitHoldsFromTheFirstMessageOn)
{
  TopicOptions options;
  options.rate_limit_hz = 0.001;
  makeStream(options);
  start({1});
  publish({1}, {1});
  publish({2}, {1});
  pump();
  EXPECT_EQ((std::vector<Bytes>{{1}}), messagesIn(session_.takeAll()));
}

TEST_F(OutgoingStreamTest, RateLimitSendsTheLatestOfALatchedTopicWhenItIsDue)
{
  TopicOptions options;
  options.rate_limit_hz = 20;
  makeStream(options);
  start({1}, 0, true);
  for (uint8_t number = 1; number <= 4; ++number)
  {
    publish({number}, {1});
  }
  pump();
  EXPECT_GE(2U, messagesIn(session_.takeAll()).size());
  std::vector<Frame> frames;
  ASSERT_TRUE(runUntil(&loop_,
                       [&]()
                       {
                         frames = session_.takeAll();
                         return !frames.empty();
                       }));
  EXPECT_EQ((std::vector<Bytes>{{4}}), messagesIn(frames));
}

TEST_F(OutgoingStreamTest, TellsThePublisherOnceThatThereIsPlace)
{
  makeStream();
  start({1});
  RingPair& pair = publishers_.at(1)->pair;
  const auto spaces = [&pair]()
  {
    EXPECT_TRUE(pair.ends.sending->receive());
    const std::vector<Packet> packets = std::exchange(pair.sending_link->packets, {});
    return static_cast<size_t>(std::count_if(packets.begin(), packets.end(),
                                             [](const Packet& packet) { return packet.type == Packet::SPACE; }));
  };
  session_.transport.capacity = 1;
  for (int number = 0; number < 200; ++number)
  {
    publish({1}, {1});
  }
  publishers_.at(1)->link->onPublisherWaits();
  EXPECT_EQ(0U, spaces()) << "there is none yet";
  session_.transport.capacity = 1000;
  pump();
  session_.takeAll();
  EXPECT_EQ(1U, spaces());
  publish({1}, {1});
  pump();
  session_.takeAll();
  EXPECT_EQ(0U, spaces()) << "it did not ask again";
}

/// Plays the codec: what is to be compressed waits until the test answers.
struct Codec
{
  OutgoingStream::Compress compress()
  {
    return [this](const uint8_t* bytes, size_t length, OutgoingStream::Compressed done)
    {
      requests.emplace_back(Bytes(bytes, bytes + length), std::move(done));
      return true;
    };
  }
  void answer(const Bytes& bytes)
  {
    const auto request = std::move(requests.front());
    requests.erase(requests.begin());
    request.second(bytes);
  }
  std::vector<std::pair<Bytes, OutgoingStream::Compressed>> requests;
};

TEST_F(OutgoingStreamTest, SendsCompressedMessages)
{
  Codec codec;
  makeStream({}, codec.compress());
  start({1});
  const Bytes image = patternOf(1, 100000);
  EXPECT_EQ(0U, publishAndTake(image, {1}).size());
  EXPECT_EQ(0U, publishAndTake({2}, {1}).size()) << "one after the other";
  ASSERT_EQ(1U, codec.requests.size());
  EXPECT_EQ(image, codec.requests[0].first);
  codec.answer({7, 8});
  std::vector<Frame> frames = session_.takeAll();
  ASSERT_EQ(1U, frames.size());
  EXPECT_EQ(COMPRESSED | 1, frames[0].header.count);
  EXPECT_EQ((Bytes{7, 8}), bytesIn(frames[0]));
  pump();
  ASSERT_EQ(1U, codec.requests.size());
  codec.answer({});
  frames = session_.takeAll();
  ASSERT_EQ(1U, frames.size());
  EXPECT_EQ(1U, frames[0].header.count);
  EXPECT_EQ((Bytes{2}), bytesIn(frames[0]));
  EXPECT_EQ(1U, stream_->counters().uncompressed);
  EXPECT_EQ(0U, liveSlots());
}

TEST_F(OutgoingStreamTest, CompressionMayEndAfterTheStream)
{
  Codec codec;
  makeStream({}, codec.compress());
  start({1});
  publishAndTake({1}, {1});
  stream_->abandon();
  codec.answer({1});
  EXPECT_EQ(0U, session_.take().size());
  makeStream({}, codec.compress());
  start({2});
  publishAndTake({1}, {2});
  stream_.reset();
  codec.answer({1});
  codec.requests.clear();
  makeStream();
}

/// What is compressed while the session is interrupted must not overtake what has to be sent again.
TEST_F(OutgoingStreamTest, CompressionThatEndsWhileInterruptedKeepsTheOrder)
{
  Codec codec;
  makeStream({}, codec.compress());
  start({1});
  publishAndTake({1}, {1});
  codec.answer({11});
  ASSERT_EQ(1U, session_.take().size());
  EXPECT_EQ(0U, publishAndTake({2}, {1}).size());
  session_.interrupt();  // the first one is not acknowledged, the second one is at the codec
  codec.answer({22});
  ASSERT_NO_FATAL_FAILURE(session_.connect());
  ASSERT_TRUE(session_.greet());
  EXPECT_EQ((std::vector<Bytes>{{11}, {22}}), messagesIn(session_.takeAll()));
}

/// What the codec returns must not take the place of a message that waits for the other traffic class.
TEST_F(OutgoingStreamTest, CompressionThatEndsAfterAnInterruptionLosesNothing)
{
  Codec codec;
  makeStream({}, codec.compress());
  start({1});
  const Bytes large = patternOf(1, 50000);
  size_t frames_of_first = 0;
  for (const Bytes& compressed : {large, Bytes{22}, large})
  {
    publishAndTake({1}, {1});
    codec.answer(compressed);
    const size_t frames = session_.take().size();
    frames_of_first = frames_of_first == 0 ? frames : frames_of_first;
  }
  publishAndTake({1}, {1});
  session_.acknowledge(Traffic::BULK, frames_of_first);
  session_.interrupt();  // the second and the third one are to be sent again, the fourth one is at the codec
  ASSERT_NO_FATAL_FAILURE(session_.connect());
  ASSERT_TRUE(session_.greet());  // the third one waits for the second one, which goes as EXPRESS now
  codec.answer({44});
  EXPECT_EQ((std::vector<Bytes>{{22}, large, {44}}), messagesIn(session_.takeAll()));
  EXPECT_EQ(0U, liveSlots());
  EXPECT_EQ(0U, publishers_.at(1)->link->unacked);
}

/// A link that carries only messages of one fragment must not be held to one of them per round trip for ever.
TEST_F(OutgoingStreamTest, MessagesOfOneFragmentFillTheWindowToo)
{
  makeStream();
  start({1});
  const Bytes bytes = patternOf(1, 20000);
  size_t most_under_way = 0;
  for (int round = 0; round < 50; ++round)
  {
    while (publishers_.at(1)->pair.sender->untaken() < 10)
    {
      publish(bytes, {1});
    }
    pump();
    most_under_way = std::max(most_under_way, round < 10 ? 0 : messagesIn(session_.take()).size());
    session_.take();
    acknowledgeAll();
  }
  session_.takeAll();
  EXPECT_LT(1U, most_under_way) << "messages of " << bytes.size() << " bytes in a window of "
                                << session_.peer->lane(Traffic::BULK).window() << " bytes";
}

/// Both ends of a stream, and a link between them that breaks at any place.
TEST_F(OutgoingStreamTest, ArrivesOnceAndInOrderWhateverIsInterrupted)
{
  std::mt19937 random(20260801);
  FakeLink wires(&loop_);
  SlotPool pool(64 << 20);
  const auto outgoing = std::make_shared<OutgoingStream>(STREAM, wires.sides[0].peer.get(), &loop_, TopicOptions(),
                                                         nullptr, "/topic", "/publisher", MAX_MESSAGE);
  outgoing->on_link_done = [](const std::shared_ptr<OutgoingLink>&) {};
  std::map<uint32_t, std::shared_ptr<IncomingLink>> incoming;
  const auto stream = std::make_shared<IncomingStream>(
      &pool, MAX_MESSAGE, [&incoming](uint32_t id) { return incoming.at(id); }, nullptr);
  wires.handlers[1] = [&](const FrameHeader& header, const Bytes& payload)
  {
    const uint32_t length = static_cast<uint32_t>(payload.size());
    switch (header.type)
    {
      case FrameType::LINK_START:
        incoming.at(header.id)->start(header.offset, header.count);
        return true;
      case FrameType::MESSAGE:
        return stream->onMessage(header, payload.data(), length);
      case FrameType::BEGIN:
        return stream->onBegin(header, payload.data(), length);
      case FrameType::ATTACH:
        return stream->onAttach(header, payload.data(), length);
      case FrameType::FRAGMENT:
      {
        const std::shared_ptr<uint8_t> place = stream->fragmentMemory(header, length);
        if (place)
        {
          std::copy(payload.begin(), payload.end(), place.get());
        }
        return place != nullptr && stream->onFragment(header, length);
      }
      default:
        return false;
    }
  };
  wires.sides[0].on_interrupted = [&outgoing]() { outgoing->rewind(); };
  wires.sides[1].on_interrupted = [&stream]() { stream->interrupt(); };
  wires.sides[0].on_up = [&]() { wires.sides[0].peer->offer(outgoing); };
  wires.sides[0].transport.capacity = 5;

  constexpr uint32_t LINKS = 3;
  std::vector<std::unique_ptr<RingPair>> publishers;
  std::vector<std::unique_ptr<RingPair>> subscribers;
  std::vector<std::shared_ptr<OutgoingLink>> links;
  for (uint32_t id = 0; id < LINKS; ++id)
  {
    publishers.push_back(std::make_unique<RingPair>(&pool_));
    subscribers.push_back(std::make_unique<RingPair>(&pool));
    links.push_back(std::make_shared<OutgoingLink>(id, publishers[id]->receiver));
    links[id]->state = OutgoingLink::State::CARRYING;
    outgoing->add(links[id]);
    incoming[id] = std::make_shared<IncomingLink>(id, BridgeRequest(), nullptr);
    incoming[id]->ring = std::move(subscribers[id]->sender);
    incoming[id]->state = IncomingLink::State::CARRYING;
    incoming[id]->on_blocked = []() { ADD_FAILURE(); };
    ASSERT_TRUE(publishers[id]->sender->pushStart(0, false, 0));
  }
  std::vector<std::vector<Bytes>> sent(LINKS);
  std::vector<std::vector<Bytes>> received(LINKS);
  const auto receive = [&]()
  {
    for (uint32_t id = 0; id < LINKS; ++id)
    {
      for (Bytes& bytes : subscribers[id]->takeMessages())
      {
        received[id].push_back(std::move(bytes));
      }
    }
  };
  size_t interruptions = 0;
  ASSERT_NO_FATAL_FAILURE(wires.meet());
  for (uint32_t number = 1; number <= 400; ++number)
  {
    const bool large = random() % 3 == 0;
    const Bytes bytes = patternOf(number, random() % (large ? 150000 : 2000));
    uint8_t* const buffer = poolMessage(&pool_, bytes);
    for (uint32_t id = 0; id < LINKS; ++id)
    {
      if (random() % 4 == 0)
      {
        continue;
      }
      pool_.addReference(buffer);
      ASSERT_TRUE(runUntil(&loop_,
                           [&]()
                           {
                             const auto pushed = publishers[id]->sender->push(
                                 buffer, static_cast<uint32_t>(bytes.size()), 0, 0, number);
                             wires.carry(pushed == RingSender::Push::WRITTEN ? 0 : 50);
                             return pushed == RingSender::Push::WRITTEN;
                           }));
      sent[id].push_back(bytes);
      if (random() % 3 == 0)
      {
        // The bridge looks while the publisher is still at it.
        wires.sides[0].peer->offer(outgoing);
        wires.sides[0].peer->pump();
      }
    }
    pool_.release(buffer);
    wires.sides[0].peer->offer(outgoing);
    wires.sides[0].peer->pump();
    wires.carry(random() % 8);
    loop_.runOnce(milliseconds(0));
    receive();
    if (random() % 25 == 0)
    {
      ++interruptions;
      wires.interrupt();
      ASSERT_NO_FATAL_FAILURE(wires.meet());
    }
  }
  ASSERT_TRUE(runUntil(&loop_,
                       [&]()
                       {
                         wires.carry();
                         receive();
                         return outgoing->idle() &&
                                std::all_of(links.begin(), links.end(),
                                            [](const std::shared_ptr<OutgoingLink>& link)
                                            { return link->unacked == 0 && link->ring->ring().available() == 0; });
                       }));
  EXPECT_GT(interruptions, 5U);
  for (uint32_t id = 0; id < LINKS; ++id)
  {
    EXPECT_EQ(0U, incoming[id]->lost());
    ASSERT_EQ(sent[id].size(), received[id].size());
    EXPECT_TRUE(sent[id] == received[id]) << "link " << id;
    publishers[id]->sender->collect();
  }
  EXPECT_EQ(0U, pool_.usage().live_slots);
  wires.sides[0].on_interrupted = nullptr;
  makeStream();
}

}  // namespace
}  // namespace pi_os_transport
