#include <gtest/gtest.h>
#include <pi_node/stereo_pairs.h>

#include <cmath>
#include <cstdint>

namespace pi_node
{
namespace
{

struct Picture
{
  int64_t stamp_ns = 0;
};

struct StampOf
{
  int64_t operator()(const Picture& picture) const { return picture.stamp_ns; }
};
using Pairs = StereoPairs<Picture, StampOf>;

constexpr int64_t MILLISECOND = 1'000'000;

TEST(StereoPairs, AreThoseThatAreNearestWhateverComesFirst)
{
  Pairs pairs(2 * MILLISECOND);
  EXPECT_FALSE(pairs.add(0, {10 * MILLISECOND}));
  const auto first = pairs.add(1, {11 * MILLISECOND});
  ASSERT_TRUE(first);
  EXPECT_EQ(10 * MILLISECOND, first->first.stamp_ns);
  EXPECT_EQ(11 * MILLISECOND, first->second.stamp_ns);
  EXPECT_FALSE(pairs.add(1, {27 * MILLISECOND}));
  const auto second = pairs.add(0, {28 * MILLISECOND});
  ASSERT_TRUE(second);
  EXPECT_EQ(28 * MILLISECOND, second->first.stamp_ns) << "left is first, also when it comes last";
  EXPECT_EQ(0u, pairs.dropped());
}

TEST(StereoPairs, WhatHasNoPartnerIsDroppedAndCounted)
{
  Pairs pairs(2 * MILLISECOND);
  EXPECT_FALSE(pairs.add(0, {10 * MILLISECOND}));
  EXPECT_FALSE(pairs.add(1, {26 * MILLISECOND})) << "that of 10 ms was lost";
  EXPECT_EQ(1u, pairs.dropped());
  ASSERT_TRUE(pairs.add(0, {26 * MILLISECOND}));
  EXPECT_EQ(1u, pairs.dropped());
}

TEST(StereoPairs, CamerasOutOfStepHaveNoPairs)
{
  Pairs pairs(2 * MILLISECOND);
  for (int i = 0; i < 100; ++i)
  {
    EXPECT_FALSE(pairs.add(0, {i * 16 * MILLISECOND}));
    EXPECT_FALSE(pairs.add(1, {i * 16 * MILLISECOND + 8 * MILLISECOND}));
  }
  EXPECT_EQ(199u, pairs.dropped());
  EXPECT_EQ(8 * MILLISECOND, std::abs(pairs.difference()));
}

TEST(StereoPairs, ACameraWhosePartnerIsSilentTakesNoMemory)
{
  Pairs pairs(2 * MILLISECOND);
  for (int i = 0; i < 100; ++i)
  {
    EXPECT_FALSE(pairs.add(1, {i * 16 * MILLISECOND}));
  }
  EXPECT_EQ(100u - Pairs::MOST_WAITING, pairs.dropped());
  EXPECT_TRUE(pairs.add(0, {99 * 16 * MILLISECOND}));
}

TEST(StereoPairs, BeginAnewWhenTimeGoesBack)
{
  Pairs pairs(2 * MILLISECOND);
  pairs.add(0, {1000 * MILLISECOND});
  pairs.add(0, {100 * MILLISECOND});
  EXPECT_TRUE(pairs.add(1, {100 * MILLISECOND}));
  EXPECT_FALSE(pairs.add(1, {1000 * MILLISECOND}));
}

}  // namespace
}  // namespace pi_node
