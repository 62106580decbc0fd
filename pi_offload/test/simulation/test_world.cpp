#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "simulation/loop_route.h"
#include "simulation/world.h"

using namespace pi_offload;
using simulation::LoopRoute;
using simulation::toNs;
using simulation::World;

namespace
{

Scenario square()
{
  Scenario scenario;
  scenario.duration_s = 200.0;
  scenario.route = {{0, 0}, {100, 0}, {100, 100}, {0, 100}};
  Scenario::Stream detection;
  Scenario::Stream speech;
  speech.kind = TaskKind::SPEECH;
  speech.rate_hz = 0.5;
  speech.regular = false;
  speech.deadline_s = 0.5;
  scenario.streams = {detection, speech};
  scenario.engine.needs[0].deadline_s = 0.2;
  scenario.engine.needs[1].deadline_s = 0.5;
  Scenario::Node node;
  node.description.id = "a";
  node.description.address = "a:1";
  node.description.position = {50, 50};
  node.description.range_m = 60.0;
  scenario.nodes = {node};
  return scenario;
}

/// Part of the workers' time that the others ask for.
double othersLoad(const Scenario& scenario, const World& world)
{
  double sum_s = 0.0;
  for (const simulation::OthersTask& task : world.others(0))
  {
    sum_s += task.arrived_ns < toNs(scenario.duration_s) ? task.service_s : 0.0;
  }
  return sum_s / (scenario.duration_s * scenario.nodes[0].workers);
}

}  // namespace

TEST(LoopRoute, GoesRoundAndRound)
{
  const LoopRoute route({{0, 0}, {100, 0}, {100, 100}, {0, 100}});
  EXPECT_DOUBLE_EQ(route.length(), 400.0);
  EXPECT_NEAR(route.at(150.0).x, 100.0, 1e-9);
  EXPECT_NEAR(route.at(150.0).y, 50.0, 1e-9);
  EXPECT_NEAR(route.at(350.0).y, 50.0, 1e-9);  // on the way back to the start
  EXPECT_NEAR(route.at(450.0).x, 50.0, 1e-9);
  EXPECT_NEAR(route.at(400.0).x, 0.0, 1e-9);
}

TEST(LoopRoute, HeadsFromNorthClockwise)
{
  const LoopRoute route({{0, 0}, {100, 0}, {100, 100}, {0, 100}});
  EXPECT_NEAR(route.heading(50.0), M_PI / 2.0, 1e-9);
  EXPECT_NEAR(route.heading(150.0), 0.0, 1e-9);
  EXPECT_NEAR(route.heading(250.0), -M_PI / 2.0, 1e-9);
}

TEST(LoopRoute, AheadIsOnceAroundFromHere)
{
  const LoopRoute route({{0, 0}, {100, 0}, {100, 100}, {0, 100}});
  const std::vector<Point> ahead = route.ahead(150.0);
  ASSERT_EQ(ahead.size(), 6U);
  EXPECT_NEAR(ahead[1].y, 100.0, 1e-9);
  EXPECT_NEAR(ahead[2].x, 0.0, 1e-9);
  EXPECT_NEAR(ahead.front().y, ahead.back().y, 1e-9);
  double length = 0.0;
  for (size_t i = 1; i < ahead.size(); ++i)
  {
    length += std::hypot(ahead[i].x - ahead[i - 1].x, ahead[i].y - ahead[i - 1].y);
  }
  EXPECT_NEAR(length, 400.0, 1e-9);
}

TEST(LoopRoute, NeedsALength)
{
  EXPECT_THROW(LoopRoute({}), std::invalid_argument);
  EXPECT_THROW(LoopRoute({{1, 1}, {1, 1}}), std::invalid_argument);
}

TEST(World, IsAFunctionOfScenarioAndSeed)
{
  const Scenario scenario = square();
  const World a(scenario, 7);
  const World b(scenario, 7);
  const World c(scenario, 8);
  ASSERT_EQ(a.tasks(0).size(), b.tasks(0).size());
  bool differs = false;
  for (int64_t t = 0; t < toNs(100.0); t += toNs(0.37))
  {
    EXPECT_EQ(a.rate_mbps(0, 0, t), b.rate_mbps(0, 0, t));
    EXPECT_EQ(a.vehicle(0, t).position.x, b.vehicle(0, t).position.x);
    differs = differs || a.rate_mbps(0, 0, t) != c.rate_mbps(0, 0, t);
  }
  EXPECT_TRUE(differs);
  const Task& task = a.tasks(0)[5];
  EXPECT_EQ(a.service_s(0, task), b.service_s(0, task));
  EXPECT_EQ(a.uplink_latency_s(0, 0, task.id), b.uplink_latency_s(0, 0, task.id));
  EXPECT_NE(a.service_s(0, task), c.service_s(0, task));
}

TEST(World, TasksComeAtTheirRatesWithIdsOfTheirOwn)
{
  Scenario scenario = square();
  scenario.vehicles = 3;
  const World world(scenario, 1);
  std::set<uint64_t> ids;
  size_t speech = 0;
  for (size_t v = 0; v < 3; ++v)
  {
    int64_t last_ns = 0;
    size_t detections = 0;
    for (const Task& task : world.tasks(v))
    {
      EXPECT_TRUE(ids.insert(task.id).second);
      EXPECT_GE(task.created_ns, last_ns);
      last_ns = task.created_ns;
      detections += task.kind == TaskKind::DETECTION ? 1 : 0;
      speech += task.kind == TaskKind::SPEECH ? 1 : 0;
    }
    EXPECT_EQ(detections, 2000U);
  }
  EXPECT_NEAR(static_cast<double>(speech), 300.0, 5.0 * std::sqrt(300.0));  // Poisson
}

TEST(World, VehicleDrivesAtItsSpeed)
{
  const Scenario scenario = square();
  const World world(scenario, 3);
  const VehicleState before = world.vehicle(0, 0);
  const VehicleState after = world.vehicle(0, toNs(400.0 / 3.0));  // once around
  EXPECT_NEAR(before.position.x, after.position.x, 1e-6);
  EXPECT_NEAR(before.position.y, after.position.y, 1e-6);
  EXPECT_DOUBLE_EQ(before.speed, 3.0);
}

TEST(World, RateFallsWithDistanceAndIsNoneOutOfRange)
{
  Scenario scenario = square();
  scenario.network.shadowing_db = 0.0;
  const World world(scenario, 3);
  for (int64_t t = 0; t < toNs(130.0); t += toNs(0.5))
  {
    const Point at = world.vehicle(0, t).position;
    const double distance = std::hypot(at.x - 50.0, at.y - 50.0);
    const double expected = distance > 60.0 ? 0.0 : 40.0 * std::pow(6.0 / 40.0, distance / 60.0);
    EXPECT_NEAR(world.rate_mbps(0, 0, t), expected, 1e-6);
  }
}

TEST(World, ShadowingHasItsDeviationAndCorrelation)
{
  Scenario scenario = square();
  scenario.duration_s = 20000.0;
  scenario.nodes[0].description.range_m = 1e6;  // the distance makes no difference then
  const World world(scenario, 5);
  const double step_s = scenario.network.correlation_m / scenario.speed;
  std::vector<double> db;
  for (double t = 0.0; t < scenario.duration_s; t += step_s)
  {
    db.push_back(10.0 * std::log10(world.rate_mbps(0, 0, toNs(t)) / 40.0));
  }
  double square_sum = 0.0;
  double product_sum = 0.0;
  for (size_t i = 0; i + 1 < db.size(); ++i)
  {
    square_sum += db[i] * db[i];
    product_sum += db[i] * db[i + 1];
  }
  const auto count = static_cast<double>(db.size());
  EXPECT_NEAR(std::sqrt(square_sum / count), 4.0, 0.2);
  EXPECT_NEAR(product_sum / square_sum, std::exp(-1.0), 0.06);
}

TEST(World, MessagesTakeHalfARoundTripAndSometimesARetransmission)
{
  Scenario scenario = square();
  scenario.network.loss = 0.1;
  const World world(scenario, 2);
  double sum_s = 0.0;
  int lost = 0;
  constexpr int COUNT = 20000;
  for (uint64_t key = 1; key <= COUNT; ++key)
  {
    const double latency_s = world.uplink_latency_s(0, 0, key);
    lost += latency_s >= 0.2 ? 1 : 0;
    sum_s += latency_s >= 0.2 ? latency_s - 0.2 : latency_s;
    EXPECT_NE(latency_s, world.downlink_latency_s(0, 0, key));
  }
  EXPECT_NEAR(sum_s / COUNT, 0.004, 5e-5);
  EXPECT_NEAR(lost, 2000, 5 * 43);  // binomial
}

TEST(World, TimesOfTasksHaveTheirMeans)
{
  const Scenario scenario = square();
  const World world(scenario, 2);
  double service_s = 0.0;
  double local_s = 0.0;
  size_t count = 0;
  for (const Task& task : world.tasks(0))
  {
    if (task.kind == TaskKind::DETECTION)
    {
      service_s += world.service_s(0, task);
      local_s += world.local_s(task);
      ++count;
    }
  }
  EXPECT_NEAR(service_s / static_cast<double>(count), 0.02, 0.0003);
  EXPECT_NEAR(local_s / static_cast<double>(count), 0.09, 0.0006);
}

TEST(World, OthersAskForTheLoadOfTheScenario)
{
  Scenario scenario = square();
  scenario.duration_s = 5000.0;
  scenario.load.base_load = 0.3;
  EXPECT_NEAR(othersLoad(scenario, World(scenario, 1)), 0.3, 0.02);
  scenario.load.heavy_share = 0.4;
  scenario.load.heavy_load = 1.0;
  EXPECT_NEAR(othersLoad(scenario, World(scenario, 1)), 0.6 * 0.3 + 0.4, 0.05);
  scenario.load.heavy_share = 1.0;
  EXPECT_NEAR(othersLoad(scenario, World(scenario, 1)), 1.0, 0.05);
  scenario.load.heavy_share = 0.0;
  scenario.load.base_load = 0.0;
  EXPECT_TRUE(World(scenario, 1).others(0).empty());
}

TEST(World, OthersComeInOrderInBursts)
{
  Scenario scenario = square();
  scenario.duration_s = 3000.0;
  scenario.load.base_load = 0.0;
  scenario.load.heavy_share = 0.2;
  const World world(scenario, 4);
  int64_t last_ns = 0;
  size_t gaps = 0;
  for (const simulation::OthersTask& task : world.others(0))
  {
    EXPECT_GE(task.arrived_ns, last_ns);
    gaps += task.arrived_ns - last_ns > toNs(1.0) ? 1 : 0;
    last_ns = task.arrived_ns;
  }
  // A burst each 15 s: 3 s of tasks, 12 s without.
  EXPECT_NEAR(static_cast<double>(gaps), 200.0, 60.0);
}

TEST(World, NodesFailAsOftenAsTheScenarioSays)
{
  Scenario scenario = square();
  scenario.duration_s = 50000.0;
  EXPECT_TRUE(World(scenario, 1).outages(0).empty());
  scenario.failures.mean_between_s = 80.0;
  scenario.failures.mean_repair_s = 20.0;
  const World world(scenario, 1);
  double down_s = 0.0;
  size_t silent = 0;
  int64_t last_ns = 0;
  for (const simulation::Outage& outage : world.outages(0))
  {
    EXPECT_GT(outage.begin_ns, last_ns);
    EXPECT_GT(outage.end_ns, outage.begin_ns);
    last_ns = outage.end_ns;
    down_s += simulation::toS(outage.end_ns - outage.begin_ns);
    silent += outage.silent ? 1 : 0;
    EXPECT_EQ(world.outage(0, outage.begin_ns), &outage);
    EXPECT_EQ(world.outage(0, outage.end_ns), nullptr);
  }
  EXPECT_NEAR(down_s / 50000.0, 0.2, 0.04);
  EXPECT_NEAR(static_cast<double>(silent) / static_cast<double>(world.outages(0).size()), 0.5, 0.1);
}
