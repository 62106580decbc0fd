#include <pi_runtime/dag_plan.h>

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>

#include "plan_check.h"
#include "scheduler/inter_core_problem.h"

namespace pi_runtime
{
namespace
{

/// Two units, a link of 1 s between them. Node 0 feeds 1 and 2, which feed 3; unit 1 cannot run node 3.
class ValidatePlan : public testing::Test
{
protected:
  ValidatePlan()
    : graph_(4, {{0, 1}, {0, 2}, {1, 3}, {2, 3}}), etc_(4, 2, {2, 3, 4, 4, 3, 3, 1, INF}), transfers_(2, {1.0, INF})
  {
    // unit 0:  0 0 1 1 1 1 . 3
    // unit 1:  . . . 2 2 2
    plan_.unit = {0, 0, 1, 0};
    plan_.start = {0, 2, 3, 7};
    plan_.finish = {2, 6, 6, 8};
    plan_.level = {0, 1, 1, 2};
    plan_.rank = {0, 0, 0, 0};
    plan_.order = {{0, 1, 3}, {2}};
    plan_.makespan = 8;
    plan_.critical_path = 7;
  }

  /// What is found after the change, which must be something.
  std::string findingAfter(const std::function<void(DagPlan*)>& change, bool barrier = false) const
  {
    DagPlan plan = plan_;
    change(&plan);
    return validatePlan(graph_, etc_, transfers_, plan, start_times_, barrier).value_or("nothing");
  }

  void expectFinding(const std::string& text, const std::function<void(DagPlan*)>& change) const
  {
    const std::string finding = findingAfter(change);
    EXPECT_NE(std::string::npos, finding.find(text)) << finding;
  }

  TaskGraph graph_;
  EtcMatrix etc_;
  TransferModel transfers_;
  StartTimes start_times_;
  DagPlan plan_;
};

TEST_F(ValidatePlan, AcceptsAPlanThatHolds)
{
  EXPECT_EQ("nothing", findingAfter([](DagPlan*) {}));
  EXPECT_EQ("nothing", findingAfter([](DagPlan*) {}, true));
}

TEST_F(ValidatePlan, AcceptsTheEmptyPlanOfTheEmptyGraph)
{
  DagPlan plan;
  plan.order.resize(1);
  EXPECT_FALSE(validatePlan(TaskGraph(), EtcMatrix(0, 1), TransferModel(1), plan));
}

TEST_F(ValidatePlan, FindsSizesThatDoNotAgree)
{
  expectFinding("sizes", [](DagPlan* plan) { plan->finish.pop_back(); });
  expectFinding("sizes", [](DagPlan* plan) { plan->order.pop_back(); });
  EXPECT_TRUE(validatePlan(graph_, etc_, TransferModel(3), plan_));
}

TEST_F(ValidatePlan, FindsANodeWithoutUnit)
{
  expectFinding("node 2 has no unit", [](DagPlan* plan) { plan->unit[2] = DagPlan::NO_UNIT; });
}

TEST_F(ValidatePlan, FindsANodeOnAUnitThatCannotRunIt)
{
  expectFinding("node 3 is on unit 1", [](DagPlan* plan) { plan->unit[3] = 1; });
}

TEST_F(ValidatePlan, FindsAWrongDuration)
{
  expectFinding("node 2 does not run", [](DagPlan* plan) { plan->finish[2] = 5.5; });
  expectFinding("node 0 does not run",
                [](DagPlan* plan) { plan->start[0] = std::numeric_limits<double>::quiet_NaN(); });
}

TEST_F(ValidatePlan, FindsAMissingTransfer)
{
  expectFinding("node 2 starts at 2",
                [](DagPlan* plan)
                {
                  plan->start[2] = 2;
                  plan->finish[2] = 5;
                });
}

TEST_F(ValidatePlan, FindsABrokenPrecedenceInsideAUnit)
{
  expectFinding("node 1 starts at 1",
                [](DagPlan* plan)
                {
                  plan->start[1] = 1;
                  plan->finish[1] = 5;
                });
}

TEST_F(ValidatePlan, FindsTwoNodesAtATime)
{
  expectFinding("node 2 starts while unit 0",
                [](DagPlan* plan)
                {
                  plan->unit[2] = 0;  // 3 s to 6 s, while node 1 runs from 2 s to 6 s
                  plan->order = {{0, 1, 2, 3}, {}};
                });
}

TEST_F(ValidatePlan, FindsAWrongOrder)
{
  expectFinding("unit 0", [](DagPlan* plan) { plan->order = {{1, 0, 3}, {2}}; });
  expectFinding("wrongly lists node 2", [](DagPlan* plan) { plan->order = {{0, 1, 3, 2}, {}}; });
  expectFinding("wrongly lists node 1", [](DagPlan* plan) { plan->order = {{0, 1, 1, 3}, {2}}; });
  expectFinding("wrongly lists node 9", [](DagPlan* plan) { plan->order = {{0, 1, 3}, {2, 9}}; });
  expectFinding("not every node", [](DagPlan* plan) { plan->order = {{0, 1}, {2}}; });
}

TEST_F(ValidatePlan, FindsAWrongLevel)
{
  expectFinding("node 3 has the wrong level", [](DagPlan* plan) { plan->level[3] = 1; });
}

TEST_F(ValidatePlan, FindsAWrongMakespan)
{
  expectFinding("makespan", [](DagPlan* plan) { plan->makespan = 7; });
}

TEST_F(ValidatePlan, FindsAStartBeforeTheUnitIsAvailable)
{
  start_times_.available = {0, 3.5};
  expectFinding("node 2 starts before", [](DagPlan*) {});
  start_times_.available = {0, 3};
  EXPECT_EQ("nothing", findingAfter([](DagPlan*) {}));
}

TEST_F(ValidatePlan, FindsAStartBeforeTheRelease)
{
  start_times_.release = {0, 2.5, 0, 0};
  expectFinding("node 1 starts before", [](DagPlan*) {});
}

TEST_F(ValidatePlan, FindsABrokenBarrierOnlyWhenAsked)
{
  // A chain of two beside one long node: the second of the chain does not wait for it.
  const TaskGraph graph(3, {{1, 2}});
  const EtcMatrix etc(3, 2, {4, 4, 1, 1, 1, 1});
  DagPlan plan;
  plan.unit = {1, 0, 0};
  plan.start = {0, 0, 1};
  plan.finish = {4, 1, 2};
  plan.level = {0, 0, 1};
  plan.rank = {4, 2, 1};
  plan.order = {{1, 2}, {0}};
  plan.makespan = 4;
  EXPECT_FALSE(validatePlan(graph, etc, TransferModel(2), plan));
  const auto finding = validatePlan(graph, etc, TransferModel(2), plan, StartTimes(), true);
  ASSERT_TRUE(finding);
  EXPECT_NE(std::string::npos, finding->find("node 2 starts before all levels")) << *finding;
}

TEST_F(ValidatePlan, FindsAWrongListOfInfeasibleNodes)
{
  expectFinding("infeasible", [](DagPlan* plan) { plan->infeasible = {1}; });
  etc_.at(3, 0) = INF;
  expectFinding("infeasible", [](DagPlan*) {});
}

TEST_F(ValidatePlan, FindsSomethingPlannedInAnInfeasiblePlan)
{
  etc_.at(3, 0) = INF;
  expectFinding("must not plan", [](DagPlan* plan) { plan->infeasible = {3}; });
}

TEST(DagPlan, RelatesItsMakespanToTheCriticalPath)
{
  DagPlan plan;
  EXPECT_EQ(1.0, plan.slr()) << "no work";
  plan.makespan = 6.0;
  plan.critical_path = 4.0;
  EXPECT_DOUBLE_EQ(1.5, plan.slr());
}

}  // namespace
}  // namespace pi_runtime
