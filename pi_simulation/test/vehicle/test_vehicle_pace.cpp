// A simulation does not run away from the vehicle, and waits for nobody who has not answered yet.

#include "vehicle/vehicle_pace.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace pi_simulation
{
namespace
{

constexpr int64_t MS = 1000000;

TEST(VehiclePace, WaitsForWhoeverHasAnsweredAndNotForOthers)
{
  VehiclePace pace({});
  pace.given("pictures", 100 * MS);
  EXPECT_FALSE(pace.awaited(10000 * MS));  // the vehicle is still starting
  pace.answered("pictures", "vio /vio", 100 * MS);
  EXPECT_FALSE(pace.awaited(10000 * MS));
  pace.given("pictures", 150 * MS);
  EXPECT_FALSE(pace.awaited(300 * MS));
  const auto awaited = pace.awaited(301 * MS);
  ASSERT_TRUE(awaited);
  EXPECT_EQ("pictures", awaited->kind);
  EXPECT_EQ("vio /vio", awaited->who);
  EXPECT_EQ(100 * MS, awaited->answered_ns);
  pace.answered("pictures", "vio /vio", 150 * MS);
  EXPECT_FALSE(pace.awaited(301 * MS));
}

TEST(VehiclePace, TheSlowestCounts)
{
  VehiclePace pace({});
  for (const int64_t stamp_ms : {100, 150, 200})
  {
    pace.given("pictures", stamp_ms * MS);
  }
  pace.answered("pictures", "vio /vio", 200 * MS);
  pace.answered("pictures", "obstacles /obstacles", 100 * MS);
  EXPECT_FALSE(pace.awaited(300 * MS));
  EXPECT_EQ("obstacles /obstacles", pace.awaited(310 * MS)->who);
}

TEST(VehiclePace, WhatComesAllTheTimeIsAnsweredWithoutBeingGiven)
{
  VehiclePace pace({});
  pace.answered("tick", "arbiter /arbiter", 500 * MS);
  EXPECT_FALSE(pace.awaited(520 * MS));
  EXPECT_TRUE(pace.awaited(521 * MS));
}

TEST(VehiclePace, NobodyWaitsForTheDeadUntilTheyAnswerAgain)
{
  VehiclePace pace({});
  pace.answered("tick", "arbiter /arbiter", 500 * MS);
  pace.forget();
  EXPECT_FALSE(pace.awaited(5000 * MS));
  pace.answered("tick", "arbiter /arbiter", 5000 * MS);
  EXPECT_TRUE(pace.awaited(6000 * MS));
  pace.forget("tick", "arbiter /arbiter");
  EXPECT_FALSE(pace.awaited(6000 * MS));
}

TEST(VehiclePace, KindsThatItDoesNotKnowHoldNobodyUp)
{
  VehiclePace pace({});
  pace.answered("smell", "nose /nose", 0);
  EXPECT_FALSE(pace.awaited(5000 * MS));
  PaceOptions options;
  options.tick = 0.01;
  EXPECT_THROW(VehiclePace{options}, std::invalid_argument);
}

}  // namespace
}  // namespace pi_simulation
