#include "recorder/incident_plan.h"

#include <gtest/gtest.h>

namespace pi_vehicle::recorder
{
namespace
{

constexpr int64_t PLAN_SECOND = 1000000000;
const IncidentWindow WINDOW{60 * PLAN_SECOND, 15 * PLAN_SECOND, 300 * PLAN_SECOND};

void triggerAt(IncidentPlan* plan, int64_t second, const std::string& name)
{
  auto message = std::make_shared<KeptMessage>();
  message->elapsed_ns = second * PLAN_SECOND;
  plan->trigger(message, name);
}

TEST(IncidentPlan, ReachesFromBeforeToAfterTheTrigger)
{
  IncidentPlan plan(WINDOW);
  EXPECT_FALSE(plan.current());
  EXPECT_FALSE(plan.nameFor(100 * PLAN_SECOND));
  triggerAt(&plan, 100, "a");
  ASSERT_TRUE(plan.current());
  EXPECT_EQ("a", plan.current()->name);
  EXPECT_EQ(40 * PLAN_SECOND, plan.current()->from_ns);
  EXPECT_EQ(115 * PLAN_SECOND, plan.current()->to_ns);
  EXPECT_FALSE(plan.endIfOver(115 * PLAN_SECOND)) << "a message of that very time may still come";
  EXPECT_TRUE(plan.endIfOver(115 * PLAN_SECOND + 1));
  EXPECT_FALSE(plan.current());
}

TEST(IncidentPlan, ATriggerDuringAnIncidentExtendsIt)
{
  IncidentPlan plan(WINDOW);
  triggerAt(&plan, 100, "a");
  EXPECT_EQ("a", plan.nameFor(115 * PLAN_SECOND));
  triggerAt(&plan, 115, "b");
  EXPECT_EQ("a", plan.current()->name);
  EXPECT_EQ(130 * PLAN_SECOND, plan.current()->to_ns);
  EXPECT_EQ(2u, plan.current()->triggers.size());
  EXPECT_FALSE(plan.nameFor(131 * PLAN_SECOND));
}

TEST(IncidentPlan, ATriggerBehindTheLongestFileBeginsTheNextOne)
{
  IncidentPlan plan(WINDOW);
  for (int64_t second = 100; second <= 400; second += 10)
  {
    triggerAt(&plan, second, "at " + std::to_string(second));
  }
  EXPECT_EQ(40 * PLAN_SECOND, plan.current()->from_ns);
  EXPECT_EQ(330 * PLAN_SECOND, plan.current()->to_ns) << "335 s would be the longest, but the next file holds them";
  EXPECT_EQ(40 * PLAN_SECOND, plan.firstNs());
  EXPECT_TRUE(plan.endIfOver(331 * PLAN_SECOND));
  EXPECT_EQ("at 330", plan.current()->name);
  EXPECT_EQ(270 * PLAN_SECOND, plan.current()->from_ns);
  EXPECT_EQ(415 * PLAN_SECOND, plan.current()->to_ns);
}

TEST(IncidentPlan, StaysSmallWhileNothingIsWritten)
{
  IncidentPlan plan(WINDOW);
  for (int64_t second = 0; second < 100000; second += 100)
  {
    triggerAt(&plan, second, "at " + std::to_string(second));
  }
  EXPECT_EQ("at 1900", plan.nameFor(100000 * PLAN_SECOND)) << "the last of twenty";
}

TEST(IncidentPlan, AJumpOfTheClockEndsAnIncidentAndBoundsTheNext)
{
  IncidentPlan plan(WINDOW);
  triggerAt(&plan, 100, "a");
  plan.cut(105 * PLAN_SECOND);
  EXPECT_TRUE(plan.endIfOver(105 * PLAN_SECOND));
  triggerAt(&plan, 110, "b");
  EXPECT_EQ("b", plan.current()->name);
  EXPECT_EQ(105 * PLAN_SECOND, plan.current()->from_ns);
}

}  // namespace
}  // namespace pi_vehicle::recorder
