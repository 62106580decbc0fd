#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "policies/answer_times.h"

using pi_offload::AnswerTimes;

namespace
{

constexpr double LOSS = 0.002;

}  // namespace

TEST(AnswerTimes, BeginAsLaplaceWithLosses)
{
  const AnswerTimes times;
  EXPECT_NEAR(times.beyond(0.0, LOSS), LOSS + (1.0 - LOSS) * 0.5, 1e-12);
  EXPECT_NEAR(times.beyond(2.0, LOSS), LOSS + (1.0 - LOSS) * 0.5 * std::exp(-2.0), 1e-12);
  EXPECT_NEAR(times.beyond(-1.0, LOSS), LOSS + (1.0 - LOSS) * (1.0 - 0.5 * std::exp(-1.0)), 1e-12);
  EXPECT_NEAR(times.beyond(1e9, LOSS), LOSS, 1e-12);
}

TEST(AnswerTimes, BecomeThoseThatWereSeen)
{
  AnswerTimes times;
  std::mt19937 random(3);
  std::lognormal_distribution<double> value(0.0, 1.0);
  std::vector<double> last;
  for (int i = 0; i < 3000; ++i)
  {
    last.push_back(value(random));
    times.add(last.back());
  }
  // 600 answers count, within 20 of the prior: 4 standard errors of a share of a tenth are 0.05.
  EXPECT_NEAR(times.beyond(std::exp(1.2816), LOSS), 0.1, 0.05);
  EXPECT_NEAR(times.beyond(1.0, LOSS), 0.5, 0.08);
  EXPECT_LT(times.beyond(60.0, LOSS), 0.01);
}

TEST(AnswerTimes, RareSlowAnswersAreSeenThatADeviationHides)
{
  AnswerTimes times;
  for (int i = 0; i < 1000; ++i)
  {
    times.add(i % 20 == 0 ? 50.0 : 0.0);
  }
  EXPECT_NEAR(times.beyond(10.0, LOSS), 0.05, 0.015);
  EXPECT_LT(times.beyond(1.0, LOSS), 0.1);
  EXPECT_GT(times.beyond(40.0, LOSS), 0.02);
}

TEST(AnswerTimes, AnUnansweredRequestCountsAboveWhatWasWaitedFor)
{
  AnswerTimes times;
  for (int i = 0; i < 300; ++i)
  {
    times.add(0.0);
  }
  const double before = times.beyond(3.0, LOSS);
  for (int i = 0; i < 100; ++i)
  {
    times.addBeyond(3.0);
  }
  EXPECT_GT(times.beyond(3.0, LOSS), 0.2);
  EXPECT_GT(times.beyond(100.0, LOSS), 0.2) << "no later answer was seen: never";
  EXPECT_LT(before, 0.02);
}

TEST(AnswerTimes, AnUnansweredRequestMayBeOneOfTheLaterAnswers)
{
  AnswerTimes times;
  for (int i = 0; i < 200; ++i)
  {
    times.add(8.0);
    times.addBeyond(2.0);
  }
  EXPECT_GT(times.beyond(6.0, LOSS), 0.9);
  EXPECT_LT(times.beyond(20.0, LOSS), 0.1);
}

TEST(AnswerTimes, ForgetWhatWasLongAgo)
{
  AnswerTimes times;
  for (int i = 0; i < 500; ++i)
  {
    times.add(30.0);
  }
  for (int i = 0; i < 1500; ++i)
  {
    times.add(0.0);
  }
  EXPECT_LT(times.beyond(10.0, LOSS), 0.02);
}

TEST(AnswerTimes, OneNodeBeginsAsAllOthers)
{
  AnswerTimes all;
  const AnswerTimes one(&all);
  for (int i = 0; i < 500; ++i)
  {
    all.add(6.0);
  }
  EXPECT_EQ(one.beyond(5.0, LOSS), all.beyond(5.0, LOSS));
  EXPECT_GT(one.beyond(5.0, LOSS), 0.9);
}

TEST(AnswerTimes, IgnoreWhatIsNoNumber)
{
  AnswerTimes times;
  times.add(std::numeric_limits<double>::quiet_NaN());
  times.addBeyond(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(times.beyond(0.0, 0.0), 0.5);
  times.add(std::numeric_limits<double>::infinity());
  EXPECT_GT(times.beyond(1000.0, 0.0), 0.0);
}
