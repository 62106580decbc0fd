#include "core/memory_budget.h"

#include <gtest/gtest.h>

#include <limits>

namespace pi_runtime
{
namespace
{

TEST(MemoryBudget, GivesUpToItsLimit)
{
  MemoryBudget budget(100);
  const auto first = budget.take(60);
  ASSERT_NE(nullptr, first);
  EXPECT_EQ(nullptr, budget.take(41));
  EXPECT_EQ(60u, budget.used());
  const auto second = budget.take(40);
  EXPECT_NE(nullptr, second);
  EXPECT_EQ(100u, budget.used());
}

TEST(MemoryBudget, GetsBackWhatIsDropped)
{
  MemoryBudget budget(100);
  auto share = budget.take(100);
  auto copy = share;
  share.reset();
  EXPECT_EQ(100u, budget.used());
  copy.reset();
  EXPECT_EQ(0u, budget.used());
  EXPECT_NE(nullptr, budget.take(100));
}

TEST(MemoryBudget, CountsNothingForNothing)
{
  MemoryBudget budget(0);
  EXPECT_NE(nullptr, budget.take(0));
  EXPECT_EQ(nullptr, budget.take(1));
}

TEST(MemoryBudget, IsNotFooledByHugeSizes)
{
  MemoryBudget budget(100);
  const auto share = budget.take(50);
  EXPECT_EQ(nullptr, budget.take(std::numeric_limits<size_t>::max()));
  EXPECT_EQ(50u, budget.used());
}

TEST(MemoryBudget, MayEndBeforeItsShares)
{
  std::shared_ptr<const void> share;
  {
    MemoryBudget budget(100);
    share = budget.take(10);
  }
  EXPECT_NE(nullptr, share);
  share.reset();
}

}  // namespace
}  // namespace pi_runtime
