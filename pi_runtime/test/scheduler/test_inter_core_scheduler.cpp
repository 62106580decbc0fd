#include <pi_runtime/inter_core_scheduler.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <new>
#include <numeric>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "scheduler/inter_core_problem.h"

namespace
{
size_t allocations = 0;
}

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

[[gnu::noinline]] void operator delete(void* memory, size_t) noexcept
{
  std::free(memory);
}

namespace pi_runtime
{
namespace
{

/// Whole times from [1, largest], so that equal sums compare equal and small `largest` gives many ties.
EtcMatrix randomEtc(size_t tasks, size_t units, int largest, double share_of_infinity, std::mt19937_64* random)
{
  EtcMatrix etc(tasks, units);
  std::uniform_int_distribution<int> time(1, largest);
  std::bernoulli_distribution infinite(share_of_infinity);
  for (size_t i = 0; i < tasks; ++i)
  {
    for (size_t j = 0; j < units; ++j)
    {
      etc.at(i, j) = infinite(*random) ? INF : time(*random);
    }
  }
  return etc;
}

std::vector<double> randomAvailable(size_t units, std::mt19937_64* random)
{
  std::vector<double> available(units);
  std::generate(available.begin(), available.end(), [random] { return static_cast<double>((*random)() % 40); });
  return available;
}

bool runnable(const EtcMatrix& etc, size_t task)
{
  return std::any_of(etc.row(task), etc.row(task) + etc.units(), [](double time) { return time < INF; });
}

InterCoreOptions optionsOf(InterCorePolicy policy)
{
  InterCoreOptions options;
  options.policy = policy;
  options.budget = std::chrono::hours(1);
  return options;
}

/// Everything that holds whatever the policy.
void expectConsistent(const EtcMatrix& etc, std::vector<double> load, const Assignment& assignment)
{
  load.resize(etc.units(), 0.0);
  ASSERT_EQ(etc.tasks(), assignment.unit.size());
  const std::set<uint32_t> ordered(assignment.order.begin(), assignment.order.end());
  EXPECT_EQ(ordered.size(), assignment.order.size());
  for (size_t i = 0; i < etc.tasks(); ++i)
  {
    EXPECT_EQ(runnable(etc, i), ordered.count(static_cast<uint32_t>(i)) == 1) << "task " << i;
    if (!runnable(etc, i))
    {
      EXPECT_EQ(Assignment::REFUSED, assignment.unit[i]);
      continue;
    }
    ASSERT_GE(assignment.unit[i], 0);
    ASSERT_LT(etc.at(i, static_cast<size_t>(assignment.unit[i])), INF) << "task " << i;
    load[static_cast<size_t>(assignment.unit[i])] += etc.at(i, static_cast<size_t>(assignment.unit[i]));
  }
  EXPECT_EQ(load, assignment.load);
  EXPECT_EQ(load.empty() ? 0.0 : *std::max_element(load.begin(), load.end()), assignment.makespan);
  EXPECT_LE(assignment.lower_bound, assignment.objective);
}

/// Formal steps (4)-(8) of the paper followed literally: checks every choice of task and unit against all others.
void expectIsDiffMin(const EtcMatrix& etc, std::vector<double> m_table, DiffMinOrder order,
                     const Assignment& assignment)
{
  m_table.resize(etc.units(), 0.0);
  struct Key
  {
    size_t infinite = 0;
    double div = 0.0;
    double sub = 0.0;
  };
  const auto keyOf = [&etc](size_t task)
  {
    std::vector<double> finite;
    std::copy_if(etc.row(task), etc.row(task) + etc.units(), std::back_inserter(finite),
                 [](double t) { return t < INF; });
    const auto [smallest, largest] = std::minmax_element(finite.begin(), finite.end());
    return Key{etc.units() - finite.size(), *largest / *smallest, *largest - *smallest};
  };
  const auto before = [order](const Key& a, const Key& b)
  {
    if (a.infinite != b.infinite)
    {
      return order == DiffMinOrder::MAX_DIV ? a.infinite > b.infinite : a.infinite < b.infinite;
    }
    if (a.div != b.div)
    {
      return order == DiffMinOrder::MAX_DIV ? a.div > b.div : a.div < b.div;
    }
    return a.sub > b.sub;
  };
  std::set<size_t> unmapped;
  for (size_t i = 0; i < etc.tasks(); ++i)
  {
    if (runnable(etc, i))
    {
      unmapped.insert(i);
    }
  }
  for (uint32_t task : assignment.order)
  {
    for (size_t other : unmapped)
    {
      ASSERT_FALSE(before(keyOf(other), keyOf(task))) << "task " << other << " comes before " << task;
    }
    size_t unit = 0;
    for (size_t j = 1; j < etc.units(); ++j)
    {
      unit = m_table[j] + etc.at(task, j) < m_table[unit] + etc.at(task, unit) ? j : unit;
    }
    ASSERT_EQ(static_cast<int32_t>(unit), assignment.unit[task]) << "task " << task;
    m_table[unit] += etc.at(task, unit);
    unmapped.erase(task);
  }
  EXPECT_TRUE(unmapped.empty());
}

/// Order and units of Min-Min by looking at all pairs in every step.
std::vector<std::pair<uint32_t, int32_t>> naiveMinMin(const EtcMatrix& etc, std::vector<double> load)
{
  load.resize(etc.units(), 0.0);
  std::vector<bool> mapped(etc.tasks(), false);
  std::vector<std::pair<uint32_t, int32_t>> result;
  while (true)
  {
    double best = INF;
    size_t task = 0;
    size_t unit = 0;
    for (size_t i = 0; i < etc.tasks(); ++i)
    {
      for (size_t j = 0; !mapped[i] && j < etc.units(); ++j)
      {
        if (load[j] + etc.at(i, j) < best)
        {
          best = load[j] + etc.at(i, j);
          task = i;
          unit = j;
        }
      }
    }
    if (best == INF)
    {
      return result;
    }
    mapped[task] = true;
    load[unit] = best;
    result.emplace_back(static_cast<uint32_t>(task), static_cast<int32_t>(unit));
  }
}

/// Max-Min and Sufferage by their definition.
std::vector<uint32_t> naiveDynamicOrder(const EtcMatrix& etc, InterCorePolicy policy)
{
  std::vector<double> load(etc.units(), 0.0);
  std::set<uint32_t> unmapped;
  for (uint32_t i = 0; i < etc.tasks(); ++i)
  {
    unmapped.insert(i);
  }
  std::vector<uint32_t> order;
  while (!unmapped.empty())
  {
    double best_rank = -1.0;
    uint32_t best_task = 0;
    size_t best_unit = 0;
    for (uint32_t task : unmapped)
    {
      std::vector<std::pair<double, size_t>> completions;
      for (size_t j = 0; j < etc.units(); ++j)
      {
        completions.emplace_back(load[j] + etc.at(task, j), j);
      }
      std::sort(completions.begin(), completions.end());
      const double rank =
          policy == InterCorePolicy::MAX_MIN ? completions[0].first : completions[1].first - completions[0].first;
      if (rank > best_rank)
      {
        best_rank = rank;
        best_task = task;
        best_unit = completions[0].second;
      }
    }
    order.push_back(best_task);
    unmapped.erase(best_task);
    load[best_unit] += etc.at(best_task, best_unit);
  }
  return order;
}

template <typename Function>
std::string refusalOf(Function function)
{
  try
  {
    function();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

TEST(InterCoreScheduler, NamesRoundTripAndErrorsListThem)
{
  ASSERT_EQ(9U, allInterCorePolicies().size());
  for (InterCorePolicy policy : allInterCorePolicies())
  {
    EXPECT_EQ(policy, parseInterCorePolicy(toString(policy)));
  }
  EXPECT_STREQ("diff_min", toString(InterCorePolicy::DIFF_MIN));
  EXPECT_STREQ("search", toString(InterCorePolicy::SEARCH));
  EXPECT_EQ("policy = \"minmin\", must be one of diff_min min_min max_min sufferage mct met olb heft_rank search",
            refusalOf([] { parseInterCorePolicy("minmin"); }));
  EXPECT_EQ(DiffMinOrder::MIN_DIV, parseDiffMinOrder("min"));
  EXPECT_STREQ("max", toString(DiffMinOrder::MAX_DIV));
  EXPECT_EQ("diff_min_order = \"\", must be one of max min", refusalOf([] { parseDiffMinOrder(""); }));
}

TEST(InterCoreScheduler, OptionsNameFieldValueAndBound)
{
  InterCoreOptions options;
  EXPECT_NO_THROW(options.validate());
  options.kicks = -1;
  EXPECT_EQ("kicks = -1, must be >= 0", refusalOf([&options] { options.validate(); }));
  options = {};
  options.budget = std::chrono::microseconds(-5);
  EXPECT_EQ("budget = -5 us, must be >= 0 (0: by the size of the problem)",
            refusalOf([&options] { options.validate(); }));
  options = {};
  options.alpha = 0.0;
  EXPECT_EQ("alpha = 0, must be finite and > 0", refusalOf([&options] { options.validate(); }));
  options = {};
  options.gamma = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ("gamma = nan, must be finite and >= 0", refusalOf([&options] { options.validate(); }));
}

TEST(InterCoreScheduler, RefusesBadInputAndLeavesTheResultAlone)
{
  const EtcMatrix etc(2, 2, {1, 2, 3, 4});
  InterCoreScheduler scheduler;
  Assignment result;
  result.makespan = 42.0;
  const auto refusal = [&](const EtcMatrix& matrix, const std::vector<double>& available, const EtcMatrix* energy)
  { return refusalOf([&] { scheduler.schedule(matrix, available, {}, energy, &result); }); };
  EXPECT_EQ("ETC matrix: task 1 on unit 0 = 0, must be > 0 (inf: the task cannot run there)",
            refusal(EtcMatrix(2, 2, {1, 2, 0, 4}), {}, nullptr));
  EXPECT_EQ("ETC matrix: number of units = 0, must be at least 1", refusal(EtcMatrix(2, 0), {}, nullptr));
  EXPECT_EQ("available: number of entries = 3, must be that of the units, 2", refusal(etc, {0, 0, 0}, nullptr));
  EXPECT_EQ("available: unit 1 = -1, must be finite and >= 0", refusal(etc, {0, -1}, nullptr));
  EXPECT_EQ("available: unit 0 = inf, must be finite and >= 0", refusal(etc, {INF, 0}, nullptr));
  const EtcMatrix small(1, 2, {1, 1});
  EXPECT_EQ("energy matrix: size = 1 x 2, must be that of the ETC matrix, 2 x 2", refusal(etc, {}, &small));
  const EtcMatrix unknown(2, 2, {1, 1, INF, 1});
  EXPECT_EQ("energy matrix: task 1 on unit 0 = inf, must be finite and >= 0 where the ETC is finite",
            refusal(etc, {}, &unknown));
  EXPECT_EQ(42.0, result.makespan);
}

TEST(InterCoreScheduler, DiffMinFollowsTheFormalSteps)
{
  std::mt19937_64 random(11);
  for (int round = 0; round < 300; ++round)
  {
    const size_t tasks = 1 + random() % 25;
    const size_t units = 1 + random() % 6;
    const EtcMatrix etc = randomEtc(tasks, units, round % 2 == 0 ? 30 : 3, round % 3 == 0 ? 0.25 : 0.0, &random);
    const std::vector<double> available = round % 5 == 0 ? randomAvailable(units, &random) : std::vector<double>{};
    for (DiffMinOrder order : {DiffMinOrder::MAX_DIV, DiffMinOrder::MIN_DIV})
    {
      InterCoreOptions options = optionsOf(InterCorePolicy::DIFF_MIN);
      options.diff_min_order = order;
      const Assignment assignment = schedule(etc, available, options);
      expectConsistent(etc, available, assignment);
      if (tasks > 1)  // of a single task only the unit is specified, which expectIsDiffMin() checks as well
      {
        ASSERT_NO_FATAL_FAILURE(expectIsDiffMin(etc, available, order, assignment));
      }
    }
  }
}

TEST(InterCoreScheduler, DiffMinDrawsAmongEqualTasksBySeed)
{
  const EtcMatrix etc(12, 2, std::vector<double>(24, 5.0));
  InterCoreOptions options = optionsOf(InterCorePolicy::DIFF_MIN);
  std::set<std::vector<uint32_t>> orders;
  for (options.seed = 0; options.seed < 20; ++options.seed)
  {
    const std::vector<uint32_t> order = schedule(etc, {}, options).order;
    EXPECT_EQ(order, schedule(etc, {}, options).order);
    orders.insert(order);
  }
  EXPECT_GT(orders.size(), 15U);
}

TEST(InterCoreScheduler, MinMinEqualsTheNaiveForm)
{
  std::mt19937_64 random(12);
  for (int round = 0; round < 300; ++round)
  {
    const size_t tasks = 1 + random() % 30;
    const size_t units = 1 + random() % 6;
    const EtcMatrix etc = randomEtc(tasks, units, round % 2 == 0 ? 30 : 3, round % 3 == 0 ? 0.3 : 0.0, &random);
    const std::vector<double> available = round % 5 == 0 ? randomAvailable(units, &random) : std::vector<double>{};
    const Assignment assignment = schedule(etc, available, optionsOf(InterCorePolicy::MIN_MIN));
    expectConsistent(etc, available, assignment);
    std::vector<std::pair<uint32_t, int32_t>> mapped;
    for (uint32_t task : assignment.order)
    {
      mapped.emplace_back(task, assignment.unit[task]);
    }
    ASSERT_EQ(naiveMinMin(etc, available), mapped) << "round " << round;
  }
}

TEST(InterCoreScheduler, MaxMinAndSufferageEqualTheirDefinition)
{
  std::mt19937_64 random(13);
  for (int round = 0; round < 100; ++round)
  {
    const EtcMatrix etc = randomEtc(2 + random() % 30, 2 + random() % 5, round % 2 == 0 ? 30 : 3, 0.0, &random);
    for (InterCorePolicy policy : {InterCorePolicy::MAX_MIN, InterCorePolicy::SUFFERAGE})
    {
      ASSERT_EQ(naiveDynamicOrder(etc, policy), schedule(etc, {}, optionsOf(policy)).order)
          << toString(policy) << " round " << round;
    }
  }
}

TEST(InterCoreScheduler, SimpleRulesDoWhatTheirNamesSay)
{
  const EtcMatrix etc(3, 2, {4, 5, 4, 5, 1, 9});
  const auto units = [&etc](InterCorePolicy policy) { return schedule(etc, {}, optionsOf(policy)).unit; };
  EXPECT_EQ((std::vector<int32_t>{0, 0, 0}), units(InterCorePolicy::MET));
  EXPECT_EQ((std::vector<int32_t>{0, 1, 0}), units(InterCorePolicy::MCT));
  EXPECT_EQ((std::vector<int32_t>{0, 1, 0}), units(InterCorePolicy::OLB));
  const Assignment by_rank = schedule(etc, {}, optionsOf(InterCorePolicy::HEFT_RANK));
  EXPECT_EQ((std::vector<uint32_t>{2, 0, 1}), by_rank.order);  // means 5, 4.5, 4.5
  EXPECT_EQ((std::vector<int32_t>{0, 1, 0}), by_rank.unit);
}

TEST(InterCoreScheduler, OlbIgnoresTimesButNotFeasibility)
{
  const EtcMatrix etc(2, 2, {INF, 7, 100, 1});
  const Assignment assignment = schedule(etc, {0, 3}, optionsOf(InterCorePolicy::OLB));
  EXPECT_EQ((std::vector<int32_t>{1, 0}), assignment.unit);
  EXPECT_EQ(100.0, assignment.makespan);
}

class EveryPolicy : public ::testing::TestWithParam<InterCorePolicy>
{
};

TEST_P(EveryPolicy, IsConsistentOnRandomProblems)
{
  std::mt19937_64 random(14);
  InterCoreScheduler scheduler;
  Assignment assignment;
  for (int round = 0; round < 60; ++round)
  {
    const size_t units = 1 + random() % 7;
    const EtcMatrix etc = randomEtc(random() % 40, units, round % 2 == 0 ? 30 : 2, round % 3 == 0 ? 0.6 : 0.0, &random);
    const std::vector<double> available = round % 4 == 0 ? randomAvailable(units, &random) : std::vector<double>{};
    scheduler.schedule(etc, available, optionsOf(GetParam()), nullptr, &assignment);
    ASSERT_NO_FATAL_FAILURE(expectConsistent(etc, available, assignment)) << "round " << round;
    const Assignment fresh = schedule(etc, available, optionsOf(GetParam()));
    EXPECT_EQ(fresh.unit, assignment.unit) << "a used workspace changes nothing, round " << round;
    EXPECT_EQ(fresh.order, assignment.order);
  }
}

TEST_P(EveryPolicy, MapsNoTasksToNothing)
{
  const Assignment assignment = schedule(EtcMatrix(0, 3), {1, 5, 2}, optionsOf(GetParam()));
  EXPECT_TRUE(assignment.unit.empty());
  EXPECT_TRUE(assignment.order.empty());
  EXPECT_EQ((std::vector<double>{1, 5, 2}), assignment.load);
  EXPECT_EQ(5.0, assignment.makespan);
  EXPECT_EQ(0.0, schedule(EtcMatrix(), {}, optionsOf(GetParam())).makespan);
}

TEST_P(EveryPolicy, MapsAllTasksToTheOnlyUnit)
{
  const Assignment assignment = schedule(EtcMatrix(3, 1, {1, 2, 3}), {4}, optionsOf(GetParam()));
  EXPECT_EQ((std::vector<int32_t>{0, 0, 0}), assignment.unit);
  EXPECT_EQ(10.0, assignment.makespan);
}

TEST_P(EveryPolicy, RefusesTasksThatNoUnitCanRun)
{
  const Assignment assignment = schedule(EtcMatrix(3, 2, {INF, INF, 2, INF, INF, INF}), {}, optionsOf(GetParam()));
  EXPECT_EQ((std::vector<int32_t>{Assignment::REFUSED, 0, Assignment::REFUSED}), assignment.unit);
  EXPECT_EQ((std::vector<uint32_t>{1}), assignment.order);
  const Assignment nothing = schedule(EtcMatrix(2, 2), {}, optionsOf(GetParam()));
  EXPECT_EQ((std::vector<int32_t>{Assignment::REFUSED, Assignment::REFUSED}), nothing.unit);
  EXPECT_TRUE(nothing.order.empty());
}

TEST_P(EveryPolicy, SingleTaskAgreesWithTheSameTaskAmongOthers)
{
  // A second task that can run only on a unit of its own leaves the first one's choice as it is, but takes the policies
  // past their short cut for single tasks.
  std::mt19937_64 random(15);
  for (int round = 0; round < 100; ++round)
  {
    const EtcMatrix one = randomEtc(1, 3, 9, 0.2, &random);
    if (!runnable(one, 0))
    {
      continue;
    }
    EtcMatrix two(2, 4);
    std::copy(one.row(0), one.row(0) + 3, &two.at(0, 0));
    two.at(1, 3) = 1.0;
    std::vector<double> available = randomAvailable(3, &random);
    const Assignment alone = schedule(one, available, optionsOf(GetParam()));
    available.push_back(0.0);
    const Assignment among = schedule(two, available, optionsOf(GetParam()));
    if (GetParam() == InterCorePolicy::SEARCH)
    {
      EXPECT_EQ(alone.makespan, among.makespan) << "round " << round;
    }
    else
    {
      EXPECT_EQ(alone.unit[0], among.unit[0]) << "round " << round;
    }
  }
}

TEST_P(EveryPolicy, AllocatesNothingOnceItsMemoryHasGrown)
{
  std::mt19937_64 random(17);
  const EtcMatrix etc = randomEtc(40, 5, 30, 0.1, &random);
  const EtcMatrix energy = randomEtc(40, 5, 30, 0.0, &random);
  const EtcMatrix single = randomEtc(1, 5, 30, 0.0, &random);
  const std::vector<double> available = randomAvailable(5, &random);
  InterCoreOptions options = optionsOf(GetParam());
  options.gamma = 0.1;
  InterCoreScheduler scheduler;
  Assignment assignment;
  scheduler.schedule(etc, available, options, &energy, &assignment);
  scheduler.schedule(single, available, options, nullptr, &assignment);
  const size_t before = allocations;
  EXPECT_GT(before, 0U);
  for (int repetition = 0; repetition < 3; ++repetition)
  {
    scheduler.schedule(etc, available, options, &energy, &assignment);
    scheduler.schedule(single, available, options, nullptr, &assignment);
  }
  EXPECT_EQ(before, allocations);
}

TEST_P(EveryPolicy, CopesWithAHundredThousandTasks)
{
  std::mt19937_64 random(16);
  const EtcMatrix etc = randomEtc(100000, 8, 30, 0.05, &random);
  InterCoreOptions options = optionsOf(GetParam());
  options.budget = std::chrono::milliseconds(50);
  const Assignment assignment = schedule(etc, {}, options);
  ASSERT_NO_FATAL_FAILURE(expectConsistent(etc, {}, assignment));
}

INSTANTIATE_TEST_SUITE_P(InterCoreScheduler, EveryPolicy, ::testing::ValuesIn(allInterCorePolicies()),
                         [](const auto& info) { return std::string(toString(info.param)); });

TEST(InterCoreScheduler, EnergyMovesTasksToFrugalUnitsAsGammaGrows)
{
  // Unit 0 is fast and hungry, unit 1 slow and frugal.
  const EtcMatrix etc(4, 2, {1, 3, 1, 3, 1, 3, 1, 3});
  const EtcMatrix energy(4, 2, {20, 2, 20, 2, 20, 2, 20, 2});
  for (InterCorePolicy policy : {InterCorePolicy::DIFF_MIN, InterCorePolicy::MIN_MIN, InterCorePolicy::MCT,
                                 InterCorePolicy::MET, InterCorePolicy::SEARCH})
  {
    InterCoreOptions options = optionsOf(policy);
    const Assignment fast = schedule(etc, {}, options, &energy);
    options.gamma = 10.0;
    const Assignment frugal = schedule(etc, {}, options, &energy);
    EXPECT_GT(fast.energy, 40.0) << toString(policy);
    EXPECT_EQ(8.0, frugal.energy) << toString(policy);
    EXPECT_EQ(12.0 + 10.0 * 8.0, frugal.objective) << toString(policy);
  }
}

}  // namespace
}  // namespace pi_runtime
