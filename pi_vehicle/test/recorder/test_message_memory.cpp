#include "recorder/message_memory.h"

#include <gtest/gtest.h>

namespace pi_vehicle::recorder
{
namespace
{

constexpr int64_t MEMORY_SECOND = 1000000000;

std::shared_ptr<const Channel> channel(const std::string& topic, bool latching = false)
{
  return std::make_shared<const Channel>(Channel{topic, {{"latching", latching ? "1" : "0"}, {"callerid", "/node"}}});
}

KeptMessagePtr message(const std::shared_ptr<const Channel>& channel, int64_t elapsed_ns, size_t bytes = 100)
{
  auto kept = std::make_shared<KeptMessage>();
  kept->channel = channel;
  kept->stamp_ns = kept->elapsed_ns = elapsed_ns;
  kept->bytes.resize(bytes);
  return kept;
}

TEST(MessageMemory, ForgetsByTimeWhatNobodyReads)
{
  MessageMemory memory(1000000, 60 * MEMORY_SECOND);
  const auto topic = channel("/a");
  for (int64_t second = 0; second < 100; ++second)
  {
    memory.add(message(topic, second * MEMORY_SECOND));
  }
  EXPECT_EQ(61u, memory.usage().messages);
  EXPECT_EQ(0u, memory.usage().forgotten);
  EXPECT_NEAR(60.0, memory.usage().seconds, 1e-9);
  memory.advance(200 * MEMORY_SECOND);
  EXPECT_EQ(0u, memory.usage().messages);
  EXPECT_EQ(0u, memory.usage().bytes);
}

TEST(MessageMemory, NeverHoldsMoreBytesThanAllowed)
{
  constexpr size_t most = 10000;
  MessageMemory memory(most, 60 * MEMORY_SECOND);
  const auto topic = channel("/a");
  const auto latched = channel("/b", true);
  memory.pin(0);  // also what a reader waits for goes
  for (int64_t i = 0; i < 1000; ++i)
  {
    memory.add(message(i % 7 == 0 ? latched : topic, i * MEMORY_SECOND / 1000, static_cast<size_t>(i % 13) * 50));
    ASSERT_LE(memory.usage().bytes, most);
  }
  EXPECT_GT(memory.usage().forgotten, 0u);
  EXPECT_GT(memory.usage().bytes, most / 2);
  const MessageMemory::Batch batch = memory.read(0, 1000);
  EXPECT_EQ(memory.usage().forgotten, batch.missed);
  EXPECT_TRUE(batch.at_end);
  EXPECT_EQ(999 * MEMORY_SECOND / 1000, batch.messages.back()->elapsed_ns) << "the oldest go first";
}

TEST(MessageMemory, AMessageLargerThanAllIsForgottenAtOnce)
{
  MessageMemory memory(1000, 60 * MEMORY_SECOND);
  memory.add(message(channel("/a", true), 0, 5000));
  EXPECT_EQ(0u, memory.usage().bytes);
  EXPECT_TRUE(memory.latched().empty());
}

TEST(MessageMemory, LatchedMessagesOfManyPublishersStayBounded)
{
  MessageMemory memory(10000, MEMORY_SECOND);
  for (int64_t i = 0; i < 1000; ++i)
  {
    memory.add(message(std::make_shared<const Channel>(
                           Channel{"/a", {{"latching", "1"}, {"callerid", "/anonymous_" + std::to_string(i)}}}),
                       i * MEMORY_SECOND));
  }
  EXPECT_LE(memory.usage().bytes, 10000u);
  EXPECT_FALSE(memory.latched().empty());
  EXPECT_EQ(999 * MEMORY_SECOND, memory.latched().back()->elapsed_ns);
}

TEST(MessageMemory, KeepsWhatAReaderNeeds)
{
  MessageMemory memory(1000000, 10 * MEMORY_SECOND);
  const auto topic = channel("/a");
  memory.pin(5);
  for (int64_t second = 0; second < 100; ++second)
  {
    memory.add(message(topic, second * MEMORY_SECOND));
  }
  const MessageMemory::Batch batch = memory.read(5, 3);
  ASSERT_EQ(3u, batch.messages.size());
  EXPECT_EQ(0u, batch.missed);
  EXPECT_EQ(5 * MEMORY_SECOND, batch.messages[0]->elapsed_ns);
  EXPECT_EQ(8u, batch.next);
  EXPECT_FALSE(batch.at_end);
}

TEST(MessageMemory, ReadsUpToATime)
{
  MessageMemory memory(1000000, 60 * MEMORY_SECOND);
  const auto topic = channel("/a");
  for (int64_t second = 0; second < 30; ++second)
  {
    memory.add(message(topic, second * MEMORY_SECOND));
  }
  const MessageMemory::Batch batch = memory.read(memory.firstSince(10 * MEMORY_SECOND), 1000, 20 * MEMORY_SECOND);
  ASSERT_EQ(11u, batch.messages.size());
  EXPECT_EQ(10 * MEMORY_SECOND, batch.messages.front()->elapsed_ns);
  EXPECT_TRUE(batch.at_end);
}

TEST(MessageMemory, KeepsTheLastLatchedMessageHoweverOld)
{
  MessageMemory memory(1000000, MEMORY_SECOND);
  const auto latched = channel("/tf_static", true);
  memory.add(message(latched, 1, 10));
  memory.add(message(latched, 2, 20));
  memory.advance(1000 * MEMORY_SECOND);
  EXPECT_EQ(0u, memory.usage().messages);
  ASSERT_EQ(1u, memory.latched().size());
  EXPECT_EQ(20u, memory.latched()[0]->bytes.size());
}

}  // namespace
}  // namespace pi_vehicle::recorder
