#include "sensors/stereo_pairs.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

namespace pi_vehicle
{
namespace
{

struct Picture
{
  int64_t stamp_ns = 0;
};

constexpr int64_t MILLISECOND = 1'000'000;

TEST(StereoPairs, AreThoseThatAreNearestWhateverComesFirst)
{
  StereoPairs<Picture> pairs(2 * MILLISECOND);
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
  StereoPairs<Picture> pairs(2 * MILLISECOND);
  EXPECT_FALSE(pairs.add(0, {10 * MILLISECOND}));
  EXPECT_FALSE(pairs.add(1, {26 * MILLISECOND})) << "that of 10 ms was lost";
  EXPECT_EQ(1u, pairs.dropped());
  ASSERT_TRUE(pairs.add(0, {26 * MILLISECOND}));
  EXPECT_EQ(1u, pairs.dropped());
}

TEST(StereoPairs, CamerasOutOfStepHaveNoPairs)
{
  StereoPairs<Picture> pairs(2 * MILLISECOND);
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
  StereoPairs<Picture> pairs(2 * MILLISECOND);
  for (int i = 0; i < 100; ++i)
  {
    EXPECT_FALSE(pairs.add(1, {i * 16 * MILLISECOND}));
  }
  EXPECT_EQ(96u, pairs.dropped());
  EXPECT_TRUE(pairs.add(0, {99 * 16 * MILLISECOND}));
}

}  // namespace
}  // namespace pi_vehicle
