// Judge of recognizer_faults.test.

#include "ros/recognizer_on_graph.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace pi_speech
{
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;

bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}

TEST(RecognizerFaults, MissingAcousticModelIsAnErrorWithTheNameOfTheFolder)
{
  const DiagnosticCollector diagnostics;
  EXPECT_TRUE(diagnostics.waitForSummary("recognizer: recognition", ERROR, "/no/such/model")) << diagnostics.text();
  SetCommands service;
  service.request.commands = {"go"};
  ASSERT_TRUE(ros::service::call("/recognizer/set_commands", service));
  EXPECT_FALSE(service.response.success);
  EXPECT_PRED2(contains, service.response.message, "/no/such/model");
  EXPECT_PRED2(contains, service.response.message, "nothing is understood until set_commands is called");
  // The node stays, and names what else is missing.
  EXPECT_TRUE(diagnostics.waitForSummary("recognizer: sound", WARN, "no sound for")) << diagnostics.text();
  EXPECT_TRUE(diagnostics.waitForValue("recognizer: recognition", "state", "error")) << diagnostics.text();
}

TEST(RecognizerFaults, GarbageWordsThatComeLaterAreTakenBySetCommands)
{
  const TemporaryFolder folder;
  const std::string garbage = folder.path() + "/garbage.txt";
  RecognizerOnGraph recognizer("garbage");
  recognizer.set("garbage_words", garbage);
  recognizer.set("word_network", std::string("none"));  // else PocketSphinx has nothing to do
  ASSERT_TRUE(recognizer.load());
  EXPECT_TRUE(recognizer.diagnosedSummary("recognition", ERROR, garbage)) << recognizer.text();
  folder.file("garbage.txt", "about\nwater\n");
  const SetCommands::Response again = recognizer.setCommands("", {});
  EXPECT_TRUE(again.success) << again.message;
  EXPECT_TRUE(recognizer.diagnosedSummary("recognition", OK, "listens for")) << recognizer.text();
  EXPECT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
}

TEST(RecognizerFaults, CommandsThatComeLaterAreTakenBySetCommands)
{
  const TemporaryFolder folder;
  const std::string commands = folder.path() + "/commands.yaml";
  RecognizerOnGraph recognizer("commands");
  recognizer.set("commands", commands);
  ASSERT_TRUE(recognizer.load());
  EXPECT_TRUE(recognizer.diagnosedSummary("recognition", ERROR, commands)) << recognizer.text();
  folder.file("commands.yaml", "commands: [go, {text: stop, fast: true}]\n");
  const SetCommands::Response again = recognizer.setCommands("", {});
  EXPECT_TRUE(again.success) << again.message;
  EXPECT_PRED2(contains, again.message, "understands go, stop");
  EXPECT_TRUE(recognizer.diagnosed("recognition", "commands", "go, stop")) << recognizer.text();
}

TEST(RecognizerFaults, WithoutAWordNetworkThatCanBeReadPocketSphinxGoesOnAloneAndNamesTheFile)
{
  const TemporaryFolder folder;
  const std::string network = folder.file("words.bin", "this is no network");
  RecognizerOnGraph recognizer("word_network");
  recognizer.set("word_network", network);
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosedSummary("recognition", ERROR, network)) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosedSummary("recognition", ERROR, "PocketSphinx decides alone")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("recognition", "commands heard in running speech", "0")) << recognizer.text();
  const SetCommands::Response again = recognizer.setCommands("", {"go"});
  EXPECT_TRUE(again.success);
  EXPECT_PRED2(contains, again.message, network);
}

TEST(RecognizerFaults, WordsThatCannotBePronouncedAreNamed)
{
  RecognizerOnGraph recognizer("words");
  recognizer.set("sphinx/guess_words", false);
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  const SetCommands::Response unknown = recognizer.setCommands("", {"go", "xyzzyx"});
  EXPECT_FALSE(unknown.success);
  EXPECT_PRED2(contains, unknown.message, "xyzzyx");
  EXPECT_PRED2(contains, unknown.message, "these stay in use: ");
}

TEST(RecognizerFaults, WordsThatAreGuessedAreToldToTheCaller)
{
  RecognizerOnGraph recognizer("guesses");
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("recognition", "words spoken by rules", "0")) << recognizer.text();
  const SetCommands::Response known = recognizer.setCommands("", {"go", "turn around"});
  EXPECT_TRUE(known.success);
  EXPECT_FALSE(contains(known.message, "by rules")) << known.message;

  const SetCommands::Response guessed = recognizer.setCommands("", {"go", "stoppingly"});
  EXPECT_TRUE(guessed.success);
  EXPECT_PRED2(contains, guessed.message, "spoken by rules: stoppingly S T AA P IH NG");
  EXPECT_TRUE(recognizer.log.waitForText("stoppingly S T AA P")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("recognition", "words spoken by rules", "1")) << recognizer.text();
}

TEST(RecognizerFaults, DictationWithoutLanguageModelIsNamedAndCommandsWork)
{
  RecognizerOnGraph recognizer("no_dictation");
  recognizer.set("dictation", true);
  recognizer.set("sphinx/language_model", std::string("/no/such/model.lm"));
  ASSERT_TRUE(recognizer.load());
  EXPECT_TRUE(recognizer.diagnosedSummary("recognition", WARN, "no dictation: ")) << recognizer.text();
  EXPECT_TRUE(recognizer.log.waitForText("/no/such/model.lm")) << recognizer.text();
  EXPECT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
}

TEST(RecognizerFaults, WrongParametersAreRefusedAndUnknownOnesNamed)
{
  RecognizerOnGraph recognizer("parameters");
  recognizer.set("mode", std::string("open"));
  EXPECT_FALSE(recognizer.load());
  EXPECT_TRUE(recognizer.log.waitForText("parameter /parameters/recognizer/mode = \"open\", must be safe or closed"))
      << recognizer.text();
  recognizer.set("mode", std::string("closed"));
  recognizer.set("treshold", 0.4);
  EXPECT_TRUE(recognizer.load());
  EXPECT_TRUE(recognizer.log.waitForText("parameter /parameters/recognizer/treshold means nothing here"))
      << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("recognition", "mode", "closed")) << recognizer.text();
}

TEST(RecognizerFaults, CanBeUnloadedInTheMiddleOfItsWork)
{
  SourceOnGraph source("unloaded");
  RecognizerOnGraph recognizer("unloaded");
  ASSERT_TRUE(recognizer.load());  // it loads models
  ASSERT_TRUE(unloadNodelet("/unloaded/recognizer"));
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(source.waitForListener());
  source.send(quiet(20.0));
}

}  // namespace
}  // namespace pi_speech

int main(int argc, char** argv)
{
  return pi_speech::runOnGraph(argc, argv, "recognizer_faults_test");
}
