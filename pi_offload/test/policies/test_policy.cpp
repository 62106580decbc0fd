#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <new>
#include <random>
#include <set>
#include <stdexcept>

#include "policies/policy.h"

namespace
{

std::atomic<size_t> allocations{0};

}  // namespace

// Counts what is allocated; array forms come here too. Not inline: the compiler would see new without its delete.
[[gnu::noinline]] void* operator new(size_t bytes)
{
  ++allocations;
  if (void* memory = std::malloc(bytes))
  {
    return memory;
  }
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept
{
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, size_t) noexcept
{
  std::free(memory);
}

namespace
{

using namespace pi_offload;

constexpr double NEVER = std::numeric_limits<double>::infinity();

/// Good in every respect: 0.0434 s and 0.02916 J for a picture (vector A of the cost model).
NodeView goodNode(const std::string& id = "good")
{
  NodeView node;
  node.id = id;
  node.connected = true;
  node.distance_m = 30.0;
  node.range_m = 100.0;
  node.residence_s = 20.0;
  node.printed_residence_s = 20.0;
  node.capacity_gcycles = 10.0;
  node.frequency_ghz = 10.0;
  node.uplink_mbps = 20.0;
  node.downlink_mbps = 20.0;
  node.network_s = {0.0244, 0.002};
  node.service_s = {0.019, 0.001};
  node.queue_s = {0.0, 0.001};
  return node;
}

/// A picture: 0.09 s and 0.42 J on the vehicle, deadline 0.2 s.
DecisionInput picture(std::vector<NodeView> nodes)
{
  DecisionInput input;
  input.needs.work_gcycles = 0.19;
  input.needs.input_mbit = 0.48;
  input.needs.output_mbit = 0.008;
  input.needs.deadline_s = 0.2;
  input.local_s = 0.09;
  input.local_j = 0.42;
  input.nodes = std::move(nodes);
  return input;
}

Decision decide(const std::string& policy, const DecisionInput& input, const PolicyOptions& options = PolicyOptions())
{
  return makePolicy(policy, options)->decide(input);
}

TEST(Policy, EveryNameMakesThePolicyOfThatName)
{
  EXPECT_EQ(std::set<std::string>(policyNames().begin(), policyNames().end()),
            (std::set<std::string>{"local", "nearest", "nearest_anywhere", "paper_literal", "paper", "deadline",
                                   "expected_cost"}));
  for (const std::string& name : policyNames())
  {
    EXPECT_EQ(makePolicy(name, PolicyOptions())->name(), name);
  }
}

TEST(Policy, AnUnknownNameIsNamedWithThoseThatThereAre)
{
  try
  {
    makePolicy("oracle", PolicyOptions());
    FAIL() << "it is of the simulator alone";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(),
                 "policy \"oracle\" is not known, must be one of local, nearest, nearest_anywhere, paper_literal, "
                 "paper, deadline, expected_cost");
  }
}

TEST(Policy, OptionsNameFieldValueAndBound)
{
  struct Field
  {
    const char* name;
    double PolicyOptions::*field;
  };
  for (const Field& f :
       {Field{"miss_cost_j", &PolicyOptions::miss_cost_j}, Field{"deviations", &PolicyOptions::deviations},
        Field{"residence_share", &PolicyOptions::residence_share}, Field{"hysteresis", &PolicyOptions::hysteresis},
        Field{"fallback_factor", &PolicyOptions::fallback_factor},
        Field{"needed_capacity_gcycles", &PolicyOptions::needed_capacity_gcycles},
        Field{"least_deviation_s", &PolicyOptions::least_deviation_s}, Field{"loss_share", &PolicyOptions::loss_share},
        Field{"fallback_miss_share", &PolicyOptions::fallback_miss_share}})
  {
    for (const double bad : {-1.0, std::nan(""), NEVER})
    {
      PolicyOptions options;
      EXPECT_NO_THROW(options.validate());
      options.*f.field = bad;
      try
      {
        options.validate();
        ADD_FAILURE() << f.name << " = " << bad << " was taken";
      }
      catch (const std::invalid_argument& error)
      {
        EXPECT_EQ(std::string(error.what()).find("policy/" + std::string(f.name) + " = "), 0u) << error.what();
      }
      EXPECT_THROW(makePolicy("local", options), std::invalid_argument);
    }
  }
}

TEST(Policy, NoneDecidesForANodeThatIsNotThere)
{
  for (const std::string& name : policyNames())
  {
    const Decision decision = decide(name, picture({}));
    EXPECT_EQ(decision.node, -1) << name;
    EXPECT_NEAR(decision.expected_s, 0.09, 1e-12) << name;
    EXPECT_NEAR(decision.expected_j, 0.42, 1e-12) << name;
    EXPECT_EQ(decision.expected_misses, 0.0) << name;
    EXPECT_EQ(decision.timeout_s, 0.0) << name;
    EXPECT_EQ(decision.frequency_ghz, 1.9) << name;
    EXPECT_STRNE(decision.reason, "") << name;
  }
}

TEST(Policy, EveryPolicyButLocalTakesAGoodNode)
{
  for (const std::string& name : policyNames())
  {
    // Two of them: the last one is out of reach for paper_literal.
    const Decision decision = decide(name, picture({goodNode("a"), goodNode("b")}));
    if (name == "local")
    {
      EXPECT_EQ(decision.node, -1);
      continue;
    }
    ASSERT_EQ(decision.node, 0) << name << " takes the first of equal ones";
    EXPECT_GT(decision.timeout_s, decision.expected_s) << name;
    EXPECT_LT(decision.expected_j, 0.05) << name;
  }
}

TEST(Policy, NoneCrashesOnNumbersThatAreNone)
{
  std::mt19937 random(3);
  const double values[] = {std::nan(""), NEVER, -NEVER, -1.0, 0.0, 1e-300, 1e300, 1.0, 0.1};
  std::uniform_int_distribution<int> pick(0, 8);
  const auto any = [&] { return values[pick(random)]; };
  for (const std::string& name : policyNames())
  {
    const std::unique_ptr<Policy> policy = makePolicy(name, PolicyOptions());
    for (int i = 0; i < 2000; ++i)
    {
      DecisionInput input = picture({});
      input.needs = {any(), any(), any(), any()};
      input.eta = any();
      input.local_backlog_s = any();
      input.local_s = any();
      input.local_j = any();
      input.previous_node = static_cast<int>(random() % 9) - 3;
      const size_t nodes = random() % 5;
      for (size_t n = 0; n < nodes; ++n)
      {
        NodeView node = goodNode();
        for (double* field : {&node.distance_m, &node.range_m, &node.residence_s, &node.printed_residence_s,
                              &node.capacity_gcycles, &node.frequency_ghz, &node.uplink_mbps, &node.downlink_mbps,
                              &node.network_s.mean, &node.network_s.deviation, &node.service_s.mean,
                              &node.service_s.deviation, &node.queue_s.mean, &node.queue_s.deviation})
        {
          *field = any();
        }
        input.nodes.push_back(node);
      }
      const Decision decision = policy->decide(input);
      EXPECT_GE(decision.node, -1);
      EXPECT_LT(decision.node, static_cast<int>(nodes));
      EXPECT_NE(decision.reason, nullptr);
    }
  }
}

TEST(Policy, DecidesWithoutAllocating)
{
  DecisionInput input = picture(std::vector<NodeView>(1000, goodNode()));
  for (size_t i = 0; i < input.nodes.size(); ++i)
  {
    input.nodes[i].capacity_gcycles = i % 2 == 0 ? 0.0 : 1.0;
  }
  for (const std::string& name : policyNames())
  {
    const std::unique_ptr<Policy> policy = makePolicy(name, PolicyOptions());
    const size_t before = allocations;
    policy->decide(input);
    EXPECT_EQ(allocations - before, 0u) << name;
  }
}

TEST(Policy, LooksAtEveryNodeOnceAtMost)
{
  const DecisionInput input = picture(std::vector<NodeView>(100, goodNode()));
  for (const std::string& name : policyNames())
  {
    if (name != "paper_literal")
    {
      EXPECT_LE(decide(name, input).looked_at, 100u) << name;
    }
  }
}

TEST(LocalPolicy, AddsItsBacklogAndSaysWhenItIsLate)
{
  DecisionInput input = picture({goodNode()});
  input.local_backlog_s = 0.1;
  EXPECT_NEAR(decide("local", input).expected_s, 0.19, 1e-12);
  EXPECT_EQ(decide("local", input).expected_misses, 0.0);
  input.local_backlog_s = 0.12;
  EXPECT_EQ(decide("local", input).expected_misses, 1.0);
}

TEST(LocalPolicy, TakesTheModelWhereNothingWasMeasured)
{
  DecisionInput input = picture({});
  input.local_s = 0.0;
  input.local_j = 0.0;
  EXPECT_NEAR(decide("local", input).expected_s, 0.1, 1e-12);
  EXPECT_NEAR(decide("local", input).expected_j, 0.42, 1e-6);
}

TEST(LocalPolicy, WorksAsSlowlyAsTheDeadlineLetsIt)
{
  PolicyOptions options;
  options.scale_frequency = true;
  DecisionInput input = picture({});
  input.needs.deadline_s = 10.0;
  const Decision slow = decide("local", input, options);
  EXPECT_NEAR(slow.frequency_ghz, 1.0234, 1e-4);
  EXPECT_NEAR(slow.expected_s, 0.09 * 1.9 / 1.0234, 1e-4);
  EXPECT_NEAR(slow.expected_j, 0.42 * 1.4658 / 2.2105, 1e-4);

  input.needs.deadline_s = 0.15;
  const Decision just_in_time = decide("local", input, options);
  EXPECT_NEAR(just_in_time.expected_s, 0.15 / 1.1, 1e-9) << "with the margin of a fallback";
  EXPECT_LT(just_in_time.frequency_ghz, 1.9);
  EXPECT_LT(just_in_time.expected_j, 0.42);

  input.local_backlog_s = 0.1;
  EXPECT_EQ(decide("local", input, options).frequency_ghz, 1.9) << "no time to spare behind the backlog";
}

TEST(NearestPolicy, TakesTheNearestInRangeWhateverItIsLike)
{
  NodeView far = goodNode("far");
  far.distance_m = 90.0;
  NodeView near_one = goodNode("near");
  near_one.distance_m = 10.0;
  near_one.connected = false;
  near_one.queue_s.mean = 100.0;
  NodeView small = goodNode("small");
  small.distance_m = 5.0;
  small.range_m = 4.0;
  EXPECT_EQ(decide("nearest", picture({far, near_one, small})).node, 1);
  EXPECT_EQ(decide("nearest_anywhere", picture({far, near_one, small})).node, 2);
  EXPECT_EQ(decide("nearest", picture({small})).node, -1);
  EXPECT_EQ(decide("nearest_anywhere", picture({small})).node, 0);
  EXPECT_EQ(decide("nearest", picture({far})).timeout_s, 0.2) << "nobody gave it a fallback in time";
}

TEST(PaperPolicy, NeedsConnectionRangeResidenceDeadlineAndCapacity)
{
  PolicyOptions options;
  options.needed_capacity_gcycles = 10.0;
  EXPECT_EQ(decide("paper", picture({goodNode()}), options).node, 0) << "enough is enough";
  NodeView node = goodNode();
  node.connected = false;
  EXPECT_EQ(decide("paper", picture({node}), options).node, -1);
  node = goodNode();
  node.distance_m = 100.1;
  EXPECT_EQ(decide("paper", picture({node}), options).node, -1);
  node = goodNode();
  node.residence_s = 0.04;
  EXPECT_EQ(decide("paper", picture({node}), options).node, -1);
  node = goodNode();
  node.queue_s.mean = 0.16;
  EXPECT_EQ(decide("paper", picture({node}), options).node, -1);
  node = goodNode();
  node.capacity_gcycles = 9.9;
  EXPECT_EQ(decide("paper", picture({node}), options).node, -1);
}

TEST(PaperPolicy, TakesRatesAndFrequencyWhereNothingWasMeasured)
{
  NodeView node = goodNode();
  node.network_s = Estimate();
  node.service_s = Estimate();
  node.queue_s = Estimate();
  const Decision decision = decide("paper", picture({node}));
  EXPECT_EQ(decision.node, 0);
  EXPECT_NEAR(decision.expected_s, 0.0434, 1e-9);
  EXPECT_NEAR(decision.expected_j, 0.02916, 1e-9);
}

TEST(PaperPolicy, EtaWeighsTimeAgainstEnergy)
{
  NodeView node = goodNode();
  node.queue_s.mean = 0.1;  // 0.1434 s: slower than the vehicle, but with less energy
  DecisionInput input = picture({node});
  input.eta = 0.2;
  EXPECT_EQ(decide("paper", input).node, 0);
  input.eta = 1.0;
  EXPECT_EQ(decide("paper", input).node, -1);
}

TEST(DeadlinePolicy, TakesTheLeastEnergyThatIsSurelyInTime)
{
  NodeView cheap = goodNode("cheap");
  cheap.uplink_mbps = 40.0;
  cheap.network_s = {0.03, 0.04};  // 0.049 + 4 * 0.04 s are beyond the deadline
  NodeView sure = goodNode("sure");
  EXPECT_EQ(decide("deadline", picture({cheap, sure})).node, 1);
  cheap.network_s.deviation = 0.01;
  EXPECT_EQ(decide("deadline", picture({cheap, sure})).node, 0);
  PolicyOptions options;
  options.deviations = 20.0;
  EXPECT_EQ(decide("deadline", picture({cheap, sure}), options).node, 1);
}

TEST(DeadlinePolicy, StaysHomeWhereThatIsCheaperAndLeavesItWhereItIsLate)
{
  NodeView dear = goodNode();
  dear.uplink_mbps = 1.0;  // 0.576 J
  DecisionInput input = picture({dear});
  EXPECT_EQ(decide("deadline", input).node, -1);
  input.local_backlog_s = 0.15;
  EXPECT_EQ(decide("deadline", input).node, 0);
}

TEST(DeadlinePolicy, MustBeDoneWithinAShareOfTheResidence)
{
  NodeView node = goodNode();
  const double needed = 0.0434 + 4.0 * std::sqrt(0.002 * 0.002 + 0.001 * 0.001 + 0.001 * 0.001 + 0.002 * 0.002);
  node.residence_s = needed / 0.8 * 1.01;
  EXPECT_EQ(decide("deadline", picture({node})).node, 0);
  node.residence_s = needed / 0.8 * 0.99;
  EXPECT_EQ(decide("deadline", picture({node})).node, -1);
}

TEST(Fallback, BeginsInTimeForTheVehicleToMeetTheDeadline)
{
  for (const char* name : {"paper", "deadline", "expected_cost"})
  {
    DecisionInput input = picture({goodNode()});
    EXPECT_NEAR(decide(name, input).timeout_s, 0.2 - 1.1 * 0.09, 1e-12) << name;
    input.local_backlog_s = 0.1;
    EXPECT_NEAR(decide(name, input).timeout_s, 0.2 - 1.1 * 0.09, 1e-12) << name << ": worked off by then";
    input.local_backlog_s = 0.102;
    EXPECT_EQ(decide(name, input).timeout_s, 0.2) << name << ": the vehicle could not meet the deadline any more";
    input.local_backlog_s = 0.0;
    input.local_s = 0.19;
    EXPECT_EQ(decide(name, input).timeout_s, 0.2) << name;
  }
}

TEST(ExpectedCost, CountsTheAnswersThatDoNotCome)
{
  NodeView node = goodNode();
  node.network_s.deviation = 0.03;
  const PolicyOptions options;
  const Decision decision = decide("expected_cost", picture({node}));
  ASSERT_EQ(decision.node, 0);

  // The same by throwing dice: Laplace distributed answers, and lost ones.
  const double deviation = std::sqrt(0.03 * 0.03 + 0.001 * 0.001 + 0.001 * 0.001 + 0.002 * 0.002);
  std::mt19937 random(5);
  std::exponential_distribution<double> length(1.0 / deviation);
  std::bernoulli_distribution slow(0.5);
  std::bernoulli_distribution lost(options.loss_share);
  constexpr int TASKS = 400000;
  int fallbacks = 0;
  for (int i = 0; i < TASKS; ++i)
  {
    const double answer = 0.0434 + (slow(random) ? 1.0 : -1.0) * length(random);
    fallbacks += (lost(random) || answer > decision.timeout_s) ? 1 : 0;
  }
  const double share = static_cast<double>(fallbacks) / TASKS;
  // Four standard errors of the share are 0.0016.
  EXPECT_NEAR(decision.expected_j, 0.02916 + share * 0.42, 0.0016 * 0.42);
  EXPECT_NEAR(decision.expected_misses, share * options.fallback_miss_share, 0.0016 * options.fallback_miss_share);
}

TEST(ExpectedCost, WouldRatherPayThanMiss)
{
  // The cheap one answers late often, and the vehicle is too busy to help.
  NodeView cheap = goodNode("cheap");
  cheap.network_s = {0.10, 0.03};
  NodeView sure = goodNode("sure");
  sure.uplink_mbps = 2.0;  // ten times the energy
  DecisionInput input = picture({cheap, sure});
  input.local_backlog_s = 0.15;
  input.previous_node = 5;
  PolicyOptions options;
  EXPECT_EQ(decide("expected_cost", input, options).node, 1);
  options.miss_cost_j = 0.0;
  EXPECT_EQ(decide("expected_cost", input, options).node, 0);
}

TEST(ExpectedCost, EtaWeighsMissesAgainstEnergy)
{
  NodeView cheap = goodNode("cheap");
  cheap.network_s = {0.13, 0.02};
  NodeView sure = goodNode("sure");
  sure.uplink_mbps = 2.0;
  DecisionInput input = picture({cheap, sure});
  input.local_backlog_s = 0.15;
  input.previous_node = 5;
  PolicyOptions options;
  options.miss_cost_j = 40.0;
  input.eta = 1.0;
  EXPECT_EQ(decide("expected_cost", input, options).node, 1);
  input.eta = 0.0;
  EXPECT_EQ(decide("expected_cost", input, options).node, 0);
}

TEST(ExpectedCost, StaysHomeWhereTheNodeIsHardlyInTime)
{
  NodeView node = goodNode();
  node.queue_s = {0.11, 0.04};
  DecisionInput input = picture({node});
  input.radio.wait_w = 0.9;
  EXPECT_EQ(decide("expected_cost", input).node, -1) << "the fallback would be needed too often";
  node.queue_s = {0.01, 0.002};
  EXPECT_EQ(decide("expected_cost", picture({node})).node, 0);
}

TEST(ExpectedCost, MustBeDoneWithinAShareOfTheResidence)
{
  NodeView node = goodNode();
  node.residence_s = 0.05;
  EXPECT_EQ(decide("expected_cost", picture({node})).node, -1);
  node.residence_s = 1.0;
  EXPECT_EQ(decide("expected_cost", picture({node})).node, 0);
  node.distance_m = 101.0;
  EXPECT_EQ(decide("expected_cost", picture({node})).node, -1);
  node.distance_m = 1.0;
  node.connected = false;
  EXPECT_EQ(decide("expected_cost", picture({node})).node, -1);
}

TEST(ExpectedCost, ChangesThePlaceOnlyForMuchLess)
{
  NodeView first = goodNode("first");
  NodeView second = goodNode("second");
  PolicyOptions steady;
  steady.hysteresis = 0.1;
  DecisionInput input = picture({first, second});
  input.previous_node = 1;
  EXPECT_EQ(decide("expected_cost", input, steady).node, 1) << "as good: stays";
  input.nodes[0].uplink_mbps = 21.0;
  EXPECT_EQ(decide("expected_cost", input, steady).node, 1) << "5 % better: stays";
  PolicyOptions greedy;
  greedy.hysteresis = 0.0;
  EXPECT_EQ(decide("expected_cost", input, greedy).node, 0);
  input.nodes[0].uplink_mbps = 30.0;
  EXPECT_EQ(decide("expected_cost", input, steady).node, 0) << "much better: goes";
  input.nodes[0].uplink_mbps = 21.0;
  input.nodes[1].connected = false;
  EXPECT_EQ(decide("expected_cost", input, steady).node, 0) << "cannot stay";
}

TEST(ExpectedCost, ComparesWithAVehicleThatSavesEnergyItself)
{
  NodeView node = goodNode();
  node.uplink_mbps = 1.5;  // 0.39 J
  node.network_s.mean = 0.03;
  DecisionInput input = picture({node});
  input.needs.deadline_s = 1.0;
  input.previous_node = 0;
  EXPECT_EQ(decide("expected_cost", input).node, 0);
  PolicyOptions options;
  options.scale_frequency = true;
  const Decision decision = decide("expected_cost", input, options);
  EXPECT_EQ(decision.node, -1);
  EXPECT_NEAR(decision.frequency_ghz, 1.0234, 1e-4);
}

}  // namespace
