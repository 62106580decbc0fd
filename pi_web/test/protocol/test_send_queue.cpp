#include "protocol/send_queue.h"

#include <gtest/gtest.h>

namespace pi_web
{
namespace
{

constexpr int64_t MS = 1000000;

OutMessage small(const std::string& text)
{
  return {text, nullptr, false};
}

OutMessage large(const std::string& text, size_t bytes = 1000000)
{
  return {text, std::make_shared<Bytes>(bytes), false};
}

/// Sends all that may go now; their heads in order.
std::string drain(SendQueue* queue, int64_t now_ns, int64_t took_ns = 0)
{
  std::string sent;
  while (const auto message = queue->next(now_ns))
  {
    sent += message->head;
    now_ns += took_ns;
    queue->sent(now_ns);
  }
  return sent;
}

TEST(SendQueue, SendsAnswersThenSmallOnesThenLargeOnes)
{
  SendQueue queue;
  queue.push(1, large("L"), 1);
  queue.push(2, small("a"), 10);
  queue.push(3, small("b"), 10);
  queue.push(2, small("c"), 10);
  EXPECT_TRUE(queue.pushAnswer(small("!")));
  EXPECT_EQ("!abcL", drain(&queue, 0));
  EXPECT_EQ(0u, queue.bytes());
  EXPECT_EQ(0u, queue.dropped());
}

TEST(SendQueue, KeepsTheNewestOfALane)
{
  SendQueue queue;
  for (const char* text : {"1", "2", "3", "4"})
  {
    queue.push(1, small(text), 2);
    queue.push(2, large(text), 5);  // a large one is alone
  }
  EXPECT_EQ("344", drain(&queue, 0));
  EXPECT_EQ(5u, queue.dropped());
}

TEST(SendQueue, BoundsTheBytesOfALane)
{
  SendQueue queue;
  for (int i = 0; i < 1000; ++i)
  {
    queue.push(1, {"x", std::make_shared<Bytes>(10000), false}, 10000);
  }
  EXPECT_LE(queue.bytes(), SendQueue::MAX_LANE_BYTES);
  queue.remove(1);
  EXPECT_EQ(0u, queue.bytes());
  EXPECT_TRUE(queue.isTaken(1));
}

TEST(SendQueue, ALargeOneWaitsAsLongAsTheOneBeforeTook)
{
  SendQueue queue;
  queue.push(1, large("A"), 1);
  ASSERT_EQ("A", queue.next(0)->head);
  EXPECT_FALSE(queue.isTaken(1));
  queue.push(1, large("B"), 1);
  EXPECT_FALSE(queue.next(10 * MS));  // one is under way
  EXPECT_FALSE(queue.readyAt());
  queue.sent(40 * MS);
  EXPECT_EQ("", drain(&queue, 41 * MS));
  EXPECT_EQ(80 * MS, queue.readyAt());
  queue.push(2, small("s"), 1);
  EXPECT_EQ("s", drain(&queue, 42 * MS));
  EXPECT_EQ("B", drain(&queue, 80 * MS));
  EXPECT_TRUE(queue.isTaken(1));
  EXPECT_FALSE(queue.readyAt());
}

TEST(SendQueue, RefusesAnswersThatNobodyReads)
{
  SendQueue queue;
  bool taken = true;
  for (int i = 0; i < 20 && taken; ++i)
  {
    taken = queue.pushAnswer(large("!"));
  }
  EXPECT_FALSE(taken);
}

}  // namespace
}  // namespace pi_web
