#include <gtest/gtest.h>
#include "engine/local_queue.h"

#include <stdexcept>

namespace pi_offload
{
namespace
{

constexpr int64_t SECOND = 1000000000;
using Entries = std::vector<LocalQueue::Entry>;

LocalQueue::Entry entry(uint64_t task, int64_t deadline_ns = 100 * SECOND)
{
  return {task, static_cast<int64_t>(task) * SECOND, deadline_ns};
}

TEST(LocalQueue, GivesOnePictureAtATimeInTheirOrder)
{
  LocalQueue queue(4, 2.0);
  Entries dropped;
  EXPECT_FALSE(queue.next(0, 0.1, &dropped));
  EXPECT_FALSE(queue.add(entry(1)));
  EXPECT_FALSE(queue.add(entry(2)));
  EXPECT_EQ(1u, queue.next(0, 0.1, &dropped)->task);
  EXPECT_FALSE(queue.next(0, 0.1, &dropped));
  EXPECT_TRUE(queue.busy());
  const LocalQueue::Answer answer = queue.answered(1 * SECOND, SECOND / 4);
  EXPECT_TRUE(answer.expected);
  EXPECT_FALSE(answer.skipped);
  EXPECT_EQ(1u, answer.task);
  EXPECT_DOUBLE_EQ(0.25, answer.work_s);
  EXPECT_EQ(2u, queue.next(SECOND, 0.1, &dropped)->task);
  EXPECT_TRUE(dropped.empty());
}

TEST(LocalQueue, DropsTheOldestWhereTooManyWait)
{
  LocalQueue queue(2, 2.0);
  queue.add(entry(1));
  queue.add(entry(2));
  const auto dropped = queue.add(entry(3));
  ASSERT_TRUE(dropped);
  EXPECT_EQ(1u, dropped->task);
  EXPECT_EQ(2u, queue.waiting());
}

TEST(LocalQueue, DropsWhatWouldBeTooLateOnlyIfALaterOneWaits)
{
  LocalQueue queue(4, 2.0);
  Entries dropped;
  queue.add(entry(1, 1 * SECOND));
  queue.add(entry(2, 2 * SECOND));
  EXPECT_EQ(2u, queue.next(SECOND, 0.5, &dropped)->task);
  ASSERT_EQ(1u, dropped.size());
  EXPECT_EQ(1u, dropped[0].task);
  queue.answered(2 * SECOND, SECOND);
  queue.add(entry(3, 1 * SECOND));
  EXPECT_EQ(3u, queue.next(5 * SECOND, 0.5, &dropped)->task);  // late, but the only one
  EXPECT_EQ(1u, dropped.size());
}

TEST(LocalQueue, GivesUpAPictureThatIsNotAnswered)
{
  LocalQueue queue(4, 2.0);
  Entries dropped;
  queue.add(entry(1));
  queue.next(0, 0.1, &dropped);
  queue.add(entry(2));
  EXPECT_FALSE(queue.next(2 * SECOND, 0.1, &dropped));
  EXPECT_EQ(2u, queue.next(2 * SECOND + 1, 0.1, &dropped)->task);
  ASSERT_EQ(1u, dropped.size());
  EXPECT_EQ(1u, dropped[0].task);
  EXPECT_FALSE(queue.answered(1 * SECOND, 3 * SECOND).expected);  // late
  EXPECT_TRUE(queue.answered(2 * SECOND, 3 * SECOND).expected);
  EXPECT_FALSE(queue.answered(2 * SECOND, 3 * SECOND).expected);  // twice
}

TEST(LocalQueue, NoticesThatTheDetectorLeftAPictureOut)
{
  LocalQueue queue(4, 2.0);
  Entries dropped;
  queue.add(entry(1));
  queue.next(0, 0.1, &dropped);
  const LocalQueue::Answer answer = queue.answered(7 * SECOND, SECOND);
  EXPECT_TRUE(answer.expected);
  EXPECT_TRUE(answer.skipped);
  EXPECT_EQ(1u, answer.task);
  EXPECT_FALSE(queue.busy());
}

TEST(LocalQueue, ForgetsWhatWaitsAndGivesUpWhatIsAtWork)
{
  LocalQueue queue(4, 2.0);
  Entries dropped;
  queue.add(entry(1));
  queue.add(entry(2));
  queue.add(entry(3));
  queue.next(0, 0.1, &dropped);
  EXPECT_FALSE(queue.forget(1));
  EXPECT_TRUE(queue.forget(2));
  EXPECT_FALSE(queue.forget(2));
  EXPECT_FALSE(queue.giveUp(3));
  EXPECT_TRUE(queue.giveUp(1));
  EXPECT_FALSE(queue.busy());
  EXPECT_EQ(3u, queue.next(0, 0.1, &dropped)->task);
  queue.add(entry(4));
  const Entries all = queue.clear();
  ASSERT_EQ(2u, all.size());
  EXPECT_EQ(3u, all[0].task);
  EXPECT_EQ(4u, all[1].task);
  EXPECT_FALSE(queue.busy());
  EXPECT_EQ(0u, queue.waiting());
}

TEST(LocalQueue, RefusesBoundsThatCannotBe)
{
  EXPECT_THROW(LocalQueue(0, 2.0), std::invalid_argument);
  EXPECT_THROW(LocalQueue(1, 0.0), std::invalid_argument);
}

}  // namespace
}  // namespace pi_offload
