#include <gtest/gtest.h>

#include "simulation/edge_node.h"
#include "simulation/oracle.h"
#include "simulation/simulation.h"

using namespace pi_offload;
using simulation::Arrival;
using simulation::EdgeNode;
using simulation::toNs;
using simulation::World;

namespace
{

/// A street with one node in the middle, without noise, loss or others.
Scenario quiet()
{
  Scenario scenario;
  scenario.duration_s = 60.0;
  scenario.route = {{0, 0}, {100, 0}, {100, 10}, {0, 10}};
  Scenario::Stream detection;
  detection.local_deviation = 0.0;
  scenario.streams = {detection};
  scenario.engine.needs[0] = {0.171, 0.48, 0.008, 0.2};
  scenario.engine.radio.wait_w = 0.5;
  Scenario::Node node;
  node.description.id = "a";
  node.description.address = "a:1";
  node.description.position = {50, 5};
  node.description.range_m = 1000.0;
  node.service_deviation = 0.0;
  scenario.nodes = {node};
  scenario.network.rate_near_mbps = 24.0;
  scenario.network.rate_edge_mbps = 24.0;
  scenario.network.shadowing_db = 0.0;
  scenario.network.round_trip_deviation = 0.0;
  scenario.network.loss = 0.0;
  scenario.load.base_load = 0.0;
  return scenario;
}

Scenario busy()
{
  Scenario scenario = quiet();
  scenario.duration_s = 120.0;
  scenario.network.shadowing_db = 3.0;
  scenario.network.rate_edge_mbps = 8.0;
  scenario.network.round_trip_deviation = 0.3;
  scenario.network.loss = 0.002;
  scenario.nodes[0].description.range_m = 120.0;
  scenario.nodes[0].service_deviation = 0.1;
  scenario.load.heavy_share = 0.4;
  return scenario;
}

const SimulationResult::OfKind& detection(const SimulationResult& result)
{
  return result.of_kind[static_cast<size_t>(TaskKind::DETECTION)];
}

Arrival arrival(uint64_t ticket, double at_s, double remaining_s, double service_s)
{
  Arrival arrival;
  arrival.task.ticket = ticket;
  arrival.task.vehicle = "v";
  arrival.task.arrived_ns = toNs(at_s);
  arrival.task.remaining_s = remaining_s;
  arrival.service_s = service_s;
  return arrival;
}

}  // namespace

TEST(Simulation, LocalPowerIsThatOfTheTasks)
{
  const SimulationResult result = simulate(quiet(), "local", 1);
  EXPECT_EQ(detection(result).tasks, 600U);
  EXPECT_EQ(detection(result).local, 600U);
  EXPECT_EQ(result.missed(), 0U);
  EXPECT_NEAR(result.local_w, 4.2, 1e-9);  // 10 Hz of 0.42 J
  EXPECT_NEAR(detection(result).p99_s, 0.09, 1e-6);
}

TEST(Simulation, OracleTimeAndEnergyAreThoseOfTheFormula)
{
  const SimulationResult result = simulate(quiet(), "oracle", 1);
  EXPECT_EQ(detection(result).remote, 600U);
  EXPECT_EQ(result.missed(), 0U);
  // 0.48 Mbit at 24 Mbit/s, round trip, 20 ms of service, 0.008 Mbit back
  EXPECT_NEAR(detection(result).p50_s, 0.02 + 0.008 + 0.02 + 0.008 / 24.0, 1e-6);
  const double energy_j = 1.2 * 0.02 + 0.9 * 0.008 / 24.0 + 0.5 * 0.028;
  EXPECT_NEAR(result.power_w, 10.0 * energy_j, 1e-3);
}

TEST(Simulation, ExpectedCostIsNearTheOracleWhereNothingHappens)
{
  SimulationResult result = simulate(quiet(), "expected_cost", 1);
  compareWithOracle(simulate(quiet(), "oracle", 1), &result);
  EXPECT_EQ(result.missed(), 0U);
  EXPECT_LT(result.regret(), 0.15);
  EXPECT_GT(detection(result).remote, 580U);
}

TEST(Simulation, SameSeedSameResultOtherSeedAnother)
{
  const SimulationResult a = simulate(busy(), "expected_cost", 3);
  const SimulationResult b = simulate(busy(), "expected_cost", 3);
  const SimulationResult c = simulate(busy(), "expected_cost", 4);
  EXPECT_EQ(a.power_w, b.power_w);
  EXPECT_EQ(a.missed(), b.missed());
  EXPECT_EQ(a.fallback_reasons, b.fallback_reasons);
  EXPECT_NE(a.power_w, c.power_w);
}

TEST(Simulation, EveryTaskIsCountedOnceWhateverThePolicy)
{
  Scenario scenario = busy();
  scenario.failures.mean_between_s = 20.0;
  scenario.failures.mean_repair_s = 5.0;
  std::vector<std::string> policies = policyNames();
  policies.emplace_back("oracle");
  policies.emplace_back("informed");
  for (const std::string& policy : policies)
  {
    const SimulationResult result = simulate(scenario, policy, 2);
    const SimulationResult::OfKind& of = detection(result);
    EXPECT_EQ(of.tasks, 1200U) << policy;
    EXPECT_EQ(of.local + of.remote + of.fallback, of.tasks) << policy;
    EXPECT_LE(of.remote_late, of.remote) << policy;
    EXPECT_NEAR(result.power_w, result.local_w + result.fallback_w + result.radio_w, 1e-9) << policy;
    EXPECT_EQ(result.served, of.remote - of.remote_late) << policy;
  }
}

TEST(Simulation, OracleMissesNothingThatTheVehicleCouldDo)
{
  const SimulationResult oracle = simulate(busy(), "oracle", 5);
  EXPECT_LE(detection(oracle).miss_share(), 0.002);
  for (const char* policy : {"local", "paper", "deadline", "expected_cost"})
  {
    SimulationResult result = simulate(busy(), policy, 5);
    compareWithOracle(oracle, &result);
    EXPECT_GT(result.regret(), 0.0) << policy;
  }
}

TEST(Simulation, NearestAnywhereMissesWhereNoNodeIsInRange)
{
  Scenario scenario = quiet();
  scenario.nodes[0].description.range_m = 20.0;
  const SimulationResult anywhere = simulate(scenario, "nearest_anywhere", 1);
  const SimulationResult nearest = simulate(scenario, "nearest", 1);
  EXPECT_GT(detection(anywhere).miss_share(), 0.3);
  EXPECT_LT(detection(nearest).miss_share(), 0.02);
  EXPECT_GT(anywhere.power_w, nearest.power_w);
}

TEST(Simulation, SlowUplinkIsSharedByTheVehiclesTasks)
{
  Scenario scenario = quiet();
  scenario.network.rate_near_mbps = 4.0;  // 120 ms of each 100 ms
  scenario.network.rate_edge_mbps = 4.0;
  const SimulationResult nearest = simulate(scenario, "nearest", 1);
  EXPECT_GT(detection(nearest).miss_share(), 0.3);
  const SimulationResult oracle = simulate(scenario, "oracle", 1);
  EXPECT_EQ(oracle.missed(), 0U);
  EXPECT_GT(detection(oracle).local, 100U);
  EXPECT_GT(detection(oracle).remote, 100U);
}

TEST(Simulation, TasksComeHomeWhenNodesFail)
{
  Scenario scenario = quiet();
  scenario.duration_s = 300.0;
  scenario.failures.mean_between_s = 20.0;
  scenario.failures.mean_repair_s = 5.0;
  const SimulationResult result = simulate(scenario, "expected_cost", 1);
  EXPECT_GT(detection(result).fallback, 0U);
  EXPECT_GT(detection(result).local, 100U);
  EXPECT_LT(detection(result).miss_share(), 0.01);
  EXPECT_GT(detection(result).remote, 1000U);
}

TEST(Simulation, OverloadIsSharedFairlyAndShedByRefusals)
{
  Scenario scenario = quiet();
  scenario.duration_s = 30.0;
  scenario.vehicles = 30;
  scenario.nodes[0].service_s = {0.03, 0.15};
  scenario.nodes[0].workers = 4;  // 133 tasks per second of 300
  const SimulationResult result = simulate(scenario, "expected_cost", 1);
  ASSERT_EQ(result.tasks_of_vehicle.size(), 30U);
  EXPECT_GT(result.busy_share, 0.8);
  EXPECT_GE(result.fairness(), 0.9);
  for (const double served : result.tasks_of_vehicle)
  {
    EXPECT_GT(served, 10.0);
  }
  EXPECT_GT(result.refused + result.expired, 10 * result.timeouts);
}

TEST(Simulation, UnknownPolicyIsNamed)
{
  try
  {
    simulate(quiet(), "best", 1);
    FAIL() << "no error";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_NE(std::string(error.what()).find("\"best\""), std::string::npos);
  }
}

TEST(Simulation, InvalidScenarioIsNotRun)
{
  Scenario scenario = quiet();
  scenario.speed = -1.0;
  EXPECT_THROW(simulate(scenario, "local", 1), std::invalid_argument);
}

TEST(SimulationResult, RegretAndFairnessFollowTheirFormulas)
{
  SimulationResult oracle;
  oracle.power_w = 2.0;
  oracle.task_seconds = 100.0;
  SimulationResult result;
  result.power_w = 3.0;
  result.task_seconds = 100.0;
  result.of_kind[0].missed = 5;
  EXPECT_EQ(result.regret(), 0.0);
  compareWithOracle(oracle, &result);
  EXPECT_DOUBLE_EQ(result.regret(), 0.5);
  EXPECT_DOUBLE_EQ(result.regret(20.0), 1.0);  // 3 W + 20 J * 5 / 100 s = 4 W
  EXPECT_DOUBLE_EQ(result.fairness(), 1.0);
  result.tasks_of_vehicle = {1.0, 1.0, 0.0, 0.0};
  EXPECT_DOUBLE_EQ(result.fairness(), 0.5);
}

TEST(EdgeNode, CopyGoesItsOwnWay)
{
  Scenario scenario = quiet();
  const World world(scenario, 1);
  EdgeNode node(world, 0);
  std::vector<EdgeNode::End> ends;
  node.advance(toNs(1.0), &ends);
  ASSERT_EQ(node.arrive(arrival(1, 1.0, 0.5, 0.02), &ends), Admission::Verdict::TAKEN);
  EdgeNode copy = node;
  copy.advance(toNs(2.0), &ends);
  ASSERT_EQ(ends.size(), 1U);
  EXPECT_EQ(ends[0].ticket, 1U);
  EXPECT_TRUE(ends[0].done);
  EXPECT_EQ(ends[0].at_ns, toNs(1.02));
  ends.clear();
  EXPECT_EQ(node.nextTime(), toNs(1.02));
  node.advance(toNs(1.02), &ends);
  EXPECT_EQ(ends.size(), 1U);
}

TEST(EdgeNode, TasksWaitForAWorker)
{
  Scenario scenario = quiet();
  scenario.nodes[0].workers = 1;
  const World world(scenario, 1);
  EdgeNode node(world, 0);
  std::vector<EdgeNode::End> ends;
  node.arrive(arrival(1, 0.0, 1.0, 0.1), &ends);
  node.arrive(arrival(2, 0.0, 1.0, 0.1), &ends);
  node.advance(toNs(1.0), &ends);
  ASSERT_EQ(ends.size(), 2U);
  EXPECT_EQ(ends[1].at_ns, toNs(0.2));
  EXPECT_NEAR(ends[1].queue_s, 0.1, 1e-9);
  EXPECT_NEAR(node.busy_s(), 0.2, 1e-9);
}

TEST(EdgeNode, RestartLosesWhatItHad)
{
  const Scenario scenario = quiet();
  const World world(scenario, 1);
  EdgeNode node(world, 0);
  std::vector<EdgeNode::End> ends;
  node.arrive(arrival(1, 0.0, 1.0, 0.1), &ends);
  node.restart(toNs(0.05));
  node.advance(toNs(1.0), &ends);
  EXPECT_TRUE(ends.empty());
  EXPECT_EQ(node.nextTime(), INT64_MAX);
}

TEST(Oracle, ForeseesTheQueueWithoutChangingIt)
{
  Scenario scenario = quiet();
  scenario.nodes[0].workers = 1;
  const World world(scenario, 1);
  EdgeNode node(world, 0);
  std::vector<EdgeNode::End> ends;
  node.arrive(arrival(1, 0.0, 1.0, 0.1), &ends);
  const simulation::PendingArrival under_way{toNs(0.01), arrival(2, 0.01, 1.0, 0.1)};
  const simulation::PendingArrival mine{toNs(0.02), arrival(3, 0.02, 1.0, 0.05)};
  const std::optional<int64_t> end_ns = foreseeEnd(node, {under_way}, mine, toNs(1.0));
  ASSERT_TRUE(end_ns);
  EXPECT_EQ(*end_ns, toNs(0.25));
  EXPECT_FALSE(foreseeEnd(node, {under_way}, mine, toNs(0.2)));
  node.advance(toNs(1.0), &ends);
  EXPECT_EQ(ends.size(), 1U);
}
