#include "bridge/incoming_stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "shm/ring_pair.h"

namespace pi_os_transport
{
namespace
{

using Bytes = std::vector<uint8_t>;

/// One frame of a stream, with a payload in memory of exactly its size.
struct StreamFrame
{
  FrameHeader header;
  Bytes payload;
};

Bytes entriesOf(const std::vector<LinkEntry>& entries)
{
  PayloadWriter out;
  for (const LinkEntry& entry : entries)
  {
    entry.append(&out);
  }
  return out.take();
}

StreamFrame messageOf(const std::vector<LinkEntry>& entries, const Bytes& bytes)
{
  StreamFrame frame;
  frame.header.type = FrameType::MESSAGE;
  frame.header.count = static_cast<uint32_t>(entries.size());
  frame.header.offset = bytes.size();
  frame.payload = entriesOf(entries);
  frame.payload.insert(frame.payload.end(), bytes.begin(), bytes.end());
  return frame;
}

StreamFrame beginOf(const std::vector<LinkEntry>& entries, size_t bytes)
{
  StreamFrame frame;
  frame.header.type = FrameType::BEGIN;
  frame.header.count = static_cast<uint32_t>(entries.size());
  frame.header.offset = bytes;
  frame.payload = entriesOf(entries);
  return frame;
}

StreamFrame fragmentOf(size_t offset, const Bytes& bytes)
{
  StreamFrame frame;
  frame.header.type = FrameType::FRAGMENT;
  frame.header.offset = offset;
  frame.payload = bytes;
  return frame;
}

StreamFrame attachOf(const std::vector<LinkEntry>& entries)
{
  StreamFrame frame;
  frame.header.type = FrameType::ATTACH;
  frame.header.count = static_cast<uint32_t>(entries.size());
  frame.payload = entriesOf(entries);
  return frame;
}

std::vector<StreamFrame> fragmentsOf(const std::vector<LinkEntry>& entries, const Bytes& bytes, size_t step)
{
  std::vector<StreamFrame> frames{beginOf(entries, bytes.size())};
  for (size_t at = 0; at < bytes.size(); at += step)
  {
    const size_t end = std::min(bytes.size(), at + step);
    frames.push_back(fragmentOf(
        at, Bytes(bytes.begin() + static_cast<std::ptrdiff_t>(at), bytes.begin() + static_cast<std::ptrdiff_t>(end))));
  }
  return frames;
}

class IncomingStreamTest : public ::testing::Test
{
protected:
  static constexpr uint32_t MAX_MESSAGE = 4 << 20;

  struct Subscriber
  {
    Subscriber(uint32_t id, SlotPool* pool)
      : link(std::make_shared<IncomingLink>(id, BridgeRequest(), nullptr)), pair(pool)
    {
    }
    std::shared_ptr<IncomingLink> link;
    RingPair pair;
    size_t blocked = 0;
  };

  void SetUp() override
  {
    makeStream(nullptr);
    for (const uint32_t id : {1U, 2U, 3U})
    {
      add(id);
    }
  }
  void TearDown() override
  {
    stream_.reset();
    subscribers_.clear();
    EXPECT_EQ(0U, pool_.usage().live_slots) << "memory of the pool is lost";
  }
  void makeStream(IncomingStream::Decompress decompress)
  {
    stream_ = std::make_shared<IncomingStream>(
        &pool_, MAX_MESSAGE,
        [this](uint32_t id)
        {
          const auto found = subscribers_.find(id);
          return found != subscribers_.end() ? found->second->link : nullptr;
        },
        std::move(decompress));
  }
  void add(uint32_t id, size_t max_queue = 0)
  {
    auto subscriber = std::make_unique<Subscriber>(id, &pool_);
    Subscriber* const raw = subscriber.get();
    raw->link->ring = std::move(raw->pair.sender);
    raw->link->state = IncomingLink::State::CARRYING;
    raw->link->on_blocked = [raw]() { ++raw->blocked; };
    raw->link->start(max_queue, 0);
    subscribers_[id] = std::move(subscriber);
  }
  IncomingLink& link(uint32_t id) { return *subscribers_.at(id)->link; }
  std::vector<Bytes> taken(uint32_t id) { return subscribers_.at(id)->pair.takeMessages(); }

  bool feed(const StreamFrame& frame)
  {
    // A place of exactly this size: the address sanitizer sees what is read beyond it.
    const auto bytes = std::make_unique<uint8_t[]>(frame.payload.size());
    std::copy(frame.payload.begin(), frame.payload.end(), bytes.get());
    const uint32_t length = static_cast<uint32_t>(frame.payload.size());
    switch (frame.header.type)
    {
      case FrameType::MESSAGE:
        return stream_->onMessage(frame.header, bytes.get(), length);
      case FrameType::BEGIN:
        return stream_->onBegin(frame.header, bytes.get(), length);
      case FrameType::ATTACH:
        return stream_->onAttach(frame.header, bytes.get(), length);
      default:
      {
        const std::shared_ptr<uint8_t> place = stream_->fragmentMemory(frame.header, length);
        if (!place)
        {
          EXPECT_FALSE(stream_->onFragment(frame.header, length));
          return false;
        }
        std::copy(frame.payload.begin(), frame.payload.end(), place.get());
        return stream_->onFragment(frame.header, length);
      }
    }
  }
  bool feedAll(const std::vector<StreamFrame>& frames)
  {
    return std::all_of(frames.begin(), frames.end(), [this](const StreamFrame& frame) { return feed(frame); });
  }

  SlotPool pool_{32 << 20};
  std::map<uint32_t, std::unique_ptr<Subscriber>> subscribers_;
  std::shared_ptr<IncomingStream> stream_;
};

TEST_F(IncomingStreamTest, HandsAMessageToAllThatItIsFor)
{
  const Bytes bytes = patternOf(1, 5000);
  ASSERT_TRUE(feed(messageOf({{1, 1, 0}, {3, 1, 0}}, bytes)));
  EXPECT_EQ(1U, pool_.usage().live_slots) << "once in memory, however many there are";
  EXPECT_EQ(std::vector<Bytes>{bytes}, taken(1));
  EXPECT_EQ(std::vector<Bytes>{}, taken(2));
  EXPECT_EQ(std::vector<Bytes>{bytes}, taken(3));
  EXPECT_EQ(1U, link(1).messages());
  EXPECT_EQ(5000U, link(1).bytes());
  EXPECT_EQ(0U, link(2).messages());
}

TEST_F(IncomingStreamTest, TakesEmptyMessages)
{
  ASSERT_TRUE(feed(messageOf({{1, 1, 0}}, {})));
  EXPECT_EQ(std::vector<Bytes>{Bytes()}, taken(1));
}

TEST_F(IncomingStreamTest, PassesTheTcpCountOn)
{
  ASSERT_TRUE(feed(messageOf({{1, 1, 77}}, {1})));
  ASSERT_TRUE(subscribers_.at(1)->pair.take());  // the start
  Descriptor descriptor;
  uint32_t index;
  ASSERT_TRUE(subscribers_.at(1)->pair.receiver->ring().peek(&descriptor, &index));
  EXPECT_EQ(77U, descriptor.after_tcp);
}

TEST_F(IncomingStreamTest, PutsFragmentsTogether)
{
  const Bytes bytes = patternOf(2, 1000001);
  for (const size_t step : {1000001U, 131072U, 33333U})
  {
    const uint32_t sequence = static_cast<uint32_t>(link(1).messages()) + 1;
    const std::vector<StreamFrame> frames = fragmentsOf({{1, sequence, 0}, {2, sequence, 0}}, bytes, step);
    for (const StreamFrame& frame : frames)
    {
      EXPECT_EQ(0U, taken(1).size());
      ASSERT_TRUE(feed(frame));
      EXPECT_EQ(&frame != &frames.back(), stream_->arriving());
    }
    EXPECT_EQ(std::vector<Bytes>{bytes}, taken(1));
    EXPECT_EQ(std::vector<Bytes>{bytes}, taken(2));
  }
}

TEST_F(IncomingStreamTest, AttachesFurtherLinksBeforeAndAfterTheMessageIsComplete)
{
  const Bytes bytes = patternOf(3, 50000);
  const std::vector<StreamFrame> frames = fragmentsOf({{1, 1, 0}}, bytes, 30000);
  ASSERT_EQ(3U, frames.size());
  ASSERT_TRUE(feed(frames[0]));
  ASSERT_TRUE(feed(frames[1]));
  ASSERT_TRUE(feed(attachOf({{2, 1, 0}})));
  EXPECT_EQ(0U, taken(2).size());
  ASSERT_TRUE(feed(frames[2]));
  ASSERT_TRUE(feed(attachOf({{3, 1, 0}})));
  for (const uint32_t id : {1U, 2U, 3U})
  {
    EXPECT_EQ(std::vector<Bytes>{bytes}, taken(id)) << id;
  }
  EXPECT_EQ(1U, pool_.usage().live_slots);
  ASSERT_TRUE(feed(messageOf({{1, 2, 0}}, {4})));
  ASSERT_TRUE(feed(attachOf({{2, 2, 0}})));
  EXPECT_EQ(std::vector<Bytes>{Bytes{4}}, taken(2));
}

TEST_F(IncomingStreamTest, PassesOverLinksThatHaveEnded)
{
  subscribers_.erase(1);
  ASSERT_TRUE(feed(messageOf({{1, 1, 0}, {2, 1, 0}, {99, 1, 0}}, {5})));
  EXPECT_EQ(std::vector<Bytes>{Bytes{5}}, taken(2));
}

TEST_F(IncomingStreamTest, NothingComesBeforeTheStart)
{
  auto fresh = std::make_shared<IncomingLink>(1, BridgeRequest(), nullptr);
  RingPair pair(&pool_);
  fresh->ring = std::move(pair.sender);
  fresh->state = IncomingLink::State::CARRYING;
  subscribers_.at(1)->link = fresh;
  ASSERT_TRUE(feed(messageOf({{1, 1, 0}}, {5})));
  EXPECT_FALSE(pair.take());
  fresh->start(7, 3);
  fresh->start(8, 4);  // again after an interruption
  const std::optional<RingPair::Taken> start = pair.take();
  ASSERT_TRUE(start);
  EXPECT_EQ(uint32_t{Descriptor::LINK_START}, start->descriptor.segment);
  EXPECT_EQ(7U, start->descriptor.length);
  EXPECT_EQ(3U, start->descriptor.after_tcp);
  EXPECT_FALSE(pair.take());
}

TEST_F(IncomingStreamTest, IgnoresWhatCameBeforeAndCountsGaps)
{
  ASSERT_TRUE(feed(messageOf({{1, 1, 0}, {2, 1, 0}}, {1})));
  ASSERT_TRUE(feed(messageOf({{1, 2, 0}}, {2})));
  ASSERT_TRUE(feed(messageOf({{1, 1, 0}, {2, 1, 0}}, {1})));  // after an interruption
  ASSERT_TRUE(feed(messageOf({{1, 2, 0}, {2, 2, 0}}, {2})));
  ASSERT_TRUE(feed(messageOf({{1, 6, 0}}, {6})));
  EXPECT_EQ((std::vector<Bytes>{{1}, {2}, {6}}), taken(1));
  EXPECT_EQ((std::vector<Bytes>{{1}, {2}}), taken(2));
  EXPECT_EQ(3U, link(1).lost());
  EXPECT_EQ(0U, link(2).lost());
}

TEST_F(IncomingStreamTest, SequenceNumbersMayWrapAround)
{
  // Steps as large as a number that is still newer allows.
  for (const uint32_t sequence : {0x7fffffffU, 0xfffffffeU, 0xffffffffU, 0U, 1U, 0xffffffffU})
  {
    ASSERT_TRUE(feed(messageOf({{1, sequence, 0}}, {static_cast<uint8_t>(sequence)})));
  }
  EXPECT_EQ((std::vector<Bytes>{{0xff}, {0xfe}, {0xff}, {0}, {1}}), taken(1));
}

TEST_F(IncomingStreamTest, AnInterruptedMessageComesAgainFromTheStart)
{
  const Bytes bytes = patternOf(4, 100000);
  const std::vector<StreamFrame> frames = fragmentsOf({{1, 1, 0}}, bytes, 40000);
  ASSERT_TRUE(feed(frames[0]));
  ASSERT_TRUE(feed(frames[1]));
  const std::shared_ptr<uint8_t> place = stream_->fragmentMemory(frames[2].header, 40000);
  ASSERT_TRUE(place);
  stream_->interrupt();
  EXPECT_FALSE(stream_->arriving());
  std::fill(place.get(), place.get() + 40000, uint8_t{0xee});  // what is being received still has its place
  EXPECT_FALSE(feed(frames[2]));
  EXPECT_FALSE(feed(attachOf({{2, 1, 0}}))) << "nothing to attach to any more";
  ASSERT_TRUE(feedAll(frames));
  EXPECT_EQ(std::vector<Bytes>{bytes}, taken(1));
  EXPECT_EQ(0U, link(1).lost());
}

TEST_F(IncomingStreamTest, RefusesWhatCannotBe)
{
  const auto refused = [this](StreamFrame frame, const std::function<void(StreamFrame*)>& change)
  {
    change(&frame);
    return !feed(frame);
  };
  const StreamFrame message = messageOf({{1, 1, 0}}, {1, 2, 3});
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->header.count = 0; }));
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->header.count = COMPRESSED; }));
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->header.count = 2; }))
      << "more entries than there are bytes";
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->header.count = 0x7fffffff; }));
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->header.count = 0x15555556; }))
      << "12 times this overflows";
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->header.offset = 2; }));
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->header.offset = ~uint64_t{0}; }));
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->payload.resize(11); }));
  EXPECT_TRUE(refused(message, [](StreamFrame* frame) { frame->payload.clear(); }));

  const StreamFrame begin = beginOf({{1, 1, 0}}, 100);
  EXPECT_TRUE(refused(begin, [](StreamFrame* frame) { frame->header.offset = 0; }));
  EXPECT_TRUE(refused(begin, [](StreamFrame* frame) { frame->header.offset = MAX_MESSAGE + 1; }));
  EXPECT_TRUE(refused(begin, [](StreamFrame* frame) { frame->header.offset = (uint64_t{1} << 32) + 100; }));
  EXPECT_TRUE(refused(begin, [](StreamFrame* frame) { frame->header.count = 0; }));
  EXPECT_TRUE(refused(begin, [](StreamFrame* frame) { frame->payload.push_back(0); }));
  EXPECT_TRUE(refused(begin, [](StreamFrame* frame) { frame->payload.pop_back(); }));

  EXPECT_TRUE(refused(attachOf({{1, 1, 0}}), [](StreamFrame*) {})) << "to nothing";
  EXPECT_TRUE(refused(fragmentOf(0, {1}), [](StreamFrame*) {})) << "of nothing";

  ASSERT_TRUE(feed(begin));
  EXPECT_TRUE(refused(begin, [](StreamFrame*) {})) << "another one is arriving";
  EXPECT_TRUE(refused(message, [](StreamFrame*) {}));
  EXPECT_TRUE(refused(fragmentOf(0, {}), [](StreamFrame*) {}));
  EXPECT_TRUE(refused(fragmentOf(1, {1}), [](StreamFrame*) {}));
  EXPECT_TRUE(refused(fragmentOf(0, Bytes(101)), [](StreamFrame*) {}));
  EXPECT_TRUE(refused(fragmentOf(uint64_t{1} << 32, {1}), [](StreamFrame*) {}));
  ASSERT_TRUE(feed(fragmentOf(0, Bytes(60))));
  EXPECT_TRUE(refused(fragmentOf(0, Bytes(60)), [](StreamFrame*) {})) << "came already";
  EXPECT_TRUE(refused(fragmentOf(60, Bytes(41)), [](StreamFrame*) {}));
  EXPECT_TRUE(refused(attachOf({{2, 1, 0}}), [](StreamFrame* frame) { frame->payload.push_back(0); }));
  EXPECT_TRUE(refused(attachOf({{2, 1, 0}}), [](StreamFrame* frame) { frame->header.count = 0; }));
  ASSERT_TRUE(feed(fragmentOf(60, Bytes(40)))) << "what was refused has changed nothing";
  EXPECT_EQ(std::vector<Bytes>{Bytes(100)}, taken(1));
}

TEST_F(IncomingStreamTest, MessagesWithoutMemoryAreLost)
{
  std::vector<uint8_t*> hog;
  for (size_t bytes = 16 << 20; bytes >= 512;)
  {
    uint8_t* const buffer = pool_.allocate(bytes);
    if (buffer == nullptr)
    {
      bytes /= 2;
      continue;
    }
    hog.push_back(buffer);
  }
  const Bytes large = patternOf(5, 100000);
  ASSERT_TRUE(feed(messageOf({{1, 1, 0}, {2, 1, 0}}, Bytes(3000))));
  ASSERT_TRUE(feedAll(fragmentsOf({{1, 2, 0}, {2, 2, 0}}, large, 30000))) << "the rest of the stream goes on";
  ASSERT_TRUE(feed(attachOf({{3, 1, 0}})));
  EXPECT_EQ(2U, link(1).lost());
  EXPECT_EQ(2U, link(2).lost());
  EXPECT_EQ(1U, link(3).lost());
  for (uint8_t* const buffer : hog)
  {
    pool_.release(buffer);
  }
  ASSERT_TRUE(feedAll(fragmentsOf({{1, 3, 0}}, large, 30000)));
  EXPECT_EQ(std::vector<Bytes>{large}, taken(1));
  EXPECT_EQ(2U, link(1).lost());
}

TEST_F(IncomingStreamTest, KeepsWhatABlockedSubscriberDoesNotTakeInOrder)
{
  constexpr uint32_t MESSAGES = RingLayout::CAPACITY + 100;
  for (uint32_t sequence = 1; sequence <= MESSAGES; ++sequence)
  {
    ASSERT_TRUE(feed(messageOf({{1, sequence, 0}, {2, sequence, 0}}, patternOf(sequence, 10))));
    EXPECT_EQ(1U, taken(2).size()) << "others go on";
  }
  EXPECT_TRUE(link(1).blocked());
  EXPECT_FALSE(link(2).blocked());
  EXPECT_EQ(MESSAGES + 1 - RingLayout::CAPACITY, subscribers_.at(1)->blocked);
  EXPECT_EQ(0U, subscribers_.at(2)->blocked);
  EXPECT_FALSE(link(1).flush());

  std::vector<Bytes> all = taken(1);
  EXPECT_EQ(RingLayout::CAPACITY - 1, all.size());
  EXPECT_TRUE(link(1).flush());
  EXPECT_FALSE(link(1).blocked());
  ASSERT_TRUE(feed(messageOf({{1, MESSAGES + 1, 0}}, patternOf(MESSAGES + 1, 10))));
  for (Bytes& bytes : taken(1))
  {
    all.push_back(std::move(bytes));
  }
  ASSERT_EQ(MESSAGES + 1, all.size());
  for (uint32_t sequence = 1; sequence <= MESSAGES + 1; ++sequence)
  {
    ASSERT_EQ(patternOf(sequence, 10), all[sequence - 1]);
  }
  EXPECT_EQ(0U, link(1).dropped());
}

TEST_F(IncomingStreamTest, DropsTheOldestForABlockedSubscriberBeyondItsQueueAndASocket)
{
  constexpr uint32_t QUEUE = 5;
  constexpr uint32_t IN_RING = RingLayout::CAPACITY - 1;  // the start has a place as well
  constexpr size_t BYTES = 2000;
  constexpr uint32_t KEPT = static_cast<uint32_t>(SOCKET_BYTES / BYTES) - IN_RING;
  constexpr uint32_t MESSAGES = IN_RING + KEPT + 20;
  subscribers_.erase(1);
  add(1, QUEUE);
  for (uint32_t sequence = 1; sequence <= MESSAGES; ++sequence)
  {
    ASSERT_TRUE(feed(messageOf({{1, sequence, 0}}, patternOf(sequence, BYTES))));
  }
  EXPECT_EQ(20U, link(1).dropped());
  EXPECT_EQ(IN_RING, taken(1).size());
  std::vector<Bytes> last;
  while (last.size() < KEPT)
  {
    link(1).flush();
    for (Bytes& bytes : taken(1))
    {
      last.push_back(std::move(bytes));
    }
  }
  ASSERT_EQ(KEPT, last.size());
  for (uint32_t index = 0; index < KEPT; ++index)
  {
    EXPECT_EQ(patternOf(MESSAGES - KEPT + 1 + index, BYTES), last[index]);
  }
  EXPECT_EQ(0U, link(1).lost());
}

TEST_F(IncomingStreamTest, BacklogIsBoundedWithoutAQueueToo)
{
  constexpr uint64_t BOUND = 32 << 20;
  constexpr uint32_t MESSAGES = BOUND / 256 + 3000;
  for (uint32_t sequence = 1; sequence <= MESSAGES; ++sequence)
  {
    ASSERT_TRUE(feed(messageOf({{1, sequence, 0}}, {1})));
  }
  EXPECT_EQ(MESSAGES - (RingLayout::CAPACITY - 1) - BOUND / 257, link(1).dropped());
}

TEST_F(IncomingStreamTest, CompressedMessagesKeepTheirOrder)
{
  std::vector<std::pair<Bytes, IncomingStream::Decompressed>> requests;
  makeStream(
      [&requests](const uint8_t* bytes, size_t length, IncomingStream::Decompressed done)
      {
        requests.emplace_back(Bytes(bytes, bytes + length), std::move(done));
        return true;
      });
  StreamFrame first = messageOf({{1, 1, 0}}, {1});
  first.header.count |= COMPRESSED;
  std::vector<StreamFrame> second = fragmentsOf({{1, 2, 0}}, {2, 3, 4}, 2);
  second.front().header.count |= COMPRESSED;
  ASSERT_TRUE(feed(first));
  ASSERT_TRUE(feedAll(second));
  ASSERT_TRUE(feed(attachOf({{2, 1, 0}})));
  ASSERT_TRUE(feed(messageOf({{1, 3, 0}}, {5})));
  ASSERT_EQ(1U, requests.size());  // one at a time
  EXPECT_EQ((Bytes{1}), requests[0].first);
  EXPECT_EQ(0U, taken(1).size());
  stream_->interrupt();  // what has come whole is not lost
  const IncomingStream::Decompressed first_done = requests[0].second;
  first_done({11});
  ASSERT_EQ(2U, requests.size());
  EXPECT_EQ((Bytes{2, 3, 4}), requests[1].first);
  EXPECT_EQ((std::vector<Bytes>{{11}}), taken(1));
  const IncomingStream::Decompressed second_done = requests[1].second;
  second_done({22});
  EXPECT_EQ((std::vector<Bytes>{{22}, {5}}), taken(1));
  EXPECT_EQ((std::vector<Bytes>{{22}}), taken(2));
  requests.clear();
}

TEST_F(IncomingStreamTest, CompressedMessagesThatCannotBeRestoredAreLost)
{
  bool busy = false;
  makeStream(
      [&busy](const uint8_t*, size_t, const IncomingStream::Decompressed& done)
      {
        if (!busy)
        {
          done({});
        }
        return !busy;
      });
  StreamFrame frame = messageOf({{1, 1, 0}}, {1});
  frame.header.count |= COMPRESSED;
  ASSERT_TRUE(feed(frame));
  busy = true;
  frame = messageOf({{1, 2, 0}}, {1});
  frame.header.count |= COMPRESSED;
  ASSERT_TRUE(feed(frame));
  EXPECT_EQ(2U, link(1).lost());
  ASSERT_TRUE(feed(messageOf({{1, 3, 0}}, {3})));
  EXPECT_EQ((std::vector<Bytes>{{3}}), taken(1));
}

TEST_F(IncomingStreamTest, AnswersOfTheDecompressorMayComeAfterTheEnd)
{
  IncomingStream::Decompressed late;
  makeStream(
      [&late](const uint8_t*, size_t, IncomingStream::Decompressed done)
      {
        late = std::move(done);
        return true;
      });
  StreamFrame frame = messageOf({{1, 1, 0}}, {1});
  frame.header.count |= COMPRESSED;
  ASSERT_TRUE(feed(frame));
  stream_.reset();
  late({1, 2, 3});
  EXPECT_EQ(0U, taken(1).size());
}

/// Whatever a peer says, memory and order stay intact. Meant to run under sanitizers as well.
TEST_F(IncomingStreamTest, OutlivesMutatedFrames)
{
  std::mt19937 random(8814);
  const auto below = [&random](size_t limit) { return static_cast<size_t>(random() % limit); };
  size_t accepted = 0;
  size_t refused = 0;
  for (int series = 0; series < 300; ++series)
  {
    std::vector<IncomingStream::Decompressed> decompressing;
    makeStream(
        [&](const uint8_t* bytes, size_t length, IncomingStream::Decompressed done)
        {
          if (below(3) == 0)
          {
            return false;
          }
          // Looks at all it was given.
          EXPECT_LE(std::count(bytes, bytes + length, 1), static_cast<std::ptrdiff_t>(length));
          decompressing.push_back(std::move(done));
          return true;
        });
    std::vector<StreamFrame> frames;
    for (uint32_t sequence = 1; sequence <= 8; ++sequence)
    {
      std::vector<LinkEntry> entries;
      for (uint32_t id = 1; id <= 1 + below(4); ++id)
      {
        entries.push_back({id, sequence + static_cast<uint32_t>(series) * 8, 0});
      }
      const Bytes bytes = patternOf(sequence, below(3000) + 1);
      const uint32_t compressed = below(4) == 0 ? COMPRESSED : 0;
      std::vector<StreamFrame> more = below(2) == 0 ? std::vector<StreamFrame>{messageOf(entries, bytes)}
                                                    : fragmentsOf(entries, bytes, below(2000) + 1);
      more.front().header.count |= compressed;
      frames.insert(frames.end(), more.begin(), more.end());
      if (below(3) == 0)
      {
        frames.push_back(attachOf({{4 - static_cast<uint32_t>(below(4)), sequence, 0}}));
      }
    }
    for (size_t changes = below(6) + 1; changes > 0; --changes)
    {
      StreamFrame& frame = frames[below(frames.size())];
      const uint64_t odd[] = {
          0,       1, 0x7fffffff, 0x80000000, 0xffffffff, ~uint64_t{0}, uint64_t{1} << 32, MAX_MESSAGE, MAX_MESSAGE + 1,
          random()};
      switch (below(8))
      {
        case 0:
          frame.header.offset = odd[below(10)];
          break;
        case 1:
          frame.header.count = static_cast<uint32_t>(odd[below(10)]);
          break;
        case 2:
          frame.header.offset += below(2) == 0 ? 1 : ~uint64_t{0};
          break;
        case 3:
          frame.payload.resize(below(frame.payload.size() + 20));
          break;
        case 4:
          if (!frame.payload.empty())
          {
            frame.payload[below(frame.payload.size())] ^= static_cast<uint8_t>(1 << below(8));
          }
          break;
        case 5:
          frame.header.type = std::vector<FrameType>{FrameType::MESSAGE, FrameType::BEGIN, FrameType::FRAGMENT,
                                                     FrameType::ATTACH}[below(4)];
          break;
        case 6:
          std::swap(frame, frames[below(frames.size())]);
          break;
        default:
        {
          const StreamFrame again = frame;
          frames.insert(frames.begin() + static_cast<std::ptrdiff_t>(below(frames.size())), again);
        }
      }
    }
    for (const StreamFrame& frame : frames)
    {
      const bool fine = feed(frame);
      ++(fine ? accepted : refused);
      if (!fine && below(2) == 0)
      {
        stream_->interrupt();  // as a bridge does that ends the connection
      }
      if (!decompressing.empty() && below(3) == 0)
      {
        const size_t which = below(decompressing.size());
        const IncomingStream::Decompressed done = std::move(decompressing[which]);
        decompressing.erase(decompressing.begin() + static_cast<std::ptrdiff_t>(which));
        done(Bytes(below(200)));
      }
    }
    for (const uint32_t id : {1U, 2U, 3U})
    {
      if (below(2) == 0)
      {
        taken(id);
        link(id).flush();
      }
    }
  }
  EXPECT_GT(accepted, 1000U);
  EXPECT_GT(refused, 500U);
  // A new stream carries on as if nothing had been.
  makeStream(nullptr);
  subscribers_.erase(1);
  add(1);
  ASSERT_TRUE(feed(messageOf({{1, 1, 0}}, {1, 2, 3})));
  EXPECT_EQ((std::vector<Bytes>{{1, 2, 3}}), taken(1));
}

}  // namespace
}  // namespace pi_os_transport
