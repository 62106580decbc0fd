// Judge of command.test.

#include "ros/child_node.h"

#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <pi_node/child_process.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/VoiceCommand.h>
#include <pi_vehicle/CommandState.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>
#include <std_srvs/Trigger.h>

#include <memory>
#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;

const char* const TABLE = R"(
options: {max_age: 60.0, max_speed: 3.0, speed_step: 0.5, doubt_timeout: 3.0}
places: {gate: [12.0, 3.5, 0.0]}
commands:
  - {text: stop, action: stop}
  - {text: go, action: go}
  - {text: slower, action: slower}
  - {text: left, action: left}
  - {text: to the gate, action: go_to, argument: gate}
  - {text: who are you, action: say, argument: a vehicle}
  - {text: watch out, action: horn}
)";

class CommandNode : public testing::Test
{
protected:
  void SetUp() override
  {
    ros::param::del("/command");
    ros::param::set("/command/actions_file", folder_.file("actions.yaml", TABLE));
    ros::param::set("/command/diagnostic_period", 0.1);
    commands_ = ros::NodeHandle().advertise<pi_speech::VoiceCommand>("command", 10);
    doubtful_ = ros::NodeHandle().advertise<pi_speech::VoiceCommand>("doubtful_command", 10);
    vehicle_ = ros::NodeHandle().advertise<VehicleState>("vehicle_state", 1, true);
    start();
  }

  void start()
  {
    node_.reset();
    ASSERT_TRUE(until(TIMEOUT_S, [this] { return commands_.getNumSubscribers() == 0; }));
    motion_.clear();
    states_.clear();
    node_ = std::make_unique<test::ChildNode>(COMMAND_NODE, "command");
    ASSERT_TRUE(
        until(TIMEOUT_S, [this] { return commands_.getNumSubscribers() > 0 && doubtful_.getNumSubscribers() > 0; }));
    ASSERT_TRUE(motion_.waitForPublisher() && states_.waitForPublisher());
    ASSERT_TRUE(until(TIMEOUT_S, [this] { return motion_.last() && states_.last(); }));
  }

  /// Says it and waits for what the node makes of it.
  CommandState say(const std::string& text, double age_s = 0.0) { return say(commands_, text, age_s); }
  CommandState mumble(const std::string& text) { return say(doubtful_, text, 0.0); }
  CommandState say(const ros::Publisher& by, const std::string& text, double age_s)
  {
    states_.clear();
    pi_speech::VoiceCommand message;
    message.speech_end = ros::Time::now() - ros::Duration(age_s);
    message.header.stamp = message.speech_end;
    message.text = text;
    message.confidence = 0.9F;
    by.publish(message);
    EXPECT_TRUE(states_.waitFor([&text](const CommandState& state) { return state.text == text; })) << text;
    return states_.last() ? *states_.last() : CommandState();
  }
  bool waitForLimit(double speed)
  {
    motion_.clear();
    return motion_.waitFor([speed](const MotionCommand& motion) { return motion.speed == speed; });
  }
  static bool waitForKept(const std::string& name, bool value)
  {
    return until(TIMEOUT_S,
                 [&]
                 {
                   bool kept = !value;
                   return ros::param::get(name, kept) && kept == value;
                 });
  }
  static std_srvs::Trigger::Response call(const std::string& service)
  {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(ros::service::waitForService(service, ros::Duration(TIMEOUT_S)));
    EXPECT_TRUE(ros::service::call(service, trigger)) << service;
    return trigger.response;
  }

  const TemporaryFolder folder_;
  ros::Publisher commands_;
  ros::Publisher doubtful_;
  ros::Publisher vehicle_;
  Collector<MotionCommand> motion_{"motion/command"};
  Collector<CommandState> states_{"command/state"};
  Collector<geometry_msgs::PoseStamped> goals_{"goal"};
  Collector<std_msgs::String> turns_{"turn"};
  Collector<std_msgs::String> said_{"say"};
  Collector<std_msgs::Empty> horn_{"horn"};
  DiagnosticCollector diagnostics_;
  std::unique_ptr<test::ChildNode> node_;
};

TEST_F(CommandNode, StopIsPublishedWhenItIsHeardAndLatchesUntilGo)
{
  EXPECT_TRUE(waitForLimit(3.0));
  EXPECT_TRUE(diagnostics_.waitForSummary("command: command", OK, "at most 3.00 m/s")) << diagnostics_.text();
  motion_.clear();
  const CommandState stopped = say("stop");
  EXPECT_TRUE(stopped.stopped);
  EXPECT_EQ(stopped.speed_limit, 0.0);
  EXPECT_EQ(stopped.outcome, "done");
  // The first stop has the stamp of the decision itself: it did not wait for a tick.
  ASSERT_TRUE(motion_.waitFor([](const MotionCommand& motion) { return motion.speed == 0.0; }));
  for (const auto& motion : motion_.messages())
  {
    if (motion->speed == 0.0)
    {
      EXPECT_EQ(motion->header.stamp, stopped.header.stamp);
      EXPECT_EQ(motion->max_deceleration, 2.5);
      EXPECT_EQ(motion->source, "command");
      EXPECT_NE(std::string::npos, motion->reason.find("stop")) << motion->reason;
      break;
    }
  }
  EXPECT_TRUE(diagnostics_.waitForSummary("command: command", WARN, "stopped until released")) << diagnostics_.text();
  EXPECT_EQ(say("to the gate").outcome, "ignored: stopped");
  EXPECT_EQ(say("slower").outcome, "ignored: stopped");
  motion_.clear();
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return motion_.messages().size() >= 20; }));  // it goes on saying so
  for (const auto& motion : motion_.messages())
  {
    ASSERT_EQ(motion->speed, 0.0);
  }
  EXPECT_EQ(say("go", 30.0).outcome, "ignored: old") << "said before the stop";
  EXPECT_TRUE(states_.last()->stopped);
  EXPECT_FALSE(say("go").stopped);
  EXPECT_TRUE(waitForLimit(3.0));
  EXPECT_TRUE(goals_.messages().empty());
}

TEST_F(CommandNode, ADoubtfulStopSlowsDownAndAsks)
{
  ASSERT_TRUE(said_.waitForPublisher());
  const CommandState asked = mumble("stop");
  EXPECT_EQ(asked.outcome, "awaits confirmation");
  EXPECT_FALSE(asked.stopped);
  EXPECT_EQ(asked.speed_limit, 0.6);
  EXPECT_TRUE(said_.waitFor([](const std_msgs::String& text) { return text.data == "please say it again"; }));
  EXPECT_TRUE(waitForLimit(0.6));
  EXPECT_TRUE(waitForLimit(3.0)) << "nobody has answered";
  EXPECT_TRUE(states_.waitFor([](const CommandState& state)
                              { return state.speed_limit == 3.0 && state.reason.find("nobody") == 0; }));

  EXPECT_FALSE(mumble("stop").stopped);
  EXPECT_TRUE(mumble("stop").stopped) << "said twice";
  EXPECT_TRUE(waitForLimit(0.0));
  ASSERT_TRUE(waitForKept("/command/latched", true));
  EXPECT_FALSE(say("go").stopped);
}

TEST_F(CommandNode, ADoubtfulStopOfAStandingVehicleIsIgnored)
{
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return vehicle_.getNumSubscribers() > 0; }));
  VehicleState state;
  EXPECT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      state.header.stamp = ros::Time::now();
                      vehicle_.publish(state);
                      say("go");  // ends the doubt and the stop of a round that the state came too late for
                      return mumble("stop").outcome == "ignored: doubtful";
                    }));
  state.header.stamp = ros::Time::now();
  state.moving = true;
  vehicle_.publish(state);
  EXPECT_TRUE(until(TIMEOUT_S,
                    [this]
                    {
                      say("go");
                      return mumble("stop").outcome == "awaits confirmation";
                    }));
}

TEST_F(CommandNode, TheLatchAndTheLimitOutliveACrash)
{
  EXPECT_EQ(say("slower").speed_limit, 2.5);
  EXPECT_TRUE(say("stop").stopped);
  ASSERT_TRUE(waitForKept("/command/latched", true));
  ASSERT_EQ(-1, node_->end(SIGKILL));
  start();
  EXPECT_TRUE(states_.last()->stopped);
  EXPECT_NE(std::string::npos, states_.last()->reason.find("earlier life")) << states_.last()->reason;
  for (const auto& motion : motion_.messages())
  {
    EXPECT_EQ(motion->speed, 0.0) << "from its first message on";
  }
  EXPECT_EQ(say("go", 30.0).outcome, "ignored: old") << "said before the restart";
  EXPECT_FALSE(say("go").stopped);
  EXPECT_TRUE(waitForLimit(2.5));
  ASSERT_TRUE(waitForKept("/command/latched", false));
  ASSERT_EQ(-1, node_->end(SIGKILL));
  start();
  EXPECT_FALSE(states_.last()->stopped);
  EXPECT_EQ(states_.last()->speed_limit, 2.5);
}

TEST_F(CommandNode, IsStoppedAtTheStartIfToldSo)
{
  ros::param::set("/command/stopped_at_start", true);
  start();
  EXPECT_TRUE(states_.last()->stopped);
  EXPECT_TRUE(waitForLimit(0.0));
  EXPECT_FALSE(say("go").stopped);
}

TEST_F(CommandNode, ButtonsStopAndRelease)
{
  EXPECT_NE(0, call("/command/stop").success);
  EXPECT_TRUE(waitForLimit(0.0));
  ASSERT_TRUE(waitForKept("/command/latched", true));
  EXPECT_EQ("released", call("/command/release").message);
  EXPECT_TRUE(waitForLimit(3.0));
  EXPECT_EQ("was not stopped", call("/command/release").message);
}

TEST_F(CommandNode, DoesWhatItsTableSays)
{
  ASSERT_TRUE(goals_.waitForPublisher() && turns_.waitForPublisher() && said_.waitForPublisher() &&
              horn_.waitForPublisher());
  say("to the gate");
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return goals_.last() != nullptr; }));
  EXPECT_EQ(goals_.last()->header.frame_id, "map");
  EXPECT_EQ(goals_.last()->pose.position.x, 12.0);
  say("left");
  EXPECT_TRUE(turns_.waitFor([](const std_msgs::String& turn) { return turn.data == "left"; }));
  say("who are you");
  EXPECT_TRUE(said_.waitFor([](const std_msgs::String& text) { return text.data == "a vehicle"; }));
  say("watch out");
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return horn_.last() != nullptr; }));
  EXPECT_EQ(say("slower").speed_limit, 2.5);
  EXPECT_TRUE(waitForLimit(2.5));
  EXPECT_EQ(say("open sesame").outcome, "ignored: unknown");
  EXPECT_TRUE(diagnostics_.waitForSummary("command: command", WARN, "is not in the table of commands"))
      << diagnostics_.text();
  EXPECT_EQ(turns_.messages().size(), 1U);
}

TEST_F(CommandNode, AWrongTableEndsTheNodeWithOneError)
{
  folder_.file("actions.yaml", "commands: [{text: stop, action: halt}]");
  node_.reset();
  const pi_node::ChildResult result = pi_node::runChild(COMMAND_NODE, {"__name:=command"}, {});
  EXPECT_TRUE(WIFEXITED(result.status) && WEXITSTATUS(result.status) == 1) << result.status;
  EXPECT_NE(std::string::npos, result.output.find("commands/0/action = \"halt\", must be one of stop, go,"))
      << result.output;
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "command_test");
}
