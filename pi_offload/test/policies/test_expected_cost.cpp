#include <gtest/gtest.h>

#include "policies/policy.h"

using namespace pi_offload;

namespace
{

/// A node in range that answers a picture in 60 ms, where the vehicle needs 90 ms and has 200.
DecisionInput picture()
{
  NodeView node;
  node.id = "a";
  node.connected = true;
  node.distance_m = 10.0;
  node.range_m = 100.0;
  node.residence_s = 30.0;
  node.capacity_gcycles = 10.0;
  node.frequency_ghz = 10.0;
  node.uplink_mbps = 12.0;
  node.downlink_mbps = 12.0;
  node.network_s = {0.04, 0.002};
  node.service_s = {0.02, 0.001};
  DecisionInput input;
  input.needs = {0.171, 0.48, 0.008, 0.2};
  input.local_s = 0.09;
  input.local_j = 0.42;
  input.nodes = {node};
  return input;
}

Decision decide(const DecisionInput& input, const PolicyOptions& options = {})
{
  return makePolicy("expected_cost", options)->decide(input);
}

}  // namespace

TEST(ExpectedCostFallback, IsKeptWhereTheAnswerComesBeforeIt)
{
  const Decision decision = decide(picture());
  EXPECT_EQ(decision.node, 0);
  EXPECT_NEAR(decision.timeout_s, 0.101, 1e-9);
}

TEST(ExpectedCostFallback, IsNeverGivenUpForAnAnswerThatComesLater)
{
  DecisionInput input = picture();
  input.nodes[0].network_s = {0.11, 0.004};
  input.nodes[0].uplink_mbps = 4.5;
  EXPECT_EQ(decide(input).node, -1) << "a node that fails without a word would cost the deadline";
}

TEST(ExpectedCostFallback, BeginsEarlierWhereTheVehicleNeedsMore)
{
  DecisionInput input = picture();
  input.local_need_s = 0.12;
  EXPECT_NEAR(decide(input).timeout_s, 0.08, 1e-9);
}

TEST(ExpectedCostGuard, ANodeThatLostAgainstTheVehicleGetsNoTasks)
{
  DecisionInput input = picture();
  input.nodes[0].lost = true;
  EXPECT_EQ(decide(input).node, -1);
}

TEST(ExpectedCostGuard, HysteresisNeverKeepsATaskAtANodeDearerThanTheVehicle)
{
  DecisionInput input = picture();
  input.local_j = 0.9 * decide(input).expected_j;
  input.previous_node = 0;
  PolicyOptions options;
  options.hysteresis = 0.5;
  EXPECT_EQ(decide(input, options).node, -1);
}

TEST(ExpectedCostTimes, TheSeenDistributionDecidesNotTheDeviation)
{
  DecisionInput input = picture();
  AnswerTimes slow;
  for (int i = 0; i < 1000; ++i)
  {
    slow.add(0.0);
  }
  input.nodes[0].times = &slow;
  EXPECT_EQ(decide(input).node, 0);
  for (int i = 0; i < 2000; ++i)
  {
    slow.add(60.0);
  }
  EXPECT_EQ(decide(input).node, -1) << "it answers late nearly always";
}

TEST(ExpectedCostHedge, IsDueWhereTheRestOfTheAnswersIsFarOut)
{
  DecisionInput input = picture();
  input.radio.wait_w = 0.9;
  AnswerTimes times;
  for (int i = 0; i < 1000; ++i)
  {
    times.add(i % 5 == 0 ? 60.0 : 0.1);
  }
  input.nodes[0].times = &times;
  EXPECT_EQ(decide(input).hedge_s, 0.0) << "there is no second node";
  input.nodes.push_back(input.nodes[0]);
  input.nodes[1].id = "b";
  input.nodes[1].network_s.mean = 0.01;
  input.nodes[1].uplink_mbps = 6.0;
  input.nodes[1].service_s.mean = 0.025;
  std::swap(input.nodes[0], input.nodes[1]);
  input.nodes[0].times = nullptr;
  input.previous_node = 1;
  PolicyOptions options;
  options.hysteresis = 0.9;  // at the slow one
  const Decision decision = decide(input, options);
  ASSERT_EQ(decision.node, 1);
  EXPECT_GT(decision.hedge_s, 0.055);
  EXPECT_LT(decision.hedge_s, 0.08);
  options.hedge_share = 0.0;
  EXPECT_EQ(decide(input, options).hedge_s, 0.0);
}

TEST(ExpectedCostFallback, BeginsWhenNoAnswerIsLikelyAnyMore)
{
  DecisionInput input = picture();
  AnswerTimes times;
  for (int i = 0; i < 1000; ++i)
  {
    times.add(i % 10 == 0 ? 60.0 : 0.1);
  }
  input.nodes[0].times = &times;
  EXPECT_GT(decide(input).timeout_s, 0.095) << "waiting costs nothing";
  input.radio.wait_w = 0.9;
  const Decision decision = decide(input);
  ASSERT_EQ(decision.node, 0);
  EXPECT_GT(decision.timeout_s, 0.06);
  EXPECT_LT(decision.timeout_s, 0.085);
  input.local_backlog_s = 0.09;
  EXPECT_GT(decide(input).timeout_s, 0.089) << "the vehicle is busy before";
}

TEST(ExpectedCostCuriosity, MeasuresARateThatIsOldAndMayBeGood)
{
  DecisionInput input = picture();
  input.radio.wait_w = 0.9;
  input.nodes[0].network_s = {0.11, 0.05};
  input.nodes[0].network_age_s = 0.0;
  ASSERT_EQ(decide(input).node, -1);
  input.nodes[0].network_age_s = 1.0;
  const Decision decision = decide(input);
  EXPECT_EQ(decision.node, 0);
  EXPECT_LT(decision.timeout_s, 0.102) << "with a fallback";
  input.nodes[0].network_s = {0.2, 0.035};
  EXPECT_EQ(decide(input).node, -1) << "it can hardly be good";
}

TEST(ExpectedCostCuriosity, RestsWhereAFallbackWouldBeLate)
{
  DecisionInput input = picture();
  input.nodes[0].network_s = {0.16, 0.04};
  input.nodes[0].network_age_s = 1.0;
  input.local_backlog_s = 0.105;
  EXPECT_EQ(decide(input).node, -1);
}
