#include "policies/policy.h"

#include <gtest/gtest.h>

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
  node.leased = true;
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

TEST(ExpectedCostFallback, IsGivenUpWhereTheAnswerComesSurelyBetweenItAndTheDeadline)
{
  DecisionInput input = picture();
  input.nodes[0].network_s = {0.11, 0.004};
  input.nodes[0].uplink_mbps = 4.5;
  const Decision decision = decide(input);
  EXPECT_EQ(decision.node, 0);
  EXPECT_DOUBLE_EQ(decision.timeout_s, 0.2);
  EXPECT_LT(decision.expected_misses, 0.01);
  input.nodes[0].network_s.deviation = 0.03;
  EXPECT_EQ(decide(input).node, -1) << "neither with nor without a fallback";
}

TEST(ExpectedCostFallback, IsNotGivenUpWhereTheNodeRefusedLately)
{
  DecisionInput input = picture();
  input.nodes[0].network_s = {0.11, 0.004};
  input.nodes[0].uplink_mbps = 4.5;
  input.nodes[0].refused_share = 0.1;
  EXPECT_EQ(decide(input).node, -1);
}

TEST(ExpectedCostCuriosity, MeasuresARateThatIsOldAndMayBeGood)
{
  DecisionInput input = picture();
  input.nodes[0].network_s = {0.11, 0.05};
  input.nodes[0].network_age_s = 0.05;
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
