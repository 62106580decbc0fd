#include "ros/recognizer_ros_options.h"
#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

#include <filesystem>
#include <utility>

namespace pi_speech
{

namespace parameter_tree = pi_node::parameter_tree;
using XmlRpc::XmlRpcValue;

namespace
{

// Files of the package.
constexpr char COMMANDS[] = "config/commands.yaml";
constexpr char GARBAGE_WORDS[] = "config/garbage_words.txt";
constexpr char CONFIDENCE[] = "config/confidence.yaml";
constexpr char WORD_NETWORK[] = "config/word_network.bin";
constexpr char ADAPTATION[] = "config/adaptation";
constexpr char NONE[] = "none";

void requirePath(const char* name, const std::string& path, bool may_be_none = false)
{
  pi_node::parameters::require(
      path.empty() || path.front() == '/' || (may_be_none && path == NONE), name, "\"" + path + "\"",
      may_be_none
          ? "an absolute path, or none, or empty for the package's own: a node's working folder is not its user's"
          : "an absolute path, or empty for the package's own: a node's working folder is not its user's");
}

void requireModel(const char* name, const std::string& path)
{
  pi_node::parameters::require(!path.empty() && path.front() == '/', name, "\"" + path + "\"", "an absolute path");
}

}  // namespace

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(RecognizerRosOptions& options, Visitor&& visit)
{
  auto& recognizer = options.recognizer;
  auto& end_pointer = recognizer.end_pointer;
  auto& sphinx = recognizer.sphinx;
  visit("commands", options.commands);
  visit("mode", recognizer.mode);
  visit("threshold", recognizer.threshold);
  visit("sure_confidence", recognizer.sure_confidence);
  visit("max_command_s", recognizer.max_command_s);
  visit("end_pointer/begin_threshold", end_pointer.begin_threshold);
  visit("end_pointer/end_threshold", end_pointer.end_threshold);
  visit("end_pointer/min_level_dbfs", end_pointer.min_level_dbfs);
  visit("end_pointer/min_speech_s", end_pointer.min_speech_s);
  visit("end_pointer/end_silence_s", end_pointer.end_silence_s);
  visit("end_pointer/early_silence_s", end_pointer.early_silence_s);
  visit("end_pointer/tail_s", end_pointer.tail_s);
  visit("end_pointer/lead_s", end_pointer.lead_s);
  visit("end_pointer/max_utterance_s", end_pointer.max_utterance_s);
  visit("sphinx/acoustic_model", sphinx.acoustic_model);
  visit("sphinx/dictionary", sphinx.dictionary);
  visit("sphinx/language_model", sphinx.language_model);
  visit("sphinx/adaptation", sphinx.adaptation);
  visit("sphinx/guess_words", sphinx.guess_words);
  visit("sphinx/check_model", sphinx.check_model);
  visit("word_network", recognizer.word_network);
  visit("all_in_running_speech", recognizer.all_in_running_speech);
  visit("garbage_words", recognizer.garbage_words);
  visit("confidence", recognizer.confidence);
  visit("use_runtime", options.use_runtime);
  visit("utterance_service", options.utterance_service);
  visit("utterance_deadline_s", options.utterance_deadline_s);
  visit("start_listening", options.start_listening);
  visit("always_on", options.always_on);
  visit("dictation", options.dictation);
  visit("stamped", options.stamped);
  visit("sample_rate", options.format.sample_rate_hz);
  visit("channels", options.format.channels);
  visit("max_gap_s", options.max_gap_s);
  visit("queue_s", options.queue_s);
  visit("check/clipped_share", options.check.clipped_share);
  visit("check/silent_level_dbfs", options.check.silent_level_dbfs);
  visit("check/silent_s", options.check.silent_s);
  visit("check/missing_s", options.check.missing_s);
  visit("check/window_s", options.check.window_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

static void read(const XmlRpcValue& value, RecognitionMode* field)
{
  pi_node::parameters::readChoice(value, {RecognitionMode::SAFE, RecognitionMode::CLOSED}, field);
}

void RecognizerRosOptions::validate() const
{
  requirePath("commands", commands);
  requirePath("word_network", recognizer.word_network, true);
  requirePath("garbage_words", recognizer.garbage_words);
  requirePath("confidence", recognizer.confidence);
  requireModel("sphinx/acoustic_model", recognizer.sphinx.acoustic_model);
  requireModel("sphinx/dictionary", recognizer.sphinx.dictionary);
  requireModel("sphinx/language_model", recognizer.sphinx.language_model);
  requirePath("sphinx/adaptation", recognizer.sphinx.adaptation, true);
  recognizerOptions("").validate();  // files that are not given will be
  format.validate();
  const pi_node::OptionCheck own("");
  own.range("max_gap_s", max_gap_s, 0.005, 10.0);
  own.range("queue_s", queue_s, 0.1, 60.0);
  own.range("utterance_deadline_s", utterance_deadline_s, 0.05, 5.0);
  parameter_tree::validateGroup("check", check);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

RecognizerOptions RecognizerRosOptions::recognizerOptions(const std::string& package) const
{
  RecognizerOptions complete = recognizer;
  const auto complement = [&package](const char* name, std::string* path)
  {
    if (path->empty())
    {
      *path = package + "/" + name;
    }
  };
  complement(GARBAGE_WORDS, &complete.garbage_words);
  complement(CONFIDENCE, &complete.confidence);
  const auto complementIfThere = [&](const char* name, std::string* path)
  {
    if (*path == NONE)
    {
      path->clear();
    }
    else if (std::filesystem::exists(package + "/" + name))
    {
      complement(name, path);
    }
  };
  if (complete.word_network == NONE)
  {
    complete.word_network.clear();
  }
  else
  {
    complement(WORD_NETWORK, &complete.word_network);
  }
  if (complete.sphinx.adaptation == NONE || complete.sphinx.acoustic_model == SphinxModel().acoustic_model)
  {
    complementIfThere(ADAPTATION, &complete.sphinx.adaptation);
  }
  return complete;
}

std::string RecognizerRosOptions::commandsFile(const std::string& package) const
{
  return commands.empty() ? package + "/" + COMMANDS : commands;
}

}  // namespace pi_speech

template struct pi_node::NodeParameters<pi_speech::RecognizerRosOptions>;
