// config/recognizer.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include <pi_node/test_support/temporary_folder.h>
#include "ros/recognizer_ros_options.h"

#include <filesystem>
#include <string>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<RecognizerRosOptions> recognizer_reader("/recognizer/");

TEST(RecognizerRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  recognizer_reader.expectDefaultsOf(RECOGNIZER_YAML);
}

TEST(RecognizerRosOptions, ParametersComeBackAsTheyWere)
{
  RecognizerRosOptions options;
  options.commands = "/a/commands.yaml";
  options.recognizer.mode = RecognitionMode::CLOSED;
  options.recognizer.threshold = 0.75;
  options.recognizer.word_network = "none";
  options.recognizer.end_pointer.end_silence_s = 0.4;
  options.recognizer.sphinx.check_model = false;
  options.recognizer.sphinx.adaptation = "/an/adaptation";
  options.use_runtime = false;
  options.utterance_service = "/coordinator/recognize_utterance";
  options.format = AudioFormat{44100, 2};
  options.start_listening = false;
  options.dictation = true;
  options.check.silent_s = 3.0;
  Names unknown;
  const RecognizerRosOptions again = RecognizerRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(Names(), unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(RecognizerRosOptions().toText(), again.toText());
  EXPECT_EQ(RecognitionMode::CLOSED, again.recognizer.mode);
  EXPECT_EQ(options.format, again.format);
}

TEST(RecognizerRosOptions, NamesUnknownParameters)
{
  Names unknown;
  recognizer_reader.load("{treshold: 0.3, end_pointer: {end_silence: 0.3}}", &unknown);
  EXPECT_EQ((Names{"/recognizer/end_pointer/end_silence", "/recognizer/treshold"}), unknown);
}

TEST(RecognizerRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /recognizer/mode = \"open\", must be safe or closed", recognizer_reader.refusal("mode: open"));
  EXPECT_PRED2(begins, recognizer_reader.refusal("threshold: 1.5"), "parameter /recognizer/threshold = 1.5");
  EXPECT_PRED2(begins, recognizer_reader.refusal("max_command_s: -1"),
               "parameter /recognizer/max_command_s = -1, must be ");
  EXPECT_PRED2(begins, recognizer_reader.refusal("end_pointer: {end_silence_s: 9}"),
               "parameter /recognizer/end_pointer/end_silence_s = 9, must be in ");
  EXPECT_PRED2(begins, recognizer_reader.refusal("check: {silent_s: 0}"),
               "parameter /recognizer/check/silent_s = 0, must be in ");
  EXPECT_PRED2(begins, recognizer_reader.refusal("commands: commands.yaml"),
               "parameter /recognizer/commands = \"commands.yaml\", must be an absolute path");
  EXPECT_PRED2(begins, recognizer_reader.refusal("word_network: words.bin"),
               "parameter /recognizer/word_network = \"words.bin\", must be");
  EXPECT_PRED2(begins, recognizer_reader.refusal("sphinx: {adaptation: adapted}"),
               "parameter /recognizer/sphinx/adaptation = \"adapted\", must be an absolute path, or none, or empty");
  EXPECT_PRED2(begins, recognizer_reader.refusal("sphinx: {acoustic_model: \"\"}"),
               "parameter /recognizer/sphinx/acoustic_model = \"\", must be an absolute path");
  EXPECT_EQ("parameter /recognizer/max_gap_s = 0, must be in [0.005, 10]", recognizer_reader.refusal("max_gap_s: 0"));
  EXPECT_EQ("parameter /recognizer/queue_s = 100, must be in [0.1, 60]", recognizer_reader.refusal("queue_s: 100"));
  EXPECT_EQ("parameter /recognizer/utterance_deadline_s = 9, must be in [0.05, 5]",
            recognizer_reader.refusal("utterance_deadline_s: 9"));
  EXPECT_EQ("parameter /recognizer/always_on = 1, must be true or false", recognizer_reader.refusal("always_on: 1"));
  EXPECT_PRED2(begins, recognizer_reader.refusal("channels: 0"), "parameter /recognizer/channels = 0, must be ");
  EXPECT_PRED2(begins, recognizer_reader.refusal("sample_rate: 1000"), "parameter /recognizer/sample_rate");
}

TEST(RecognizerRosOptions, FilesThatAreNotGivenAreThePackages)
{
  const TemporaryFolder package;
  RecognizerRosOptions options;
  EXPECT_EQ(package.path() + "/config/commands.yaml", options.commandsFile(package.path()));
  const RecognizerOptions own = options.recognizerOptions(package.path());
  EXPECT_EQ(package.path() + "/config/garbage_words.txt", own.garbage_words);
  EXPECT_EQ(package.path() + "/config/confidence.yaml", own.confidence);
  EXPECT_EQ(package.path() + "/config/word_network.bin", own.word_network);
  options.recognizer.word_network = "none";
  EXPECT_EQ("", options.recognizerOptions(package.path()).word_network);

  EXPECT_EQ("", own.sphinx.adaptation);  // it has none
  const std::string adaptation = package.path() + "/config/adaptation";
  std::filesystem::create_directories(adaptation);
  EXPECT_EQ(adaptation, options.recognizerOptions(package.path()).sphinx.adaptation);
  options.recognizer.sphinx.adaptation = "none";
  EXPECT_EQ("", options.recognizerOptions(package.path()).sphinx.adaptation);
  options.recognizer.sphinx.adaptation = "";
  options.recognizer.sphinx.acoustic_model = "/another/model";  // which it does not belong to
  EXPECT_EQ("", options.recognizerOptions(package.path()).sphinx.adaptation);

  options.commands = "/a";
  options.recognizer.word_network = "/n";
  options.recognizer.garbage_words = "/c";
  options.recognizer.confidence = "/d";
  options.recognizer.sphinx.adaptation = "/e";
  EXPECT_EQ("/a", options.commandsFile(package.path()));
  const RecognizerOptions given = options.recognizerOptions(package.path());
  EXPECT_EQ("/n", given.word_network);
  EXPECT_EQ("/c", given.garbage_words);
  EXPECT_EQ("/d", given.confidence);
  EXPECT_EQ("/e", given.sphinx.adaptation);
}

}  // namespace
}  // namespace pi_speech
