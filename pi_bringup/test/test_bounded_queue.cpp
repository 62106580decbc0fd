#include <gtest/gtest.h>
#include <pi_bringup/bounded_queue.h>

#include <memory>
#include <stdexcept>
#include <thread>

using pi_bringup::BoundedQueue;

TEST(BoundedQueue, RefusesACapacityOfZero)
{
  EXPECT_THROW(BoundedQueue<int>(0), std::invalid_argument);
}

TEST(BoundedQueue, HandsOutInOrderAndNeverHoldsMoreThanItsCapacity)
{
  BoundedQueue<int> queue(3);
  std::thread producer(
      [&queue]
      {
        for (int i = 0; i < 1000; ++i)
        {
          queue.push(i);
        }
        queue.close();
      });
  int expected = 0;
  while (const std::optional<int> item = queue.pop())
  {
    EXPECT_EQ(expected++, *item);
    EXPECT_LE(queue.size(), 3U);
  }
  producer.join();
  EXPECT_EQ(1000, expected);
}

TEST(BoundedQueue, CloseReleasesAProducerThatWaitsForRoom)
{
  BoundedQueue<int> queue(1);
  ASSERT_TRUE(queue.push(1));
  bool accepted = true;
  std::thread producer([&] { accepted = queue.push(2); });
  queue.close();
  producer.join();
  EXPECT_FALSE(accepted);
  EXPECT_EQ(1, queue.pop().value());
  EXPECT_FALSE(queue.pop());
}

TEST(BoundedQueue, CloseReleasesAConsumerThatWaits)
{
  BoundedQueue<std::unique_ptr<int>> queue(1);
  std::optional<std::unique_ptr<int>> item(nullptr);
  std::thread consumer([&] { item = queue.pop(); });
  queue.close();
  consumer.join();
  EXPECT_FALSE(item);
  EXPECT_FALSE(queue.push(nullptr));
}
