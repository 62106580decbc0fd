#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "policies/estimates.h"

namespace
{
using pi_offload::MeanDeviation;
using pi_offload::NetworkTime;
using pi_offload::NodeAdvertisement;
using pi_offload::NodeEstimates;
using pi_offload::RecentMedian;
using pi_offload::RequestTiming;
using pi_offload::TaskKind;

constexpr double NOT_A_NUMBER = std::numeric_limits<double>::quiet_NaN();
constexpr double INFINITE = std::numeric_limits<double>::infinity();

int64_t seconds(double s)
{
  return static_cast<int64_t>(s * 1e9);
}

/// What a request takes on a network of this rate [Mbit/s] and round trip [s].
RequestTiming timing(size_t bytes, double rate, double round_trip, double service = 0.02, double queue = 0.0)
{
  RequestTiming t;
  t.input_bytes = bytes;
  t.queue_s = queue;
  t.service_s = service;
  t.total_s = round_trip + static_cast<double>(bytes) * 8e-6 / rate + service + queue;
  return t;
}

TEST(RecentMedian, BeginsAsMeanAndDeviationDo)
{
  RecentMedian median;
  EXPECT_FALSE(median.known());
  median.add(std::numeric_limits<double>::quiet_NaN());
  EXPECT_FALSE(median.known());
  median.add(0.02);
  EXPECT_DOUBLE_EQ(median.mean(), 0.02);
  EXPECT_DOUBLE_EQ(median.deviation(), 0.01);
}

TEST(RecentMedian, AFewVeryLongTimesMoveItLittle)
{
  RecentMedian median;
  MeanDeviation mean;
  for (int i = 0; i < 40; ++i)
  {
    const double sample = i % 10 == 9 ? 0.3 : 0.02 + 0.001 * (i % 3);
    median.add(sample);
    mean.add(sample);
  }
  EXPECT_NEAR(median.mean(), 0.021, 1e-9);
  EXPECT_LT(median.deviation(), 0.002);
  EXPECT_GT(mean.mean() + mean.deviation(), 0.1) << "a task with 0.1 s left would be refused";
}

TEST(RecentMedian, FollowsAChangeWithinHalfOfItsWindow)
{
  RecentMedian median;
  for (int i = 0; i < 30; ++i)
  {
    median.add(0.02);
  }
  for (int i = 0; i < 8; ++i)
  {
    median.add(0.1);
  }
  EXPECT_DOUBLE_EQ(median.mean(), 0.1);
}

TEST(MeanDeviation, FirstSampleSetsMeanAndHalfOfItAsDeviation)
{
  MeanDeviation m;
  EXPECT_FALSE(m.known());
  EXPECT_EQ(m.mean(), 0.0);
  m.add(0.4);
  EXPECT_TRUE(m.known());
  EXPECT_DOUBLE_EQ(m.mean(), 0.4);
  EXPECT_DOUBLE_EQ(m.deviation(), 0.2);
}

TEST(MeanDeviation, FollowsRfc6298)
{
  MeanDeviation m;
  m.add(0.4);
  m.add(0.8);
  EXPECT_DOUBLE_EQ(m.deviation(), 0.75 * 0.2 + 0.25 * 0.4);  // from the mean before this sample
  EXPECT_DOUBLE_EQ(m.mean(), 0.875 * 0.4 + 0.125 * 0.8);
}

TEST(MeanDeviation, ConvergesAndForgets)
{
  MeanDeviation m;
  m.add(5.0);
  for (int i = 0; i < 200; ++i)
  {
    m.add(1.0);
  }
  EXPECT_NEAR(m.mean(), 1.0, 1e-6);
  EXPECT_NEAR(m.deviation(), 0.0, 1e-6);
  m.reset();
  EXPECT_FALSE(m.known());
  EXPECT_EQ(m.deviation(), 0.0);
}

TEST(MeanDeviation, IgnoresWhatIsNoNumber)
{
  MeanDeviation m;
  m.add(NOT_A_NUMBER);
  EXPECT_FALSE(m.known());
  m.add(1.0);
  m.add(INFINITE);
  EXPECT_DOUBLE_EQ(m.mean(), 1.0);
}

TEST(MeanDeviation, RejectsGainsOutsideOfTheirBounds)
{
  EXPECT_THROW(MeanDeviation(0.0, 0.25), std::invalid_argument);
  EXPECT_THROW(MeanDeviation(1.5, 0.25), std::invalid_argument);
  EXPECT_THROW(MeanDeviation(0.125, NOT_A_NUMBER), std::invalid_argument);
}

TEST(NodeEstimates, LearnsRateFromLargeRequestsAndRoundTripFromProbes)
{
  NodeEstimates e;
  int64_t now = 0;
  for (int i = 0; i < 100; ++i)
  {
    now += seconds(0.1);
    e.addRoundTrip(0.008, now);
    e.add(timing(60000, 24.0, 0.008), now);
  }
  EXPECT_NEAR(e.roundTrip().mean(), 0.008, 1e-6);
  EXPECT_NEAR(e.secondsPerMbit().mean(), 1.0 / 24.0, 1e-4);
  EXPECT_NEAR(e.rate(now), 24.0, 0.1);
  EXPECT_NEAR(e.network(0.48, 0.0, now).mean_s, 0.028, 1e-4);
  EXPECT_NEAR(e.service(TaskKind::DETECTION).mean(), 0.02, 1e-9);
  EXPECT_FALSE(e.service(TaskKind::SPEECH).known());
}

TEST(NodeEstimates, SmallRequestsTeachTheRoundTripOnly)
{
  NodeEstimates e;
  e.add(timing(100, 1000.0, 0.012), 1);
  EXPECT_NEAR(e.roundTrip().mean(), 0.012, 1e-5);
  EXPECT_FALSE(e.secondsPerMbit().known());
}

TEST(NodeEstimates, SeparatesNetworkFromService)
{
  NodeEstimates e;
  // The same network, ten times the service and a queue: nothing changes for the network.
  e.add(timing(60000, 20.0, 0.02, 0.02), 1);
  const double before = e.secondsPerMbit().mean();
  for (int i = 0; i < 2; ++i)
  {
    e.add(timing(60000, 20.0, 0.02, 0.2, 0.3), 1);
  }
  EXPECT_NEAR(e.secondsPerMbit().mean(), before, 1e-9);
  EXPECT_GT(e.service(TaskKind::DETECTION).mean(), 0.04);
  EXPECT_GT(e.queue(TaskKind::DETECTION).mean(), 0.03);
}

TEST(NodeEstimates, SpikesRaiseTheDeviation)
{
  NodeEstimates e;
  for (int i = 0; i < 50; ++i)
  {
    e.add(timing(60000, 20.0, 0.01), seconds(0.1 * i));
  }
  const NetworkTime calm = e.network(0.48, 0.0, seconds(5.0));
  RequestTiming spike = timing(60000, 20.0, 0.01);
  spike.total_s += 0.3;
  e.add(spike, seconds(5.0));
  const NetworkTime after = e.network(0.48, 0.0, seconds(5.0));
  EXPECT_NEAR(after.deviation_s, 0.25 * 0.3, 0.01);  // a quarter of the spike
  EXPECT_LT(calm.deviation_s, 0.02);
  EXPECT_GT(after.mean_s, calm.mean_s);
  EXPECT_GT(after.mean_s + 4.0 * after.deviation_s, 0.3);
}

TEST(NodeEstimates, TimeoutRaisesToTheTimeWaitedUntilTheNextAnswer)
{
  NodeEstimates e;
  for (int i = 0; i < 50; ++i)
  {
    e.add(timing(60000, 20.0, 0.01), seconds(0.1 * i));
    e.addRoundTrip(0.01, seconds(0.1 * i));
  }
  const int64_t now = seconds(5.0);
  const double service = e.service(TaskKind::DETECTION).mean();
  EXPECT_LT(e.network(0.48, 0.0, now).mean_s + service, 0.06);
  e.addTimeout(TaskKind::DETECTION, 60000, 0.1, now);
  EXPECT_GE(e.network(0.48, 0.0, now).mean_s + service, 0.1 - 1e-9);
  e.addRoundTrip(0.01, now);
  const double after = e.network(0.48, 0.0, now).mean_s + service;
  EXPECT_LT(after, 0.08);   // it answers again
  EXPECT_GT(after, 0.054);  // and yet something was learned
}

TEST(NodeEstimates, TimeoutSoonerThanExpectedTeachesNothing)
{
  NodeEstimates e;
  for (int i = 0; i < 10; ++i)
  {
    e.add(timing(60000, 2.0, 0.01), 0);
  }
  const NetworkTime before = e.network(0.48, 0.0, 0);
  e.addTimeout(TaskKind::DETECTION, 60000, 0.05, 0);
  EXPECT_DOUBLE_EQ(e.network(0.48, 0.0, 0).mean_s, before.mean_s);
  EXPECT_DOUBLE_EQ(e.network(0.48, 0.0, 0).deviation_s, before.deviation_s);
}

TEST(NodeEstimates, RateReturnsToTheUsualOneWhileNothingIsMeasured)
{
  NodeEstimates::Options options;
  options.memory_s = 2.0;
  NodeEstimates e(options);
  for (int i = 0; i < 500; ++i)
  {
    e.add(timing(60000, 40.0, 0.02), 0);
  }
  e.setPlace({100.0, 0.0});
  for (int i = 0; i < 30; ++i)
  {
    e.add(timing(60000, 12.0, 0.02), 0);
  }
  EXPECT_LT(e.rate(seconds(10000.0)), 14.0) << "it is slow here";
  e.setPlace({0.0, 0.0});
  EXPECT_NEAR(e.rate(0), 12.0, 0.5);
  const double measured = 1.0 / e.rate(0);
  const double usual = 1.0 / e.rate(seconds(10000.0));
  EXPECT_NEAR(1.0 / e.rate(seconds(2.0)), 0.5 * (measured + usual), 1e-6);  // half of each
  EXPECT_GT(1.0 / usual, 18.0);
}

TEST(NodeEstimates, UsualRateThatIsSlowFadesSoThatTheNodeIsTriedAgain)
{
  NodeEstimates::Options options;
  options.memory_s = 2.0;
  NodeEstimates e(options);
  for (int i = 0; i < 50; ++i)
  {
    e.add(timing(60000, 0.5, 0.01), 0);
  }
  EXPECT_NEAR(e.rate(0), 0.5, 0.02);
  EXPECT_LT(e.rate(seconds(2.0)), 0.6);
  EXPECT_NEAR(1.0 / e.rate(seconds(30.0)), 0.5 * (2.0 + 0.1), 0.05);  // half of each
  EXPECT_GT(e.rate(seconds(600.0)), 8.0);
}

TEST(NodeEstimates, ForgetsTheNetworkButNotTheService)
{
  NodeEstimates e;
  e.add(timing(60000, 40.0, 0.005, 0.03, 0.01), 0);
  e.addRoundTrip(0.005, 0);
  e.addTimeout(TaskKind::DETECTION, 60000, 1.0, 0);
  e.forgetNetwork();
  EXPECT_FALSE(e.roundTrip().known());
  EXPECT_FALSE(e.secondsPerMbit().known());
  EXPECT_TRUE(std::isinf(e.rateAge(0)));
  // The first round trip, the usual rate.
  EXPECT_NEAR(e.network(0.48, 0.0, 0).mean_s, 0.02 + 0.48 / e.rate(0), 1e-9);
  EXPECT_DOUBLE_EQ(e.service(TaskKind::DETECTION).mean(), 0.03);
  EXPECT_DOUBLE_EQ(e.queue(TaskKind::DETECTION).mean(), 0.01);
}

TEST(NodeEstimates, RateIsNotEstimatedBelowItsBound)
{
  NodeEstimates::Options options;
  options.least_rate_mbps = 1.0;
  NodeEstimates e(options);
  e.add(timing(60000, 0.01, 0.0), 0);
  EXPECT_DOUBLE_EQ(e.rate(0), 1.0);
}

TEST(NodeEstimates, NodeWhoseClockSaysTooMuchTeachesNothingOfTheNetwork)
{
  NodeEstimates e;
  RequestTiming t = timing(60000, 20.0, 0.01);
  t.service_s = 10.0;
  e.add(t, 0);
  EXPECT_FALSE(e.secondsPerMbit().known());
  EXPECT_LE(e.service(TaskKind::DETECTION).mean(), t.total_s);
}

TEST(NodeEstimates, RequestFasterThanTheRoundTripGivesAFiniteRate)
{
  NodeEstimates e;
  e.addRoundTrip(0.5, 0);
  e.add(timing(60000, 100.0, 0.001), 0);
  EXPECT_TRUE(std::isfinite(e.rate(0)));
  EXPECT_GT(e.rate(0), 0.0);
}

TEST(NodeEstimates, IgnoresNumbersThatAreNone)
{
  NodeEstimates e;
  for (const double bad : {NOT_A_NUMBER, INFINITE, -1.0})
  {
    RequestTiming t = timing(60000, 20.0, 0.01);
    t.total_s = bad;
    e.add(t, 0);
    t = timing(60000, 20.0, 0.01);
    t.service_s = bad;
    e.add(t, 0);
    t = timing(60000, 20.0, 0.01);
    t.queue_s = bad;
    e.add(t, 0);
    e.addRoundTrip(bad, 0);
    e.addTimeout(TaskKind::SPEECH, 1000, bad, 0);
  }
  EXPECT_FALSE(e.roundTrip().known());
  EXPECT_FALSE(e.secondsPerMbit().known());
  EXPECT_FALSE(e.service(TaskKind::DETECTION).known());
}

TEST(NodeEstimates, AdvertisementIsKnownFromTimeZeroOnAndAges)
{
  NodeEstimates e;
  EXPECT_FALSE(e.hasAdvertisement());
  EXPECT_TRUE(std::isinf(e.advertisementAge(seconds(1.0))));
  e.setAdvertisement(NodeAdvertisement(), 0);
  EXPECT_TRUE(e.hasAdvertisement());
  EXPECT_DOUBLE_EQ(e.advertisementAge(seconds(1.5)), 1.5);
  EXPECT_DOUBLE_EQ(e.advertisementAge(seconds(-1.0)), 0.0);
}

TEST(NodeEstimates, AdvertisementOfNonsenseIsMadeHarmless)
{
  NodeAdvertisement a;
  a.of_kind[0].queue_s = NOT_A_NUMBER;
  a.of_kind[0].service_s = -3.0;
  a.of_kind[0].lease_until_s = INFINITE;
  a.of_kind[0].lease_rate_hz = NOT_A_NUMBER;
  a.of_kind[1].queue_s = INFINITE;
  a.capacity_gcycles = -1.0;
  a.has_position = true;
  a.position.x = NOT_A_NUMBER;
  NodeEstimates e;
  e.setAdvertisement(a, 0);
  EXPECT_EQ(e.advertisement().of_kind[0].queue_s, 0.0);
  EXPECT_EQ(e.advertisement().of_kind[0].service_s, 0.0);
  EXPECT_EQ(e.advertisement().of_kind[0].lease_rate_hz, 0.0);
  EXPECT_TRUE(std::isfinite(e.advertisement().of_kind[0].lease_until_s));
  EXPECT_GT(e.advertisement().of_kind[1].queue_s, 1000.0);
  EXPECT_EQ(e.advertisement().capacity_gcycles, 0.0);
  EXPECT_FALSE(e.advertisement().has_position);
}

TEST(NodeEstimates, OptionsNameFieldValueAndBound)
{
  NodeEstimates::Options options;
  options.first_rate_mbps = -3.0;
  try
  {
    options.validate();
    FAIL() << "accepted a negative rate";
  }
  catch (const std::invalid_argument& e)
  {
    EXPECT_NE(std::string(e.what()).find("first_rate_mbps = -3"), std::string::npos) << e.what();
  }
  options = NodeEstimates::Options();
  options.memory_s = NOT_A_NUMBER;
  EXPECT_THROW(NodeEstimates{options}, std::invalid_argument);
}

}  // namespace
