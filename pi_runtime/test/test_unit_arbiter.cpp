#include "units/unit_arbiter.h"

#include <gtest/gtest.h>

#include <random>
#include <thread>
#include <vector>

#include "forked_users.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;
using UnitArbiterTest = UnitTest;

TEST_F(UnitArbiterTest, AFreeUnitGoesToWhoeverAsks)
{
  UnitArbiter arbiter(KEY, folder_);
  EXPECT_FALSE(arbiter.held());
  EXPECT_TRUE(arbiter.tryAcquire());
  EXPECT_TRUE(arbiter.held());
  arbiter.release();
  EXPECT_TRUE(arbiter.acquire(NONE, 0, 0s));
  EXPECT_TRUE(arbiter.held());
  EXPECT_FALSE(arbiter.contended());
}

TEST_F(UnitArbiterTest, ATakenUnitIsRefused)
{
  UnitArbiter holder(KEY, folder_);
  UnitArbiter other(KEY, folder_);
  ASSERT_TRUE(holder.tryAcquire());
  EXPECT_FALSE(holder.tryAcquire());
  EXPECT_FALSE(other.tryAcquire());
  EXPECT_FALSE(other.acquire(1, 0, 20ms));
  EXPECT_FALSE(holder.contended()) << "the wait that timed out still counts";
  holder.release();
  EXPECT_TRUE(other.tryAcquire());
  EXPECT_FALSE(holder.acquire(1, 0, -1s)) << "a negative time is none";
}

TEST_F(UnitArbiterTest, ReleasingWhatIsNotHeldIsAnError)
{
  UnitArbiter holder(KEY, folder_);
  UnitArbiter other(KEY, folder_);
  EXPECT_THROW(holder.release(), std::logic_error);
  ASSERT_TRUE(holder.tryAcquire());
  EXPECT_THROW(other.release(), std::logic_error);
  EXPECT_TRUE(holder.held());
}

TEST_F(UnitArbiterTest, OneProcessAtATimeUnderStress)
{
  struct Counters
  {
    volatile int inside = 0;
    volatile int intruders = 0;
    volatile long rounds = 0;
  };
  Shared<Counters> counters;
  constexpr long ROUNDS = 3000;
  std::vector<std::unique_ptr<Child>> children;
  for (unsigned seed = 1; seed <= 4; ++seed)
  {
    children.push_back(std::make_unique<Child>(
        [&, seed](Child& test)
        {
          UnitArbiter arbiter(KEY, folder_);
          std::mt19937 random(seed);
          test.hear();
          for (long round = 0; round < ROUNDS; ++round)
          {
            while (!arbiter.tryAcquire() && !arbiter.acquire(static_cast<int64_t>(random() % 4), 0, 1ms))
            {
            }
            counters->inside = counters->inside + 1;
            counters->intruders = counters->intruders + (counters->inside != 1);
            counters->rounds = counters->rounds + 1;
            if (random() % 8 == 0)
            {
              sched_yield();
            }
            counters->inside = counters->inside - 1;
            arbiter.release();
          }
          test.say('d');
        }));
  }
  for (auto& child : children)
  {
    child->say('g');
  }
  for (auto& child : children)
  {
    EXPECT_EQ('d', child->hear());
    EXPECT_EQ(0, child->reap());
  }
  EXPECT_EQ(0, counters->intruders);
  EXPECT_EQ(4 * ROUNDS, counters->rounds);
}

TEST_F(UnitArbiterTest, GoesByDeadlineThenPriorityThenWait)
{
  struct Request
  {
    int64_t deadline_ns;
    int priority;
    size_t rank;
  };
  const Request requests[] = {{NONE, 5, 4}, {300, 0, 2}, {NONE, 5, 5}, {100, -9, 0}, {NONE, 7, 3}, {200, 0, 1}};
  UnitArbiter holder(KEY, folder_);
  ASSERT_TRUE(holder.tryAcquire());
  std::vector<std::unique_ptr<Child>> children;
  std::vector<Child*> order(std::size(requests));
  for (const Request& request : requests)
  {
    children.push_back(startUser(request.deadline_ns, request.priority));
    order[request.rank] = children.back().get();
    ASSERT_TRUE(becomesTrue([&] { return holder.waiters() == children.size(); }));
  }
  EXPECT_EQ(100, holder.nextDeadline());
  holder.release();
  for (size_t rank = 0; rank < order.size(); ++rank)
  {
    ASSERT_EQ('h', order[rank]->hear());
    EXPECT_EQ(order.size() - rank - 1, holder.waiters()) << "somebody else was let in as well";
    EXPECT_FALSE(holder.tryAcquire());
    order[rank]->say('g');
    ASSERT_EQ('r', order[rank]->hear());
  }
  EXPECT_TRUE(holder.tryAcquire());
}

TEST_F(UnitArbiterTest, AChangedDeadlineChangesTheOrder)
{
  UnitArbiter holder(KEY, folder_);
  ASSERT_TRUE(holder.tryAcquire());
  const auto early = startUser(100);
  Child changing(
      [this](Child& test)
      {
        UnitArbiter arbiter(KEY, folder_);
        std::thread changer(
            [&]
            {
              test.hear();
              test.say(arbiter.updateWaiting(50, 0) ? 'u' : 'n');
            });
        arbiter.acquire(NONE, 0, LONG);
        test.say('h');
        changer.join();
        arbiter.release();
      });
  ASSERT_TRUE(becomesTrue([&] { return holder.waiters() == 2; }));
  EXPECT_EQ(100, holder.nextDeadline());
  changing.say('c');
  EXPECT_EQ('u', changing.hear());
  EXPECT_EQ(50, holder.nextDeadline());
  holder.release();
  EXPECT_EQ('h', changing.hear());
  EXPECT_EQ('h', early->hear());
  EXPECT_FALSE(holder.updateWaiting(1, 0)) << "nothing of this process waits";
}

TEST_F(UnitArbiterTest, AWaitCanBeCancelled)
{
  UnitArbiter holder(KEY, folder_);
  UnitArbiter other(KEY, folder_);
  ASSERT_TRUE(holder.tryAcquire());
  std::thread canceller(
      [&]
      {
        EXPECT_TRUE(becomesTrue([&] { return holder.contended(); }));
        other.cancelWait();
      });
  EXPECT_FALSE(other.acquire(NONE, 0, std::chrono::nanoseconds::max()));
  canceller.join();
  EXPECT_FALSE(holder.contended());
  holder.release();
  EXPECT_TRUE(other.acquire(NONE, 0, 0s)) << "the cancellation was not spent";
}

TEST_F(UnitArbiterTest, ACancellationJustBeforeTheWaitIsNotLost)
{
  UnitArbiter holder(KEY, folder_);
  UnitArbiter other(KEY, folder_);
  ASSERT_TRUE(holder.tryAcquire());
  other.cancelWait();
  EXPECT_FALSE(other.acquire(NONE, 0, std::chrono::nanoseconds::max()));
}

TEST_F(UnitArbiterTest, AThreadWaitsForAnotherOfItsProcess)
{
  UnitArbiter arbiter(KEY, folder_);
  ASSERT_TRUE(arbiter.tryAcquire());
  std::thread waiter([&] { EXPECT_TRUE(arbiter.acquire(NONE, 0, LONG)); });
  ASSERT_TRUE(becomesTrue([&] { return arbiter.updateWaiting(1, 0); }));
  EXPECT_THROW(arbiter.acquire(NONE, 0, 0s), std::logic_error) << "a second thread must not wait";
  EXPECT_FALSE(arbiter.contended()) << "only other processes count";
  arbiter.release();
  waiter.join();
  EXPECT_TRUE(arbiter.held());
}

TEST_F(UnitArbiterTest, AKilledHolderPassesTheUnitOn)
{
  UnitArbiter observer(KEY, folder_);
  for (int round = 0; round < 50; ++round)
  {
    const auto holder = startUser();
    ASSERT_EQ('h', holder->hear());
    const auto late = startUser(200);
    const auto early = startUser(100);
    ASSERT_TRUE(becomesTrue([&] { return observer.waiters() == 2; }));
    holder->killAndLeaveZombie();
    ASSERT_EQ('h', early->hear());
    early->say('g');
    ASSERT_EQ('h', late->hear());
  }
}

TEST_F(UnitArbiterTest, AKilledWaiterIsPassedOver)
{
  UnitArbiter holder(KEY, folder_);
  ASSERT_TRUE(holder.tryAcquire());
  for (int round = 0; round < 50; ++round)
  {
    const auto best = startUser(1);
    const auto second = startUser(2);
    ASSERT_TRUE(becomesTrue([&] { return holder.waiters() == 2; }));
    best->killAndLeaveZombie();
    EXPECT_EQ(2, holder.nextDeadline());
    holder.release();
    ASSERT_EQ('h', second->hear());
    EXPECT_FALSE(holder.contended());
    second->say('g');
    ASSERT_EQ('r', second->hear());
    ASSERT_TRUE(holder.tryAcquire());
  }
}

TEST_F(UnitArbiterTest, AWaiterKilledBeforeItTookNoteIsPassedOver)
{
  UnitArbiter holder(KEY, folder_);
  for (int round = 0; round < 10; ++round)
  {
    ASSERT_TRUE(holder.acquire(NONE, 0, LONG));
    const auto stopped = startUser(1);
    ASSERT_TRUE(becomesTrue([&] { return holder.waiters() == 1; }));
    stopped->signal(SIGSTOP);
    const auto second = startUser(2);
    ASSERT_TRUE(becomesTrue([&] { return holder.waiters() == 2; }));
    holder.release();
    EXPECT_FALSE(holder.tryAcquire());
    stopped->killAndLeaveZombie();
    ASSERT_EQ('h', second->hear());
    second->say('g');
    ASSERT_EQ('r', second->hear());
  }
}

TEST_F(UnitArbiterTest, KillsAtAnyMomentDoNotStopTheOthers)
{
  struct Progress
  {
    std::atomic<int> holder{0};
    std::atomic<long> rounds[3] = {};
    std::atomic<int> intruders{0};
  };
  Shared<Progress> progress;
  const auto startWorker = [&](int index)
  {
    return std::make_unique<Child>(
        [&, index](Child&)
        {
          UnitArbiter arbiter(KEY, folder_);
          for (;;)
          {
            if (arbiter.acquire(NONE, 0, LONG))
            {
              progress->holder = index;
              ++progress->rounds[index];
              progress->intruders += progress->holder != index;
              arbiter.release();
            }
          }
        });
  };
  UnitArbiter observer(KEY, folder_);  // keeps the table from being made anew
  std::vector<std::unique_ptr<Child>> workers;
  std::mt19937 random(7);
  for (int index = 0; index < 3; ++index)
  {
    workers.push_back(startWorker(index));
  }
  for (int round = 0; round < 50; ++round)
  {
    const int victim = static_cast<int>(random() % 3);
    const long start = progress->rounds[victim];
    const long more = 1 + static_cast<long>(random() % 100);
    ASSERT_TRUE(becomesTrue([&] { return progress->rounds[victim] >= start + more; })) << "in round " << round;
    workers[victim]->killAndLeaveZombie();
    workers[victim] = startWorker(victim);
  }
  for (int index = 0; index < 3; ++index)
  {
    const long start = progress->rounds[index];
    EXPECT_TRUE(becomesTrue([&] { return progress->rounds[index] > start; })) << "worker " << index << " is stuck";
  }
  workers.clear();
  EXPECT_EQ(0, progress->intruders);
  EXPECT_TRUE(observer.acquire(NONE, 0, LONG));
}

TEST_F(UnitArbiterTest, ThePlaceOfAKilledHolderIsTidiedUp)
{
  UnitArbiter observer(KEY, folder_);
  {
    const auto holder = startUser();
    ASSERT_EQ('h', holder->hear());
    holder->killAndLeaveZombie();
  }
  EXPECT_FALSE(observer.tryAcquire()) << "only acquire() looks whether the holder lives";
  UnitArbiter successor(KEY, folder_);
  EXPECT_FALSE(successor.held());
  EXPECT_TRUE(observer.tryAcquire());
}

TEST_F(UnitArbiterTest, ThePlaceOfAKilledWaiterIsTidiedUp)
{
  UnitArbiter holder(KEY, folder_);
  ASSERT_TRUE(holder.tryAcquire());
  {
    const auto waiter = startUser(1);
    ASSERT_TRUE(becomesTrue([&] { return holder.contended(); }));
    waiter->killAndLeaveZombie();
  }
  UnitArbiter successor(KEY, folder_);
  EXPECT_FALSE(holder.contended()) << "the new user of the place seems to wait";
  holder.release();
  EXPECT_TRUE(holder.tryAcquire());
}

TEST_F(UnitArbiterTest, AUnitIsNotHandedToAWaiterThatJustLeft)
{
  UnitArbiter holder(KEY, folder_);
  UnitArbiter leaving(KEY, folder_);
  constexpr int ROUNDS = 5000;
  std::atomic<int> started{0};
  std::atomic<int> ended{0};
  std::thread waiter(
      [&]
      {
        for (int round = 1; round <= ROUNDS; ++round)
        {
          while (started.load() < round)
          {
            std::this_thread::yield();
          }
          if (leaving.acquire(1, 0, 0ns))  // queues, and leaves at once
          {
            leaving.release();
          }
          ended.store(round);
        }
      });
  for (int round = 1; round <= ROUNDS; ++round)
  {
    if (!holder.tryAcquire())
    {
      ADD_FAILURE() << "nobody holds the unit or waits, but it is not free in round " << round;
      leaving.cancelWait();
      ASSERT_TRUE(holder.acquire(NONE, 0, 10s)) << "the unit is lost";
    }
    started.store(round);
    while (holder.waiters() == 0 && ended.load() < round)
    {
    }
    holder.release();
    while (ended.load() < round)
    {
      std::this_thread::yield();
    }
  }
  waiter.join();
}

TEST_F(UnitArbiterTest, TheSmallestBudgetOfTheLivingOthersCounts)
{
  UnitArbiter own(KEY, folder_);
  UnitArbiter other(KEY, folder_);
  own.setBlockingBudget(1);
  EXPECT_EQ(UnitArbiter::NO_BUDGET, own.blockingBudget());
  other.setBlockingBudget(5000);
  Child strict(
      [this](Child& test)
      {
        UnitArbiter arbiter(KEY, folder_);
        arbiter.setBlockingBudget(3000);
        test.say('s');
        test.hear();
      });
  ASSERT_EQ('s', strict.hear());
  EXPECT_EQ(3000, own.blockingBudget());
  strict.killAndLeaveZombie();
  EXPECT_EQ(5000, own.blockingBudget());
  other.setBlockingBudget(UnitArbiter::NO_BUDGET);
  EXPECT_EQ(UnitArbiter::NO_BUDGET, own.blockingBudget());
  UnitArbiter successor(KEY, folder_);
  EXPECT_EQ(UnitArbiter::NO_BUDGET, own.blockingBudget()) << "inherited from the killed user of the place";
}

TEST_F(UnitArbiterTest, ThreadsShareOneArbiter)
{
  UnitArbiter arbiter(KEY, folder_);
  UnitArbiter rival(KEY, folder_);
  std::atomic<int> inside{0};
  std::atomic<bool> done{false};
  const auto work = [&](UnitArbiter& own, bool waits)
  {
    for (int round = 0; round < 500; ++round)
    {
      while (!(waits ? own.acquire(round, 0, 100ms) : own.tryAcquire()))
      {
        std::this_thread::yield();
      }
      EXPECT_EQ(0, inside.fetch_add(1));
      inside.fetch_sub(1);
      own.release();
    }
  };
  std::thread disturber(
      [&]
      {
        while (!done)
        {
          arbiter.updateWaiting(1, 1);
          arbiter.cancelWait();
          EXPECT_LE(arbiter.waiters(), 1U);
          arbiter.contended();
          arbiter.setBlockingBudget(arbiter.nextDeadline());
          arbiter.blockingBudget();
          std::this_thread::yield();
        }
      });
  std::thread waiting([&] { work(arbiter, true); });
  std::thread trying([&] { work(arbiter, false); });
  work(rival, true);
  waiting.join();
  trying.join();
  done = true;
  disturber.join();
  EXPECT_TRUE(rival.tryAcquire());
}

}  // namespace
}  // namespace pi_runtime
