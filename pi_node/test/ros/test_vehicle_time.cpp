#include <gtest/gtest.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/vehicle_clock.h>
#include <ros/time.h>

namespace pi_node
{
namespace
{

constexpr int64_t SECOND_NS = 1000000000;

/// A simulator that stands waits for a node that was started before it knew the time, and that waits for a time itself.
TEST(VehicleTime, WhatWasDueBeforeTheTimeWasKnownIsDue)
{
  ros::Time::init();
  ros::Time::setNow(ros::Time(0.0));
  followRosTime();
  ASSERT_TRUE(isTimeSimulated());
  EXPECT_EQ(0, vehicleNs());
  ros::Time::setNow(ros::Time(1e9));
  const int64_t known_ns = vehicleNs();
  EXPECT_GE(known_ns, SECOND_NS / 10);  // periods are shorter
  EXPECT_LE(known_ns, 2 * SECOND_NS);   // patience is longer
  ros::Time::setNow(ros::Time(1e9 + 3.0));
  EXPECT_EQ(3 * SECOND_NS, vehicleNs() - known_ns);
}

}  // namespace
}  // namespace pi_node
