#include "ros/navigation/kept_goal.h"

#include <gtest/gtest.h>

#include <string>

namespace pi_vehicle
{
namespace
{

using XmlRpc::XmlRpcValue;

KeptGoal example()
{
  KeptGoal kept;
  kept.goal.waypoints.resize(2);
  kept.goal.waypoints[0].position = {1.5, -2.25};
  kept.goal.waypoints[1].position = {7.0, 0.5};
  kept.goal.waypoints[1].heading = 1.25;
  kept.goal.max_speed = 1.5;
  kept.goal.loop = false;
  kept.id = "client-7";
  kept.stamp = ros::Time(1700000000, 500000000);
  kept.alive = 1700000004.5;
  return kept;
}

std::string problemOf(const XmlRpcValue& value)
{
  try
  {
    toKeptGoal(value, "/navigation/kept_goal");
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(KeptGoal, ComesBackAsItWasKept)
{
  const KeptGoal kept = example();
  const std::optional<KeptGoal> back = toKeptGoal(toParameter(kept), "kept_goal");
  ASSERT_TRUE(back);
  ASSERT_EQ(back->goal.waypoints.size(), 2u);
  EXPECT_EQ(back->goal.waypoints[0].position, kept.goal.waypoints[0].position);
  EXPECT_FALSE(back->goal.waypoints[0].heading);
  EXPECT_EQ(back->goal.waypoints[1].position, kept.goal.waypoints[1].position);
  EXPECT_EQ(back->goal.waypoints[1].heading, kept.goal.waypoints[1].heading);
  EXPECT_EQ(back->goal.max_speed, kept.goal.max_speed);
  EXPECT_EQ(back->goal.loop, kept.goal.loop);
  EXPECT_EQ(back->id, kept.id);
  EXPECT_NEAR(back->stamp.toSec(), kept.stamp.toSec(), 1e-6);
  EXPECT_EQ(back->alive, kept.alive);
}

TEST(KeptGoal, IsNoneAfterAnEnd)
{
  EXPECT_FALSE(toKeptGoal(XmlRpcValue(std::string()), "kept_goal"));
}

TEST(KeptGoal, SomethingElseIsRefusedByNameAndValue)
{
  EXPECT_EQ(problemOf(XmlRpcValue(5)),
            "parameter /navigation/kept_goal = 5: = 5, must be a map; must be what this node left there: delete it");
  XmlRpcValue value = toParameter(example());
  XmlRpcValue one;
  one[0] = 1.5;
  value["points"][0] = one;
  EXPECT_NE(problemOf(value).find("a point has 1 numbers, must have 2 or 3"), std::string::npos) << problemOf(value);
  value = toParameter(example());
  value["stamp"] = -1.0;
  EXPECT_NE(problemOf(value).find("its stamp is none"), std::string::npos) << problemOf(value);
  XmlRpcValue without;
  without["points"] = toParameter(example())["points"];
  EXPECT_NE(problemOf(without).find("it has no max_speed"), std::string::npos) << problemOf(without);
}

}  // namespace
}  // namespace pi_vehicle
