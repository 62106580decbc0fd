#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <map>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "engine/engine_world.h"

namespace
{
size_t allocations = 0;
}  // namespace

// Not inlined: GCC 12 then takes the pair for a mismatched one (-Wmismatched-new-delete).
[[gnu::noinline]] void* operator new(size_t size)
{
  ++allocations;
  if (void* memory = std::malloc(size))
  {
    return memory;
  }
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept
{
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, size_t /*size*/) noexcept
{
  std::free(memory);
}

namespace
{
using namespace pi_offload_test;

TEST(OffloadEngineNodes, NodeWithoutAnswersIsUsedAgainOnceAProbeIsAnswered)
{
  EngineOptions options = World::withPolicy("nearest");
  World w(options);
  w.addNode(node("a"));
  for (uint64_t id = 1; id <= 3; ++id)
  {
    EXPECT_TRUE(w.status("a").connected) << id;
    w.submit(id);
    w.advance(200);  // nearest has no early fallback
    w.engine.onLocalDone(id, 0.1, w.now);
  }
  EXPECT_FALSE(w.status("a").connected);
  w.answerProbes("a");
  EXPECT_TRUE(w.status("a").connected);
}

TEST(OffloadEngineNodes, OneAnswerBetweenTimeoutsKeepsTheNodeConnected)
{
  World w(World::withPolicy("nearest"));
  w.addNode(node("a"));
  for (uint64_t id = 1; id <= 4; ++id)
  {
    w.submit(id);
    if (id % 2 == 0)
    {
      w.reply(w.sent.back());
      continue;
    }
    w.advance(200);
    w.engine.onLocalDone(id, 0.1, w.now);
  }
  w.answerProbes("a");
  EXPECT_TRUE(w.status("a").connected);
}

TEST(OffloadEngineNodes, ProbesNodesInRangeOftenAndOthersRarely)
{
  World w;
  w.engine.setVehicle(at(0.0, 0.0, 0.0, 0.0));
  w.addNode(node("near", 50.0));
  w.addNode(node("far", 50.0, {500.0, 0.0}));
  std::map<std::string, int> count;
  const int64_t end = w.now + ms(10000);
  while (w.now < end)
  {
    w.now = std::min(end, w.engine.nextTime());
    w.engine.onTime(w.now);
    const std::vector<World::Sent> asked = std::exchange(w.probes, {});
    for (const World::Sent& probe : asked)
    {
      ++count[probe.node];
      w.engine.onProbeReply(probe.node, probe.request, 0.004, advertisement(), w.now);
    }
  }
  EXPECT_EQ(count["near"], 50);
  EXPECT_EQ(count["far"], 5);
}

TEST(OffloadEngineNodes, TasksAnswersSpareProbes)
{
  World w;
  w.addNode(node("a"));
  for (uint64_t id = 1; id <= 50; ++id)
  {
    w.submit(id);
    w.now += ms(60);
    w.reply(w.sent.back());
    w.engine.onTime(w.now);
    w.now += ms(40);
    w.engine.onTime(w.now);
  }
  EXPECT_TRUE(w.probes.empty());
}

TEST(OffloadEngineNodes, HasOneProbeUnderWayAndCountsItLostAfterASecond)
{
  World w;
  w.engine.setNode(node("a"), w.now);
  w.engine.onTime(w.now);
  ASSERT_EQ(w.probes.size(), 1U);
  w.advance(999);
  EXPECT_EQ(w.probes.size(), 1U);
  EXPECT_EQ(w.engine.nextTime(), w.now + ms(1));
  w.advance(1);
  EXPECT_EQ(w.probes.size(), 2U);
  // The first one's answer is late: the node lives, but its round trip is not that of the probe under way.
  w.engine.onProbeReply("a", w.probes[0].request, 1.0, advertisement(), w.now);
  EXPECT_EQ(w.status("a").round_trip_s, 0.0);
  w.advance(999);
  EXPECT_EQ(w.probes.size(), 2U);
}

TEST(OffloadEngineNodes, LinkThatTakesNoProbeIsAskedAgainLater)
{
  World w;
  w.link = false;
  w.engine.setNode(node("a"), w.now);
  w.engine.onTime(w.now);
  EXPECT_EQ(w.probes.size(), 1U);
  EXPECT_EQ(w.engine.nextTime(), w.now + ms(200));
}

TEST(OffloadEngineNodes, NodeThatWasNotHeardOfForASecondIsNotConnected)
{
  World w;
  w.addNode(node("a"));
  w.now += ms(1000);
  EXPECT_TRUE(w.status("a").connected);
  w.now += 1;
  EXPECT_FALSE(w.status("a").connected);
  EXPECT_EQ(w.submit(1).node, -1);
}

TEST(OffloadEngineNodes, LinkThatTakesNothingLeavesTheTaskToTheVehicle)
{
  World w;
  w.addNode(node("a"));
  w.link = false;
  const Decision decision = w.submit(1);
  EXPECT_EQ(decision.node, -1);
  EXPECT_EQ(w.locals, std::vector<uint64_t>{1});
  EXPECT_EQ(w.engine.lastNode(TaskKind::DETECTION), "");
  EXPECT_EQ(w.status("a").sent, 0U);
  w.engine.onLocalDone(1, 0.1, w.now);
  EXPECT_EQ(w.outcomes.at(0).how, Outcome::How::FALLBACK);
  EXPECT_NEAR(w.outcomes[0].energy_j, 0.42, 1e-4);
}

TEST(OffloadEngineNodes, UsesNodesInRangeOnly)
{
  World w;
  w.addNode(node("a", 100.0));
  EXPECT_EQ(w.submit(1).node, -1);  // nobody knows where the vehicle is
  w.engine.setVehicle(at(150.0, 0.0));
  EXPECT_EQ(w.submit(2).node, -1);
  w.engine.setVehicle(at(50.0, 0.0));
  EXPECT_LE(w.engine.nextTime(), w.now);  // it is asked at once
  w.answerProbes("a");
  EXPECT_EQ(w.submit(3).node, 0);
  w.engine.setVehicle(at(NOT_A_NUMBER, 0.0));
  EXPECT_EQ(w.submit(4).node, -1);
}

TEST(OffloadEngineNodes, DoesNotSendWhenItLeavesTooSoon)
{
  World w;
  w.engine.setVehicle(at(99.9, 0.0, M_PI_2));  // 0.1 m before the edge, outwards at 3 m/s: 33 ms
  w.addNode(node("a", 100.0));
  EXPECT_NEAR(w.status("a").residence.now_s, 0.1 / 3.0, 1e-6);
  EXPECT_EQ(w.submit(1).node, -1);
  w.engine.setVehicle(at(99.9, 0.0, -M_PI_2));
  EXPECT_EQ(w.submit(2).node, 0);
}

TEST(OffloadEngineNodes, ResidenceFollowsTheRouteAroundACorner)
{
  World w;
  w.engine.setVehicle(at(0.0, 99.9));  // northwards
  w.addNode(node("a", 100.0));
  EXPECT_EQ(w.submit(1).node, -1);
  // It turns back just there.
  w.engine.setRoute({{0.0, 90.0}, {0.0, 99.95}, {1.0, 99.9}, {1.0, -200.0}});
  w.now += ms(100);
  w.engine.setVehicle(at(0.0, 99.9));
  w.answerProbes("a");
  EXPECT_EQ(w.submit(2).node, 0);
  EXPECT_GT(w.status("a").residence.now_s, 60.0);
  w.engine.setRoute({});
  w.answerProbes("a");
  EXPECT_EQ(w.submit(3).node, -1);
}

TEST(OffloadEngineNodes, ResidenceRunsOutBetweenPositions)
{
  World w;
  w.engine.setVehicle(at(97.0, 0.0, M_PI_2));  // 1 s to the edge
  w.addNode(node("a", 100.0));
  EXPECT_EQ(w.submit(1).node, 0);
  w.reply(w.sent.back());
  w.now += ms(990);
  w.answerProbes("a");
  EXPECT_EQ(w.submit(2).node, -1);
}

TEST(OffloadEngineNodes, LoopIsFollowedInItsOrder)
{
  // Start and end of the loop are the same point; the node is at its far end.
  World w;
  const std::vector<Point> loop{{0, 0}, {300, 0}, {300, 100}, {0, 100}, {0, 0}};
  w.engine.setVehicle(at(0.0, 0.0, M_PI_2));
  w.engine.setRoute(loop);
  w.addNode(node("start", 50.0));
  EXPECT_NEAR(w.status("start").residence.leaves_s, 50.0 / 3.0, 1e-6);
  for (double x = 0.0; x <= 40.0; x += 0.5)
  {
    w.engine.setVehicle(at(x, 0.0, M_PI_2));
  }
  EXPECT_NEAR(w.status("start").residence.leaves_s, 10.0 / 3.0, 1e-6);
}

TEST(OffloadEngineNodes, SecondLapOfALoopIsFoundAgain)
{
  World w;
  w.engine.setVehicle(at(0.0, 0.0, M_PI_2));
  w.engine.setRoute({{0, 0}, {300, 0}, {300, 100}, {0, 100}, {0, 0}});
  w.addNode(node("a", 50.0, {150.0, 0.0}));
  const auto drive = [&](Point from, Point to)
  {
    for (double share = 0.0; share <= 1.0; share += 0.002)
    {
      w.engine.setVehicle(at(from.x + share * (to.x - from.x), from.y + share * (to.y - from.y)));
    }
  };
  drive({0, 0}, {300, 0});
  EXPECT_EQ(w.status("a").residence.leaves_s, 0.0);  // it does not come there any more
  drive({300, 0}, {300, 100});
  drive({300, 100}, {0, 100});
  drive({0, 100}, {0, 0});
  drive({0, 0}, {150, 0});
  EXPECT_NEAR(w.status("a").residence.now_s, 50.0 / 3.0, 0.2);
}

TEST(OffloadEngineNodes, LeavingTheRangeForgetsTheNetwork)
{
  World w;
  w.engine.setVehicle(at(0.0, 0.0));
  w.addNode(node("a", 100.0));
  w.submit(1);
  w.now += ms(30);
  w.reply(w.sent[0], 0.03);
  EXPECT_GT(w.status("a").round_trip_s, 0.0);
  w.engine.setVehicle(at(200.0, 0.0));
  EXPECT_EQ(w.status("a").round_trip_s, 0.0);
  EXPECT_NEAR(w.status("a").service_s[0], 0.02, 1e-9);
}

TEST(OffloadEngineNodes, HeedsWhatNodesAdvertise)
{
  World w;
  w.addNode(node("a"), advertisement(0.02, 0.3));  // a queue beyond the deadline
  EXPECT_EQ(w.submit(1).node, -1);
  NodeAdvertisement a = advertisement();
  a.draining = true;
  w.now += ms(200);
  w.answerProbes("a", a);
  EXPECT_EQ(w.submit(2).node, -1);
  a = advertisement();
  a.of_kind[0].served = false;
  w.now += ms(200);
  w.answerProbes("a", a);
  EXPECT_EQ(w.submit(3).node, -1);
  EXPECT_EQ(w.submit(4, TaskKind::SPEECH).node, 0);
  a = advertisement();
  a.has_position = true;
  a.position = {70.0, 0.0};
  a.range_m = 30.0;
  w.engine.setVehicle(at(0.0, 0.0));
  w.now += ms(200);
  w.answerProbes("a", a);
  EXPECT_EQ(w.submit(5).node, -1);
  w.engine.setVehicle(at(60.0, 0.0));
  w.answerProbes("a", a);
  EXPECT_EQ(w.submit(6).node, 0);
}

TEST(OffloadEngineNodes, OwnTasksOnTheirWayLengthenTheQueue)
{
  World w;
  w.addNode(node("a"), advertisement(0.1));
  EXPECT_EQ(w.status("a").queue_s[0], 0.0);
  w.submit(1, TaskKind::SPEECH);
  const double one = w.status("a").queue_s[0];
  EXPECT_GT(one, 0.0);
  w.submit(2, TaskKind::SPEECH);
  EXPECT_NEAR(w.status("a").queue_s[0], 2.0 * one, 1e-9);
  w.reply(w.sent[0]);
  w.reply(w.sent[1]);
  EXPECT_LT(w.status("a").queue_s[0], one);
}

TEST(OffloadEngineNodes, BacklogOfTheVehicleCounts)
{
  World w;
  const Decision first = w.submit(1);
  EXPECT_NEAR(first.expected_s, 0.1, 1e-9);
  const Decision second = w.submit(2);
  EXPECT_NEAR(second.expected_s, 0.2, 1e-9);
  w.now += ms(60);
  EXPECT_NEAR(w.submit(3).expected_s, 0.24, 1e-9);
  w.engine.onLocalDone(1, 0.1, w.now);
  w.engine.onLocalDone(2, 0.1, w.now);
  w.engine.onLocalDone(3, 0.1, w.now);
  EXPECT_NEAR(w.engine.decide(TaskKind::DETECTION, 0, 0.0, w.now).expected_s, 0.1, 1e-9);
}

TEST(OffloadEngineNodes, LearnsWhetherKindsShareAProcessor)
{
  for (const bool shared : {false, true})
  {
    World w;
    for (uint64_t id = 0; id < 80; id += 2)
    {
      w.submit(id + 1, TaskKind::SPEECH);
      w.submit(id + 2);
      w.now += ms(100);
      if (!shared)
      {
        w.engine.onLocalDone(id + 2, 0.1, w.now);
      }
      w.engine.onLocalDone(id + 1, 0.1, w.now);
      w.now += ms(100);
      w.engine.onLocalDone(id + 2, 0.1, w.now);
      w.now += ms(300);
    }
    w.submit(1000, TaskKind::SPEECH);
    EXPECT_NEAR(w.submit(1001).expected_s, shared ? 0.2 : 0.1, 0.01);
  }
}

TEST(OffloadEngineNodes, TakesNotMoreTasksToNodesThanAllowed)
{
  EngineOptions options = World::withPolicy("nearest");
  options.max_in_flight = 2;
  World w(options);
  w.addNode(node("a"));
  EXPECT_EQ(w.submit(1).node, 0);
  EXPECT_EQ(w.submit(2).node, 0);
  EXPECT_EQ(w.submit(3).node, -1);
  EXPECT_EQ(w.engine.inFlight(), 3U);
  w.reply(w.sent[0]);
  EXPECT_EQ(w.submit(4).node, 0);
}

TEST(OffloadEngineNodes, CountsHandoversAndTellsTheLastNode)
{
  World w(World::withPolicy("nearest"));
  w.addNode(node("a", 100.0, {0.0, 0.0}));
  w.addNode(node("b", 100.0, {150.0, 0.0}));
  uint64_t id = 0;
  for (const double x : {0.0, 60.0, 90.0, 140.0, 20.0})
  {
    w.engine.setVehicle(at(x, 0.0));
    w.submit(++id);
    w.reply(w.sent.back());
  }
  EXPECT_EQ(w.engine.statistics().of_kind[0].handovers, 2U);
  EXPECT_EQ(w.engine.lastNode(TaskKind::DETECTION), "a");
  EXPECT_EQ(w.engine.lastNode(TaskKind::SPEECH), "");
}

TEST(OffloadEngineNodes, WantsALeaseForItsRateAtTheNodeItUses)
{
  World w;
  w.addNode(node("a"));
  w.addNode(node("b"));
  EXPECT_EQ(w.engine.leaseRate("a", TaskKind::DETECTION, w.now), 0.0);
  for (uint64_t id = 1; id <= 50; ++id)
  {
    w.now += ms(100);
    w.answerProbes("a");
    w.answerProbes("b");
    w.submit(id);
    w.reply(w.sent.back());
  }
  const std::string used = w.engine.lastNode(TaskKind::DETECTION);
  const std::string other = used == "a" ? "b" : "a";
  EXPECT_NEAR(w.engine.leaseRate(used, TaskKind::DETECTION, w.now), 12.0, 0.5);
  EXPECT_EQ(w.engine.leaseRate(other, TaskKind::DETECTION, w.now), 0.0);
  EXPECT_EQ(w.engine.leaseRate(used, TaskKind::SPEECH, w.now), 0.0);
  EXPECT_EQ(w.engine.leaseRate("nobody", TaskKind::DETECTION, w.now), 0.0);
  EXPECT_EQ(w.engine.leaseRate(used, TaskKind::DETECTION, w.now + ms(900)), 0.0);  // tasks have stopped
}

TEST(OffloadEngineNodes, DecidesWithoutAllocating)
{
  for (const std::string& policy : pi_offload::policyNames())
  {
    World w(World::withPolicy(policy));
    w.engine.setVehicle(at(0.0, 0.0));
    for (int i = 0; i < 100; ++i)
    {
      w.addNode(node("a_node_with_quite_a_long_name_" + std::to_string(i), 100.0, {0.5 * i, 0.0}));
    }
    w.engine.decide(TaskKind::DETECTION, PICTURE_BYTES, 0.2, w.now);
    w.engine.decide(TaskKind::SPEECH, PICTURE_BYTES, 0.2, w.now);
    const size_t before = allocations;
    for (int i = 0; i < 50; ++i)
    {
      w.engine.setVehicle(at(0.1 * i, 0.0));
      w.now += ms(1);
      w.engine.decide(i % 2 == 0 ? TaskKind::DETECTION : TaskKind::SPEECH, PICTURE_BYTES, 0.2, w.now);
    }
    EXPECT_EQ(allocations - before, 0U) << policy;
  }
}

}  // namespace
