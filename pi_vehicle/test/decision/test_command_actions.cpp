#include "decision/command_actions.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace
{

using namespace pi_vehicle;

constexpr int64_t S = 1000000000;

const char* const TABLE = R"(
places: {gate: [12.0, 3.5, 1.57]}
commands:
  - {text: stop, action: stop}
  - {text: go, action: go}
  - {text: "yes", action: confirm}
  - {text: "no", action: cancel}
  - {text: slower, action: slower}
  - {text: faster, action: faster}
  - {text: left, action: left}
  - {text: to the gate, action: go_to, argument: gate}
)";

CommandActionsOptions table(bool confirm = false)
{
  CommandActionsOptions options = CommandActionsOptions::parse(TABLE, "commands.yaml");
  options.confirm_release = confirm;
  return options;
}

TEST(CommandActions, StopOverridesAllAndLatchesUntilGo)
{
  CommandActions actions(table());
  EXPECT_EQ(actions.speedLimit(S), 3.0);
  EXPECT_EQ(actions.hear("stop", 10 * S, 10 * S).outcome, CommandOutcome::DONE);
  EXPECT_TRUE(actions.stopped());
  EXPECT_EQ(actions.speedLimit(S), 0.0);
  for (const char* text : {"left", "faster", "to the gate"})
  {
    EXPECT_EQ(actions.hear(text, 11 * S, 11 * S).outcome, CommandOutcome::IGNORED_STOPPED) << text;
  }
  EXPECT_EQ(actions.hear("yes", 11 * S, 11 * S).outcome, CommandOutcome::IGNORED_OUT_OF_CONTEXT);
  EXPECT_TRUE(actions.stopped());
  EXPECT_EQ(actions.hear("go", 1000 * S, 1000 * S).outcome, CommandOutcome::DONE) << "latched for ever until then";
  EXPECT_FALSE(actions.stopped());
  EXPECT_EQ(actions.speedLimit(S), 3.0);
}

TEST(CommandActions, ButtonsLatchAndReleaseWithoutAQuestion)
{
  CommandActions actions(table(true));
  actions.stop(10 * S);
  EXPECT_EQ(actions.speedLimit(S), 0.0);
  EXPECT_EQ(actions.hear("go", 11 * S, 11 * S).outcome, CommandOutcome::AWAITS_CONFIRMATION);
  actions.release();
  EXPECT_FALSE(actions.stopped());
  EXPECT_EQ(actions.speedLimit(S), 3.0);
  EXPECT_EQ(actions.hear("yes", 12 * S, 12 * S).outcome, CommandOutcome::IGNORED_OUT_OF_CONTEXT);
}

TEST(CommandActions, GoesOnFromAnEarlierLife)
{
  CommandActions actions(table());
  actions.restore(true, 1.5, 10 * S);
  EXPECT_TRUE(actions.stopped());
  EXPECT_EQ(actions.speedLimit(S), 0.0);
  EXPECT_EQ(actions.keptSpeedLimit(), 1.5);
  EXPECT_EQ(actions.hear("go", 9 * S, 10 * S).outcome, CommandOutcome::IGNORED_OLD) << "said before the restart";
  EXPECT_EQ(actions.hear("go", 11 * S, 11 * S).outcome, CommandOutcome::DONE);
  EXPECT_EQ(actions.speedLimit(S), 1.5);
  actions.restore(false, 100.0, 12 * S);
  EXPECT_EQ(actions.speedLimit(S), 3.0);
  actions.restore(false, 0.0, 12 * S);
  EXPECT_EQ(actions.speedLimit(S), 0.5);
  actions.restore(false, std::numeric_limits<double>::quiet_NaN(), 12 * S);
  EXPECT_EQ(actions.speedLimit(S), 3.0);
}

TEST(CommandActions, ReleaseNeedsConfirmationIfAskedFor)
{
  CommandActions actions(table(true));
  actions.hear("stop", 10 * S, 10 * S);
  EXPECT_EQ(actions.hear("go", 11 * S, 11 * S).outcome, CommandOutcome::AWAITS_CONFIRMATION);
  EXPECT_TRUE(actions.stopped());
  EXPECT_EQ(actions.hear("yes", 17 * S, 17 * S).outcome, CommandOutcome::IGNORED_OUT_OF_CONTEXT) << "too late";
  actions.hear("go", 18 * S, 18 * S);
  EXPECT_EQ(actions.hear("no", 19 * S, 19 * S).outcome, CommandOutcome::DONE);
  EXPECT_EQ(actions.hear("yes", 20 * S, 20 * S).outcome, CommandOutcome::IGNORED_OUT_OF_CONTEXT);
  actions.hear("go", 21 * S, 21 * S);
  actions.hear("stop", 22 * S, 22 * S);
  EXPECT_EQ(actions.hear("yes", 23 * S, 23 * S).outcome, CommandOutcome::IGNORED_OUT_OF_CONTEXT)
      << "the stop withdrew the question";
  actions.hear("go", 24 * S, 24 * S);
  EXPECT_EQ(actions.hear("yes", 25 * S, 25 * S).outcome, CommandOutcome::DONE);
  EXPECT_FALSE(actions.stopped());
}

TEST(CommandActions, IgnoresUnknownAndOldOnes)
{
  CommandActions actions(table());
  EXPECT_EQ(actions.hear("fly", S, S).outcome, CommandOutcome::IGNORED_UNKNOWN);
  EXPECT_EQ(actions.hear("left", 10 * S, 13 * S).outcome, CommandOutcome::IGNORED_OLD);
  EXPECT_FALSE(actions.stopped());
  EXPECT_EQ(actions.hear("stop", 10 * S, 1000 * S).outcome, CommandOutcome::DONE) << "a late stop is a stop";
}

TEST(CommandActions, ADoubtfulStopSlowsDownForAWhileAndAsks)
{
  CommandActions actions(table());
  const CommandResult asked = actions.hearDoubtful("stop", true, 10 * S, 10 * S);
  EXPECT_EQ(asked.outcome, CommandOutcome::AWAITS_CONFIRMATION);
  EXPECT_EQ(asked.action, CommandAction::STOP);
  EXPECT_FALSE(actions.stopped());
  EXPECT_EQ(actions.speedLimit(14 * S), 0.6);
  EXPECT_EQ(actions.keptSpeedLimit(), 3.0);
  EXPECT_EQ(actions.speedLimit(14 * S + 1), 3.0) << "nobody has answered";
  EXPECT_EQ(actions.hear("yes", 15 * S, 15 * S).outcome, CommandOutcome::IGNORED_OUT_OF_CONTEXT);
  EXPECT_EQ(actions.hearDoubtful("stop", true, 16 * S, 16 * S).outcome, CommandOutcome::AWAITS_CONFIRMATION);
}

TEST(CommandActions, ADoubtfulStopIsConfirmedByASecondOneOrYes)
{
  for (const bool by_yes : {false, true})
  {
    CommandActions actions(table());
    actions.hearDoubtful("stop", true, 10 * S, 10 * S);
    EXPECT_EQ(actions.hearDoubtful("stop", true, 10 * S, 11 * S).outcome, CommandOutcome::AWAITS_CONFIRMATION)
        << "the same word";
    EXPECT_EQ(
        (by_yes ? actions.hear("yes", 12 * S, 12 * S) : actions.hearDoubtful("stop", true, 12 * S, 12 * S)).outcome,
        CommandOutcome::DONE);
    EXPECT_TRUE(actions.stopped());
    EXPECT_EQ(actions.speedLimit(100 * S), 0.0) << "latched";
    EXPECT_EQ(actions.hear("go", 101 * S, 101 * S).outcome, CommandOutcome::DONE);
    EXPECT_EQ(actions.speedLimit(101 * S), 3.0);
  }
}

TEST(CommandActions, NoAndGoEndADoubt)
{
  for (const char* answer : {"no", "go"})
  {
    CommandActions actions(table(true));
    actions.hearDoubtful("stop", true, 10 * S, 10 * S);
    EXPECT_EQ(actions.hear(answer, 9 * S, 10 * S).outcome == CommandOutcome::DONE, std::string(answer) == "go");
    EXPECT_TRUE(actions.doubted(10 * S)) << "said before the doubt";
    EXPECT_EQ(actions.hear(answer, 11 * S, 11 * S).outcome, CommandOutcome::DONE);
    EXPECT_EQ(actions.speedLimit(11 * S), 3.0);
    EXPECT_FALSE(actions.stopped());
  }
}

TEST(CommandActions, DoubtfulOnesAreIgnoredUnlessTheyAreAStopOfAMovingVehicle)
{
  CommandActions actions(table());
  EXPECT_EQ(actions.hearDoubtful("left", true, S, S).outcome, CommandOutcome::IGNORED_DOUBTFUL);
  EXPECT_EQ(actions.hearDoubtful("fly", true, S, S).outcome, CommandOutcome::IGNORED_UNKNOWN);
  EXPECT_EQ(actions.hearDoubtful("stop", false, S, S).outcome, CommandOutcome::IGNORED_DOUBTFUL);
  EXPECT_EQ(actions.speedLimit(S), 3.0);
  actions.hear("stop", 2 * S, 2 * S);
  EXPECT_EQ(actions.hearDoubtful("stop", true, 3 * S, 3 * S).outcome, CommandOutcome::IGNORED_DOUBTFUL);
  EXPECT_TRUE(actions.stopped());
}

TEST(CommandActions, AGoSaidBeforeTheStopReleasesNothing)
{
  CommandActions actions(table());
  actions.hear("stop", 10 * S, 10 * S);
  EXPECT_EQ(actions.hear("go", 9 * S, 10 * S + S / 2).outcome, CommandOutcome::IGNORED_OLD);
  EXPECT_TRUE(actions.stopped());
  EXPECT_EQ(actions.hear("go", 2 * S, 2 * S).outcome, CommandOutcome::DONE) << "the clock was set back";
}

TEST(CommandActions, SlowerAndFasterMoveTheBoundWithinItsRange)
{
  CommandActions actions(table());
  actions.hear("faster", S, S);
  EXPECT_EQ(actions.speedLimit(S), 3.0);
  for (int i = 0; i < 20; ++i)
  {
    actions.hear("slower", S, S);
  }
  EXPECT_EQ(actions.speedLimit(S), 0.5);
  actions.hear("faster", S, S);
  EXPECT_EQ(actions.speedLimit(S), 1.0);
}

TEST(CommandActions, GoesToAPlace)
{
  CommandActions actions(table());
  const CommandResult result = actions.hear("to the gate", S, S);
  EXPECT_EQ(result.outcome, CommandOutcome::DONE);
  EXPECT_EQ(result.action, CommandAction::GO_TO);
  EXPECT_EQ(result.argument, "gate");
  EXPECT_EQ(result.place.x, 12.0);
  EXPECT_EQ(result.place.heading, 1.57);
}

std::string errorOfCommands(const std::string& yaml)
{
  return pi_node::test_support::messageOf<std::invalid_argument>([&] { CommandActionsOptions::parse(yaml, "c.yaml"); });
}

TEST(CommandActionsOptions, ErrorsNameEntryFieldValueAndBound)
{
  const std::string base = "{text: stop, action: stop}, {text: go, action: go}";
  EXPECT_EQ(errorOfCommands("commands: [{text: fly, action: fly}]"),
            "c.yaml: commands/0/action = \"fly\", must be one of stop, go, confirm, cancel, slower, faster, left, "
            "right, go_to, say, horn");
  EXPECT_EQ(errorOfCommands("commands: [{text: go, action: go}]"),
            "c.yaml: commands has no action stop, must have one");
  EXPECT_EQ(errorOfCommands("commands: [{text: stop, action: stop}]"),
            "c.yaml: commands has no action go, must have one");
  EXPECT_EQ(errorOfCommands("{options: {confirm_release: true}, commands: [" + base + "]}"),
            "c.yaml: commands has no action confirm, must have one for confirm_release");
  EXPECT_EQ(errorOfCommands("commands: [" + base + ", {text: go, action: left}]"),
            "c.yaml: commands/go is there twice, must be once");
  EXPECT_EQ(errorOfCommands("commands: [" + base + ", {text: home, action: go_to, argument: nowhere}]"),
            "c.yaml: commands/home/argument = \"nowhere\", must be one of places");
  EXPECT_EQ(errorOfCommands("commands: [" + base + ", {text: home, action: go_to}]"),
            "c.yaml: commands/home/argument = \"\", must be given for go_to");
  EXPECT_EQ(errorOfCommands("{options: {doubt_speed: 5}, commands: [" + base + "]}"),
            "c.yaml: options/doubt_speed = 5, must be in [0, 3]");
  EXPECT_EQ(errorOfCommands("{places: {gate: [1, 2]}, commands: [" + base + "]}"),
            "c.yaml: places/gate = 2 numbers, must be [x, y, heading]");
  EXPECT_EQ(errorOfCommands("commands: 3"), "c.yaml: commands must be a list");
  EXPECT_EQ(errorOfCommands("{}"), "c.yaml: commands is missing");
}

TEST(CommandActionsOptions, FileAndCodeAreEqual)
{
  const CommandActionsOptions file = CommandActionsOptions::load(CONFIG_DIR "/commands_actions.yaml");
  const CommandActionsOptions code;
  std::vector<double> left;
  visitFields(file, [&left](const char*, auto value) { left.push_back(value); });
  std::vector<double> right;
  visitFields(code, [&right](const char*, auto value) { right.push_back(value); });
  EXPECT_EQ(left, right);
  EXPECT_EQ(file.commands.size(), 14U);
}

}  // namespace
