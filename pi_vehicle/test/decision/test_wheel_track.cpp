#include "decision/wheel_track.h"

#include <gtest/gtest.h>

#include <cmath>

#include "test_values.h"

namespace pi_vehicle
{
namespace
{

TEST(WheelTrack, GivesPosesBetweenAndShortlyAfterItsPoints)
{
  WheelTrack track(4.0, 10.0);
  EXPECT_EQ(nullptr, track.newest());
  EXPECT_FALSE(track.at(0, 1.0));
  EXPECT_TRUE(track.add(0, {5.0, 1.0, 0.0}, 1.0, 0.0));
  EXPECT_TRUE(track.add(100 * MS, {5.1, 1.0, 0.0}, 1.0, 0.5));
  EXPECT_FALSE(track.add(100 * MS, {7.1, 1.0, 0.0}, 1.0, 0.0));
  EXPECT_FALSE(track.add(200 * MS, {std::nan(""), 1.0, 0.0}, 1.0, 0.0));
  EXPECT_NEAR(0.03, track.at(30 * MS, 0.0)->pose.x, 1e-9);
  EXPECT_FALSE(track.at(-MS, 1.0));
  EXPECT_FALSE(track.at(150 * MS, 0.04));
  const auto later = track.at(200 * MS, 0.11);
  ASSERT_TRUE(later);
  EXPECT_NEAR(0.1 + 0.1 * std::cos(0.025), later->pose.x, 1e-9);
  EXPECT_NEAR(0.05, later->pose.heading, 1e-9);
  EXPECT_NEAR(0.2, later->distance, 1e-9);
  EXPECT_TRUE(track.covers(100 * MS));
  EXPECT_FALSE(track.covers(101 * MS));
}

TEST(WheelTrack, GoesOnOverAChassisThatBeginsAnew)
{
  WheelTrack track(4.0, 10.0);
  track.add(0, {20.0, 10.0, 1.5}, 2.0, 0.0);
  track.add(20 * MS, {20.0 + 0.04 * std::cos(1.5), 10.0 + 0.04 * std::sin(1.5), 1.5}, 2.0, 0.0);
  track.add(40 * MS, {0.0, 0.0, 0.0}, 2.0, 0.0);  // its speed bridges the jump
  track.add(60 * MS, {0.04, 0.0, 0.0}, 2.0, 0.0);
  EXPECT_NEAR(0.12, track.newest()->distance, 1e-9);
  EXPECT_NEAR(0.12, track.newest()->pose.x, 1e-9);
  EXPECT_NEAR(0.0, track.newest()->pose.y, 1e-9);
}

TEST(WheelTrack, ForgetsWhatIsOldAndTurnsOverTheHalfCircle)
{
  WheelTrack track(4.0, 1.0);
  for (int i = 0; i <= 200; ++i)
  {
    track.add(i * 20 * MS, {0.0, 0.0, wrapAngle(0.02 * i)}, 0.0, 1.0);
  }
  EXPECT_FALSE(track.at(2900 * MS, 0.0));
  EXPECT_NEAR(wrapAngle(3.15), track.at(3150 * MS, 0.0)->pose.heading, 1e-6);
  track.clear();
  EXPECT_EQ(nullptr, track.newest());
}

}  // namespace
}  // namespace pi_vehicle
