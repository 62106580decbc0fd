#include "vehicle/actor.h"

#include <gtest/gtest.h>

#include <cmath>

namespace pi_simulation
{
namespace
{

constexpr double DT = 0.001;
const Eigen::Vector2d FAR_AWAY(1000.0, 0.0);

ActorPlan crossing()
{
  ActorPlan plan;
  plan.id = "child";
  plan.class_name = "person";
  plan.path = {{0.0, 0.0}, {0.0, 6.0}};
  plan.speed = 1.0;
  return plan;
}

/// @return time of the trigger; -1: none.
double run(Actor* actor, double from, double to, const Eigen::Vector2d& vehicle = FAR_AWAY)
{
  double triggered = -1.0;
  for (double time = from + DT; time < to + 0.5 * DT; time += DT)
  {
    if (actor->step(time, DT, vehicle))
    {
      triggered = time;
    }
  }
  return triggered;
}

TEST(SimulationActor, GoesAtItsTime)
{
  ActorPlan plan = crossing();
  plan.trigger.time = 2.0;
  Actor actor(plan);
  EXPECT_NEAR(2.0, run(&actor, 0.0, 3.0), 2 * DT);
  EXPECT_GT(actor.state().position.y(), 0.1);
}

TEST(SimulationActor, GoesWhenTheVehicleIsNear)
{
  ActorPlan plan = crossing();
  plan.trigger.near = Eigen::Vector2d(-1.0, 3.0);
  plan.trigger.within = 10.0;
  Actor actor(plan);
  EXPECT_EQ(-1.0, run(&actor, 0.0, 5.0, {-11.1, 3.0}));
  EXPECT_EQ(0.0, actor.state().walked);
  EXPECT_NEAR(5.0, run(&actor, 5.0, 6.0, {-10.9, 3.0}), 2 * DT);
}

TEST(SimulationActor, WithTimeAndPlaceWaitsForBoth)
{
  ActorPlan plan = crossing();
  plan.trigger.time = 2.0;
  plan.trigger.near = Eigen::Vector2d(0.0, 0.0);
  plan.trigger.within = 10.0;
  Actor early(plan);
  EXPECT_EQ(-1.0, run(&early, 0.0, 1.9, {5.0, 0.0}));
  EXPECT_NEAR(2.0, run(&early, 1.9, 3.0, {5.0, 0.0}), 2 * DT);
  Actor late(plan);
  EXPECT_EQ(-1.0, run(&late, 0.0, 5.0));
  EXPECT_NEAR(5.0, run(&late, 5.0, 6.0, {5.0, 0.0}), 2 * DT);
}

TEST(SimulationActor, WaitsForACommandIfItSaysSo)
{
  ActorPlan plan = crossing();
  plan.trigger.command = true;
  plan.hidden = true;
  Actor actor(plan);
  EXPECT_EQ(-1.0, run(&actor, 0.0, 5.0));
  EXPECT_FALSE(actor.state().present);
  actor.go();
  EXPECT_NEAR(5.0, run(&actor, 5.0, 5.5), 2 * DT);
  EXPECT_TRUE(actor.state().present);
}

TEST(SimulationActor, PausesWhereItShallAndArrives)
{
  ActorPlan plan = crossing();
  plan.pauses = {{2.0, 3.0}};
  Actor actor(plan);
  run(&actor, 0.0, 4.0);
  EXPECT_NEAR(2.0, actor.state().position.y(), 0.01);
  EXPECT_EQ(0.0, actor.state().velocity.norm());
  run(&actor, 4.0, 15.0);
  EXPECT_NEAR(6.0, actor.state().position.y(), 0.01);
  EXPECT_NEAR(M_PI_2, actor.state().heading, 1e-9);
  EXPECT_TRUE(actor.state().present);
}

TEST(SimulationActor, MovesAsItsVelocitySays)
{
  ActorPlan plan = crossing();
  plan.path = {{0.0, 0.0}, {2.0, 0.0}, {2.0, 2.0}};
  Actor actor(plan);
  for (double time = 0.0; time < 5.0; time += DT)
  {
    const ActorState before = actor.state();
    actor.step(time, DT, FAR_AWAY);
    const ActorState after = actor.state();
    const Eigen::Vector2d v = (after.position - before.position) / DT;
    EXPECT_NEAR(v.norm(), after.velocity.norm(), 0.5) << time;  // in the corner the way is cut
    EXPECT_LE(v.norm(), plan.speed + 1e-6);
  }
  EXPECT_NEAR(0.0, (actor.state().position - Eigen::Vector2d(2.0, 2.0)).norm(), 0.01);
}

TEST(SimulationActor, IsTakenAway)
{
  ActorPlan plan = crossing();
  plan.class_name = "box";
  plan.path = {{3.0, 4.0}};
  plan.heading = 0.4;
  plan.trigger.time = 1.0;
  plan.vanish_after = 2.0;
  Actor actor(plan);
  run(&actor, 0.0, 2.9);
  EXPECT_TRUE(actor.state().present);
  EXPECT_EQ(0.4, actor.state().heading);
  run(&actor, 2.9, 3.1);
  EXPECT_FALSE(actor.state().present);
}

TEST(SimulationActor, VanishesAtTheEndOfItsPath)
{
  ActorPlan plan = crossing();
  plan.vanish_at_end = true;
  Actor actor(plan);
  run(&actor, 0.0, 5.0);
  EXPECT_TRUE(actor.state().present);
  run(&actor, 5.0, 9.0);
  EXPECT_FALSE(actor.state().present);
}

}  // namespace
}  // namespace pi_simulation
