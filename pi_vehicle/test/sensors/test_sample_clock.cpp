// Devices with jitter, drift and losses whose true times are known.

#include "sensors/sample_clock.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

namespace pi_vehicle
{
namespace
{

constexpr double RATE = 200.0;
constexpr double MS = 1e-3;
constexpr int64_t BEGIN_NS = 5'000'000'000;

struct Error
{
  double least = 1e9;  ///< of stamp - true time [s]
  double most = -1e9;
  size_t stamps = 0;
  bool increasing = true;
};

/// @param delay  of the sample that was taken at this time [s]; negative: nothing comes of it, below -1: it is broken.
Error errorOf(SampleClock* clock, double seconds, double true_rate, const std::function<double(double)>& delay,
              double judged_from = 0.0)
{
  Error error;
  int64_t last_arrival_ns = 0;
  int64_t last_ns = 0;
  for (int i = 0; i < seconds * true_rate; ++i)
  {
    const double true_s = i / true_rate;
    const double late_s = delay(true_s);
    if (late_s < 0.0)
    {
      if (late_s < -1.0)
      {
        clock->skip();
      }
      continue;
    }
    const auto arrival_ns = std::max<int64_t>(last_arrival_ns, BEGIN_NS + std::llround(1e9 * (true_s + late_s)));
    last_arrival_ns = arrival_ns;
    if (const auto stamp_ns = clock->sample(arrival_ns))
    {
      error.increasing = error.increasing && *stamp_ns > last_ns;
      last_ns = *stamp_ns;
      ++error.stamps;
      if (true_s >= judged_from)
      {
        const double off = 1e-9 * static_cast<double>(*stamp_ns - BEGIN_NS) - true_s;
        error.least = std::min(error.least, off);
        error.most = std::max(error.most, off);
      }
    }
  }
  return error;
}

/// What a USB adapter with a timer of 16 ms does: all that came meanwhile arrives at its end.
double bundled(double true_s)
{
  constexpr double TIMER_S = 16 * MS;
  return TIMER_S * std::ceil(true_s / TIMER_S + 1e-9) - true_s;
}

TEST(SampleClock, TakesTheBundlesOfAUsbAdapterOutOfTheStamps)
{
  SampleClock clock(RATE);
  const Error error = errorOf(&clock, 60.0, RATE, bundled, 1.0);
  EXPECT_TRUE(error.increasing);
  EXPECT_LT(error.most - error.least, 0.2 * MS) << "arrivals jitter by 16 ms";
  EXPECT_GT(error.least, 0.0);
  EXPECT_EQ(0u, clock.missed());
}

TEST(SampleClock, FollowsADeviceWhoseCrystalIsOff)
{
  for (const double drift : {-100e-6, 100e-6})
  {
    std::mt19937 random(7);
    std::exponential_distribution<double> jitter(1.0 / (2 * MS));
    SampleClock clock(RATE);
    const Error error = errorOf(
        &clock, 120.0, RATE * (1.0 + drift), [&](double) { return 1 * MS + jitter(random); }, 2.0);
    EXPECT_TRUE(error.increasing);
    EXPECT_GT(error.least, 0.9 * MS);
    EXPECT_LT(error.most, 1.5 * MS) << "after two minutes the nominal period alone would be 12 ms off";
  }
}

TEST(SampleClock, FirstHalfSecondOnlyMakesTheLine)
{
  SampleClock clock(RATE);
  EXPECT_EQ(0u, errorOf(&clock, 0.5, RATE, bundled).stamps);
  EXPECT_EQ(100u, errorOf(&clock, 0.5, RATE, bundled).stamps);
}

TEST(SampleClock, ABusyComputerIsNoLoss)
{
  SampleClock clock(RATE);
  const Error error = errorOf(
      &clock, 20.0, RATE, [](double t) { return t > 10.0 && t < 10.4 ? 10.4 - t + 1 * MS : 1 * MS; }, 1.0);
  EXPECT_TRUE(error.increasing);
  EXPECT_EQ(0u, clock.missed());
  EXPECT_LT(error.most, 1.5 * MS) << "all that waited has the stamp of its measurement";
}

TEST(SampleClock, BrokenSamplesTakeTheirTime)
{
  SampleClock clock(RATE);
  std::mt19937 random(3);
  const Error error = errorOf(
      &clock, 30.0, RATE, [&](double) { return random() % 10 == 0 ? -2.0 : 1 * MS; }, 1.0);
  EXPECT_EQ(0u, clock.missed());
  EXPECT_LT(error.most - error.least, 0.1 * MS);
}

TEST(SampleClock, SamplesOfWhichNothingCameAreFoundWithinAQuarterOfASecond)
{
  SampleClock clock(RATE);
  const auto lose = [](double t) { return t > 10.0 && t < 10.0151 ? -0.5 : 1 * MS; };  // three
  const Error error = errorOf(&clock, 30.0, RATE, lose, 10.6);
  EXPECT_EQ(3u, clock.missed());
  EXPECT_TRUE(error.increasing);
  EXPECT_LT(std::abs(error.most - 1 * MS), 0.2 * MS);
  EXPECT_LT(std::abs(error.least - 1 * MS), 0.2 * MS);
}

TEST(SampleClock, BeginsAnewAfterASecondOfSilence)
{
  SampleClock clock(RATE);
  const auto silent = [](double t) { return t > 5.0 && t < 7.0 ? -0.5 : 1 * MS; };
  const Error error = errorOf(&clock, 10.0, RATE, silent, 1.0);
  EXPECT_EQ(0u, clock.missed());
  EXPECT_TRUE(error.increasing);
  EXPECT_LT(error.most, 1.2 * MS);
  EXPECT_NEAR(8.0 * RATE - 2 * 100, static_cast<double>(error.stamps), 3.0);
}

TEST(SampleClock, ADeviceFasterThanItsNominalRateTurnsNoTimeBack)
{
  SampleClock clock(100.0);
  EXPECT_TRUE(errorOf(&clock, 10.0, 400.0, bundled).increasing);
}

}  // namespace
}  // namespace pi_vehicle
