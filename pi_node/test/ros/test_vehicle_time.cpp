#include <gtest/gtest.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/vehicle_clock.h>
#include <ros/time.h>

#include <condition_variable>
#include <cstdint>
#include <mutex>

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

int64_t simulated_ns = 0;

class SimulatedWait : public ::testing::Test
{
protected:
  SimulatedWait()
  {
    simulated_ns = 10 * SECOND_NS;
    simulateTime([] { return simulated_ns; });
  }
  ~SimulatedWait() override { simulateTime(nullptr); }

  /// Waits for 5 s of a clock that each look moves.
  bool wait(int64_t step_ns)
  {
    std::mutex mutex;
    std::condition_variable changed;
    std::unique_lock<std::mutex> lock(mutex);
    return waitFor(&changed, &lock, 5.0,
                   [this, step_ns]
                   {
                     ++looks_;
                     simulated_ns += step_ns;
                     return false;
                   });
  }

  int looks_ = 0;
};

TEST_F(SimulatedWait, EndsWhenItsTimeIsOver)
{
  EXPECT_FALSE(wait(SECOND_NS));
  EXPECT_GE(simulated_ns, 15 * SECOND_NS);
}

TEST_F(SimulatedWait, EndsWhenTimeJumpsBack)
{
  EXPECT_FALSE(wait(-8 * SECOND_NS));
  EXPECT_LE(looks_, 3) << "and does not wait until the old time has come again";
}

}  // namespace
}  // namespace pi_node
