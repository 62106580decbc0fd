#include <gtest/gtest.h>
#include <pi_bringup/pacer.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <thread>

using pi_bringup::LatenessStatistics;
using pi_bringup::monotonicNow;
using pi_bringup::Pacer;

TEST(Pacer, RefusesRatesThatAreNotPositive)
{
  EXPECT_THROW(Pacer(0.0), std::invalid_argument);
  EXPECT_THROW(Pacer(-1.0), std::invalid_argument);
  EXPECT_THROW(Pacer(std::nan("")), std::invalid_argument);
  EXPECT_THROW(Pacer(std::numeric_limits<double>::infinity()), std::invalid_argument);
}

TEST(Pacer, KeepsNanosecondsAtTrueRate)
{
  Pacer pacer(1.0);
  pacer.start(1403636579763555584LL, 1000);
  EXPECT_EQ(1000, pacer.dueTime(1403636579763555584LL));
  // More than 2^53 ns apart, where a double would round.
  EXPECT_EQ(1000 + 10000000000000001LL, pacer.dueTime(1403636579763555584LL + 10000000000000001LL));
  EXPECT_EQ(999, pacer.dueTime(1403636579763555583LL));
}

TEST(Pacer, ScalesWithTheRate)
{
  Pacer pacer(4.0);
  pacer.start(100, 0);
  EXPECT_EQ(250000000, pacer.dueTime(1000000100));
}

TEST(Pacer, DoesNotReturnBeforeTheTimeIsDue)
{
  Pacer pacer(1.0);
  const int64_t start_ns = monotonicNow();
  pacer.start(0, start_ns);
  EXPECT_TRUE(pacer.waitUntil(2000000));
  EXPECT_GE(monotonicNow(), start_ns + 2000000);
}

TEST(Pacer, DoesNotWaitForThePast)
{
  Pacer pacer(1.0);
  pacer.start(1000000000, monotonicNow());
  EXPECT_TRUE(pacer.waitUntil(0));  // a wait would be for ever: dueTime is a second ago
}

TEST(Pacer, StopReleasesAWaitAndAllLaterOnes)
{
  Pacer pacer(1.0);
  pacer.start(0, monotonicNow());
  bool finished = true;
  std::thread waiter([&] { finished = pacer.waitUntil(3600LL * 1000000000LL); });
  pacer.stop();
  waiter.join();
  EXPECT_FALSE(finished);
  EXPECT_FALSE(pacer.waitUntil(3600LL * 1000000000LL));
}

TEST(LatenessStatistics, CountsDelaysAndTakesEarlyAsPunctual)
{
  LatenessStatistics lateness;
  EXPECT_EQ(0.0, lateness.meanNs());
  for (const int64_t ns : {-5000000LL, 0LL, 2000000LL, 18000000LL})
  {
    lateness.record(ns);
  }
  EXPECT_EQ(4U, lateness.count());
  EXPECT_EQ(2U, lateness.overOneMillisecond());
  EXPECT_EQ(1U, lateness.overTenMilliseconds());
  EXPECT_EQ(18000000, lateness.maxNs());
  EXPECT_DOUBLE_EQ(5000000.0, lateness.meanNs());
}
