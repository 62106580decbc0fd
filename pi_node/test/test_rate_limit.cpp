#include <gtest/gtest.h>
#include <pi_node/rate_limit.h>

#include <cstdint>
#include <vector>

namespace pi_node
{
namespace
{

constexpr int64_t BEGIN_NS = 7000000000;

int64_t milliseconds(int ms)
{
  return int64_t{1000000} * ms;
}

int taken(double limit_hz, int period_ms, int count, const std::vector<int>& jitter_ms)
{
  RateLimit limit(limit_hz);
  int result = 0;
  for (int i = 0; i < count; ++i)
  {
    result += limit.take(BEGIN_NS + milliseconds(i * period_ms + jitter_ms[static_cast<size_t>(i) % jitter_ms.size()]))
                  ? 1
                  : 0;
  }
  return result;
}

TEST(RateLimit, KeepsTheRate)
{
  EXPECT_EQ(100, taken(10.0, 50, 200, {0}));
  EXPECT_NEAR(100, taken(10.0, 10, 1000, {0}), 1);
  EXPECT_NEAR(100, taken(10.0, 33, 303, {0}), 3);
}

TEST(RateLimit, TakesWhatComesUnevenly)
{
  EXPECT_NEAR(100, taken(10.0, 50, 200, {0, 3, 9, 1, 14, 6, 2}), 2);
  EXPECT_EQ(50, taken(10.0, 100, 50, {0, 20, 5, 11, 2}));
}

TEST(RateLimit, TakesAllThatIsSlowerAndAllWithoutALimit)
{
  EXPECT_EQ(30, taken(10.0, 120, 30, {0}));
  EXPECT_EQ(100, taken(0.0, 1, 100, {0}));
}

TEST(RateLimit, BeginsAnewWhenTimeWentBack)
{
  RateLimit limit(10.0);
  EXPECT_TRUE(limit.take(BEGIN_NS));
  EXPECT_TRUE(limit.take(BEGIN_NS - milliseconds(5000)));
  EXPECT_FALSE(limit.take(BEGIN_NS - milliseconds(4950)));
  EXPECT_TRUE(limit.take(BEGIN_NS - milliseconds(4900)));
}

TEST(RateLimit, DoesNotMakeUpForAPause)
{
  RateLimit limit(10.0);
  EXPECT_TRUE(limit.take(BEGIN_NS));
  EXPECT_TRUE(limit.take(BEGIN_NS + milliseconds(5000)));
  EXPECT_FALSE(limit.take(BEGIN_NS + milliseconds(5050)));
  EXPECT_TRUE(limit.take(BEGIN_NS + milliseconds(5100)));
}

}  // namespace
}  // namespace pi_node
