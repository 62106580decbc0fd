#include "ros/decision_conversions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace pi_vehicle
{
namespace
{

constexpr double NaN = std::numeric_limits<double>::quiet_NaN();

TEST(DecisionConversions, MotionCommandsGoThereAndBack)
{
  const DriveCommand command = {1.5, -0.2, 2.0, "navigation", "to B"};
  const MotionCommand message = toMotionCommand(command, ros::Time(12.5));
  EXPECT_EQ(message.header.stamp, ros::Time(12.5));
  EXPECT_EQ(message.source, "navigation");
  const DriveCommand again = toDriveCommand(message, "remote");
  EXPECT_EQ(again.speed, 1.5);
  EXPECT_EQ(again.curvature, -0.2);
  EXPECT_EQ(again.max_deceleration, 2.0);
  EXPECT_EQ(again.source, "remote") << "as the topic says";
  EXPECT_EQ(again.reason, "to B");
}

TEST(DecisionConversions, YawRateBecomesCurvature)
{
  geometry_msgs::Twist twist;
  twist.linear.x = 0.5;
  twist.angular.z = 0.2;
  EXPECT_NEAR(toDriveCommand(twist, "remote").curvature, 0.4, 1e-12);
  twist.linear.x = -0.5;  // backwards, turning left: the steering is to the right
  EXPECT_NEAR(toDriveCommand(twist, "remote").curvature, -0.4, 1e-12);
  twist.linear.x = 0.0;
  EXPECT_EQ(toDriveCommand(twist, "remote").curvature, 0.0);
  twist.angular.z = NaN;
  EXPECT_FALSE(std::isfinite(toDriveCommand(twist, "remote").curvature)) << "to be refused";
}

TEST(DecisionConversions, ObstaclesThatAreSeenBecomeThings)
{
  pi_detect::ObstacleArray message;
  pi_detect::Obstacle3D obstacle;
  obstacle.id = 7;
  obstacle.label = "person";
  obstacle.score = 0.8;
  obstacle.position.x = 2.0;
  obstacle.position.y = -1.0;
  obstacle.since_seen = ros::Duration(0.2);
  message.obstacles.push_back(obstacle);
  obstacle.id = 8;
  obstacle.since_seen = ros::Duration(0.3);
  message.obstacles.push_back(obstacle);
  obstacle = {};
  obstacle.id = 9;
  message.obstacles.push_back(obstacle);

  const std::vector<SeenThing> things = toSeenThings(message, 0.25);
  ASSERT_EQ(things.size(), 2U);
  EXPECT_EQ(things[0].id, 7);
  EXPECT_EQ(things[0].label, "person");
  EXPECT_EQ(things[0].score, 0.8);
  EXPECT_EQ(things[0].position, Eigen::Vector2d(2.0, -1.0));
  EXPECT_EQ(things[1].id, 9);
  EXPECT_EQ(things[1].score, 1.0) << "without a class it is there all the same";
}

TEST(DecisionConversions, SeenThingsAreWhereTheirOutlinesAre)
{
  pi_detect::ObstacleArray message;
  message.obstacles.resize(1);
  message.obstacles[0].position.x = 5.0;
  message.obstacles[0].outline.resize(3);
  message.obstacles[0].outline[0].x = 3.0F;
  message.obstacles[0].outline[1].x = 6.0F;
  message.obstacles[0].outline[2].y = 3.0F;
  const std::vector<SeenThing> things = toSeenThings(message, 0.25);
  ASSERT_EQ(1u, things.size());
  EXPECT_NEAR(3.0, things[0].position.x(), 1e-6);
  EXPECT_NEAR(1.0, things[0].position.y(), 1e-6);
  message.obstacles[0].outline.pop_back();
  EXPECT_NEAR(5.0, toSeenThings(message, 0.25)[0].position.x(), 1e-6) << "its box";
}

TEST(DecisionConversions, EventsNameRuleActionAndThing)
{
  RuleEvent event;
  event.rule = "passenger";
  event.action = ReactionAction::GREET;
  event.thing = {7, "person", 0.9, {2.0, -1.0}};
  std_msgs::Header header;
  header.stamp = ros::Time(3.0);
  header.frame_id = "base_link";
  const ReactionEvent message = toMsg(event, header, "good day");
  EXPECT_EQ(message.header.stamp, ros::Time(3.0));
  EXPECT_EQ(message.header.frame_id, "base_link");
  EXPECT_EQ(message.rule, "passenger");
  EXPECT_EQ(message.action, "greet");
  EXPECT_EQ(message.text, "good day");
  EXPECT_EQ(message.id, 7);
  EXPECT_EQ(message.label, "person");
  EXPECT_EQ(message.position.x, 2.0);
  EXPECT_EQ(message.position.y, -1.0);
}

TEST(DecisionConversions, ACommandIsSpokenWhenItsSpeechEnds)
{
  pi_speech::VoiceCommand message;
  EXPECT_EQ(spokenNs(message, ros::Time(9.0)), 9000000000) << "no stamps: now";
  message.header.stamp = ros::Time(8.0);
  EXPECT_EQ(spokenNs(message, ros::Time(9.0)), 8000000000);
  message.speech_end = ros::Time(7.5);
  EXPECT_EQ(spokenNs(message, ros::Time(9.0)), 7500000000);
}

TEST(DecisionConversions, PlacesBecomeGoals)
{
  const geometry_msgs::PoseStamped goal = toGoal({12.0, 3.5, M_PI / 2.0}, ros::Time(1.0), "map");
  EXPECT_EQ(goal.header.frame_id, "map");
  EXPECT_EQ(goal.header.stamp, ros::Time(1.0));
  EXPECT_EQ(goal.pose.position.x, 12.0);
  EXPECT_EQ(goal.pose.position.y, 3.5);
  EXPECT_NEAR(goal.pose.orientation.z, std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(goal.pose.orientation.w, std::sqrt(0.5), 1e-12);
}

TEST(DecisionConversions, TheArbitersStateNamesEverySource)
{
  ArbiterOptions options;
  options.sources = {{"navigation", true, 10, 0.3, 3.0, false}, {"reaction", false, 0, 0.5, 3.0, true}};
  Arbiter arbiter(options);
  const int64_t now_ns = 10000000000;
  ASSERT_EQ(arbiter.submit({1.0, 0.0, 0.0, "navigation", "to B"}, now_ns - 100000000, now_ns), ArbiterAnswer::TAKEN);
  const ArbiterState state = toArbiterState(arbiter, arbiter.update(now_ns), ros::Time(10.0));
  EXPECT_EQ(state.driver, "navigation");
  EXPECT_EQ(state.limited_by, "arbiter");
  EXPECT_EQ(state.reason, "reaction is silent and required");
  ASSERT_EQ(state.sources.size(), 2U);
  EXPECT_EQ(state.sources[0].name, "navigation");
  EXPECT_TRUE(state.sources[0].alive);
  EXPECT_NEAR(state.sources[0].age, 0.1, 1e-9);
  EXPECT_EQ(state.sources[0].speed, 1.0);
  EXPECT_TRUE(state.sources[1].required);
  EXPECT_FALSE(state.sources[1].drives);
  EXPECT_FALSE(state.sources[1].alive);
  EXPECT_EQ(state.sources[1].age, -1.0);
}

TEST(DecisionConversions, StatesDifferByMoreThanNumbers)
{
  ArbiterState a;
  a.reason = "obstacle in 3.25 m";
  a.sources.resize(1);
  ArbiterState b = a;
  b.reason = "obstacle in 12 m";
  b.header.stamp = ros::Time(5.0);
  b.sources[0].age = 0.2;
  EXPECT_TRUE(sameState(a, b));
  b.sources[0].alive = true;
  EXPECT_FALSE(sameState(a, b));
  b = a;
  b.limited_by = "reaction";
  EXPECT_FALSE(sameState(a, b));
  b = a;
  b.reason = "goal reached";
  EXPECT_FALSE(sameState(a, b));
}

}  // namespace
}  // namespace pi_vehicle
