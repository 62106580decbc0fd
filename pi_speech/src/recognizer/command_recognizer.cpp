#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>
#include <pi_speech/command_recognizer.h>
#include "recognizer/grammar.h"
#include "recognizer/network_commands.h"
#include "recognizer/words.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

namespace pi_speech
{

namespace
{

using pi_node::secondsSince;

/// Scale of log-likelihoods for the choice of a command and for margins: frames are not independent.
constexpr double SPHINX_SCALE = 0.25;
/// A command's score in place of none, and least frames that ratios are taken over.
constexpr double NO_SCORE = -2000.0;
constexpr int LEAST_FRAMES = 3;
/// Most speech in a command of n words, including background that counts as speech: LEAST + n * MORE.
constexpr double LEAST_COMMAND_S = 1.0;
constexpr double MORE_PER_WORD_S = 0.6;
/// More commands than that are not searched for one by one.
constexpr size_t MOST_SEARCHES = 64;
/// Talk is two in a row of this many garbage words.
constexpr size_t TALK_WORDS = 100;
constexpr int TALK_WORDS_IN_A_ROW = 2;
constexpr int64_t NEVER = -100L * SAMPLE_RATE_HZ;
/// Two answers for the same command whose ends are closer than that are for the same word.
constexpr int64_t SAME_WORD = SAMPLE_RATE_HZ / 2;

double seconds(int64_t samples)
{
  return static_cast<double>(samples) / SAMPLE_RATE_HZ;
}

/// ln of the sum of exponentials of all but one.
double sumOfOthers(const std::vector<double>& values, size_t left_out)
{
  double most = -std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < values.size(); ++i)
  {
    most = i == left_out ? most : std::max(most, values[i]);
  }
  if (!std::isfinite(most))
  {
    return most;
  }
  double sum = 0.0;
  for (size_t i = 0; i < values.size(); ++i)
  {
    sum += i == left_out ? 0.0 : std::exp(values[i] - most);
  }
  return most + std::log(sum);
}

/// A difference of scores that may be infinite, or both.
double margin(double score, double other)
{
  const double difference = score - other;
  return std::isnan(difference) ? 0.0 : std::clamp(difference, -100.0, 100.0);
}

double scoreOf(const SphinxHypothesis& hypothesis)
{
  return std::max(hypothesis.score, NO_SCORE);
}

/// Of the words, and the silence between them.
int framesOf(const SphinxHypothesis& hypothesis)
{
  return hypothesis.words.empty()
             ? LEAST_FRAMES
             : std::max(LEAST_FRAMES, hypothesis.words.back().last_frame - hypothesis.words.front().first_frame + 1);
}

double wordScoreOf(const SphinxHypothesis& hypothesis)
{
  double sum = 0.0;
  for (const SphinxHypothesis::Word& word : hypothesis.words)
  {
    sum += word.score;
  }
  return hypothesis.words.empty() ? NO_SCORE : sum / framesOf(hypothesis);
}

std::string number(double value)
{
  return pi_node::format("%.2f", value);
}

std::string faint(double confidence, double threshold)
{
  return "confidence " + number(confidence) + " below " + number(threshold);
}

}  // namespace

const char* toString(RecognitionMode mode)
{
  return mode == RecognitionMode::SAFE ? "safe" : "closed";
}

void RecognizerOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("threshold", threshold, 0.001, 0.999);
  check.range("sure_confidence", sure_confidence, 0.001, 1.0);
  check.range("max_command_s", max_command_s, 0.3, 60.0);
  try
  {
    end_pointer.validate();
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(std::string("end_pointer/") + error.what());
  }
  if (mode == RecognitionMode::SAFE && (garbage_words.empty() || confidence.empty()))
  {
    throw std::invalid_argument(std::string(garbage_words.empty() ? "garbage_words" : "confidence") +
                                " = \"\", must be a file in mode safe: nothing could be rejected without it");
  }
}

double RecognizerOptions::thresholdOf(const Command& command) const
{
  return command.threshold > 0.0 ? command.threshold : threshold;
}

double RecognizerOptions::networkThresholdOf(const Command& command) const
{
  return command.network_threshold > 0.0 ? command.network_threshold : thresholdOf(command);
}

struct CommandRecognizer::Impl
{
  Impl(const RecognizerOptions& options_in, const CommandTable& table_in)
    : options(options_in)
    , table((table_in.validate(), table_in))
    , network((options_in.validate(), options_in), table)
    , end_pointer(options_in.end_pointer,
                  [this](EndPointer::Event event, const Utterance& utterance) { onEvent(event, utterance); })
  {
    if (network.count() == table.commands.size())
    {
      return;  // PocketSphinx has nothing to decide
    }
    std::vector<std::string> words = table.words();
    std::vector<std::string> garbage;
    if (options.mode == RecognitionMode::SAFE)
    {
      garbage = garbageBeside(table, readGarbageWords(options.garbage_words));
      words.insert(words.end(), garbage.begin(), garbage.end());
      confidence = ConfidenceModel::load(options.confidence);
    }
    else if (!options.confidence.empty())
    {
      confidence = ConfidenceModel::load(options.confidence);
    }
    const std::vector<std::string> texts = table.texts();
    std::vector<std::string> grammars{toJsgf(texts)};
    if (texts.size() <= MOST_SEARCHES)
    {
      first_command_grammar = grammars.size();
      for (const std::string& text : texts)
      {
        grammars.push_back(toJsgf({text}));
      }
    }
    if (!garbage.empty())
    {
      first_garbage_grammar = grammars.size();
      grammars.push_back(toJsgf(garbage));
      garbage.resize(std::min(garbage.size(), TALK_WORDS));
      grammars.push_back(toJsgf(garbage, TALK_WORDS_IN_A_ROW));
    }
    std::sort(words.begin(), words.end());
    words.erase(std::unique(words.begin(), words.end()), words.end());
    sphinx = std::make_unique<SphinxDecoder>(options.sphinx, grammars, words);
  }

  /// Gives the sound to the network and to the end-pointer in steps so short that their answers come in order.
  void process(const int16_t* samples, size_t count)
  {
    if (network.inStream().empty())
    {
      end_pointer.process(samples, count);
      return;
    }
    const auto sink_of_network = [this](const NetworkCommands::Heard& heard) { onHeard(heard); };
    while (count > 0)
    {
      const size_t step = std::min(count, static_cast<size_t>(HOP_SAMPLES));
      end_pointer.process(samples, step);
      network.process(samples, step, sink_of_network);
      samples += step;
      count -= step;
    }
  }

  /// Ends what is in progress. What the network has nearly heard counts as at the end of an utterance.
  void flush()
  {
    network.restart(end_pointer.samplesSeen(), [this](const NetworkCommands::Heard& heard) { onHeard(heard); });
    end_pointer.flush();
    tellHeld();
  }

  void reset()
  {
    end_pointer.reset();
    network.restart(0, [](const NetworkCommands::Heard&) {});
    held.reset();
    told_end = NEVER;
  }

  /// Tells a word of the stream. While other computers are asked, only fast commands do not wait for their answer.
  void onHeard(const NetworkCommands::Heard& heard)
  {
    Recognition recognition;
    recognition.text = table.commands[heard.command].text;
    recognition.confidence = heard.confidence;
    recognition.accepted = !heard.doubtful;
    recognition.doubtful = heard.doubtful;
    recognition.fast = true;
    recognition.speech_begin = heard.begin;
    recognition.speech_end = heard.end;
    recognition.decided_at = end_pointer.samplesSeen();
    recognition.evidence.command = recognition.text;
    if (heard.doubtful)
    {
      recognition.reason = faint(heard.confidence, options.networkThresholdOf(table.commands[heard.command]));
      if (*sink)
      {
        (*sink)(recognition);
      }
      return;
    }
    if (elsewhere && end_pointer.inSpeech() && !table.commands[heard.command].fast)
    {
      tellHeld();
      held = recognition;
      return;
    }
    tellSpotted(recognition);
  }

  void tellSpotted(const Recognition& recognition)
  {
    if (recognition.text == told_text && recognition.speech_end < told_end + SAME_WORD)
    {
      return;  // the decision about the utterance was faster
    }
    told_text = recognition.text;
    told_end = recognition.speech_end;
    told = recognition;
    if (*sink)
    {
      (*sink)(recognition);
    }
  }

  void tellHeld()
  {
    if (held)
    {
      held->decided_at = end_pointer.samplesSeen();
      tellSpotted(*held);
      held.reset();
    }
  }

  void onEvent(EndPointer::Event event, const Utterance& utterance)
  {
    switch (event)
    {
      case EndPointer::Event::BEGIN:
        early.reset();
        told_fast = false;
        return;
      case EndPointer::Event::PAUSE:
        // Decides before it is certain that the speech has ended, so that the command comes without delay.
        early = decide(utterance);
        early_end = utterance.speech_end;
        tellFast(utterance);
        return;
      case EndPointer::Event::END:
        break;
    }
    if (endSpotted(utterance))
    {
      return;
    }
    const bool is_decided = early && early_end == utterance.speech_end && !utterance.cut;
    Recognition recognition = is_decided ? *early : decide(utterance);
    // A command that was reported early is not reported again, but another command is.
    if (told_fast && (recognition.text == fast.text || !recognition.accepted))
    {
      recognition = fast;
    }
    else
    {
      tell(&recognition, utterance);
    }
    if (utterance_sink)
    {
      utterance_sink(utterance, recognition);
    }
  }

  /// Ends an utterance in which the network has heard something. @return false if there is more to decide.
  bool endSpotted(const Utterance& utterance)
  {
    const bool answered = early && early->accepted && !early->place.empty() && early_end == utterance.speech_end;
    if (held && !answered)
    {
      tellHeld();
    }
    held.reset();
    if (told_end < utterance.begin || (sphinx && !utterance.cut) || answered)
    {
      return false;
    }
    if (utterance_sink)
    {
      utterance_sink(utterance, told);
    }
    return true;
  }

  void tellFast(const Utterance& utterance)
  {
    const auto command = find(early->text);
    if (!told_fast && early->accepted && command != table.commands.end() && (command->fast || isSure(*early)))
    {
      told_fast = true;
      fast = *early;
      fast.fast = true;
      tell(&fast, utterance);
    }
  }

  bool isSure(const Recognition& recognition) const
  {
    if ((sphinx && !confidence) || recognition.confidence < options.sure_confidence || options.sure_confidence >= 1.0)
    {
      return false;
    }
    const std::string beginning = recognition.text + " ";
    return std::none_of(table.commands.begin(), table.commands.end(),
                        [&beginning](const Command& command)
                        { return command.text.compare(0, beginning.size(), beginning) == 0; });
  }

  void tell(Recognition* recognition, const Utterance& utterance)
  {
    recognition->speech_begin = utterance.speech_begin;
    recognition->speech_end = utterance.speech_end;
    recognition->decided_at = end_pointer.samplesSeen();
    if (recognition->accepted)
    {
      if (recognition->text == told_text && told_end >= utterance.begin)
      {
        return;  // the network has heard it in the stream
      }
      told_text = recognition->text;
      told_end = recognition->speech_end;
    }
    if (*sink)
    {
      (*sink)(*recognition);
    }
  }

  std::vector<Command>::const_iterator find(const std::string& text) const
  {
    return std::find_if(table.commands.begin(), table.commands.end(),
                        [&text](const Command& command) { return command.text == text; });
  }

  Recognition decide(const Utterance& utterance)
  {
    const double speech_s = seconds(utterance.speech_end - utterance.speech_begin);
    if (options.mode == RecognitionMode::SAFE && (utterance.cut || speech_s > options.max_command_s))
    {
      Recognition recognition;
      recognition.reason =
          "too long: " + number(speech_s) + " s of speech, " + number(options.max_command_s) + " s at most";
      recognition.snr_db = utterance.snr_db;
      return recognition;
    }
    if (elsewhere)
    {
      const auto start = std::chrono::steady_clock::now();
      if (std::optional<Recognition> recognition = elsewhere(utterance))
      {
        recognition->snr_db = utterance.snr_db;
        recognition->work_s = secondsSince(start);
        if (find(recognition->text) == table.commands.end())
        {
          recognition->text.clear();
          recognition->accepted = false;
        }
        return *recognition;
      }
    }
    Recognition recognition = recognize(utterance.samples.data(), utterance.samples.size(), speech_s);
    recognition.snr_db = utterance.snr_db;
    return recognition;
  }

  Recognition recognize(const int16_t* samples, size_t count, double speech_s)
  {
    const auto start = std::chrono::steady_clock::now();
    Recognition recognition;
    runner(speech_s, [&] { choose(samples, count, speech_s, &recognition); });
    recognition.work_s = secondsSince(start);
    return recognition;
  }

  /// The hypothesis of PocketSphinx for each command; if there are too many, for the best one only.
  std::vector<SphinxHypothesis> searchCommands()
  {
    std::vector<SphinxHypothesis> hypotheses(table.commands.size());
    if (first_command_grammar != 0)
    {
      for (size_t i = 0; i < hypotheses.size(); ++i)
      {
        hypotheses[i] = sphinx->find(first_command_grammar + i);
      }
      return hypotheses;
    }
    SphinxHypothesis best = sphinx->find(0);
    const auto command = find(best.text());
    if (command != table.commands.end())
    {
      hypotheses[static_cast<size_t>(command - table.commands.begin())] = std::move(best);
    }
    return hypotheses;
  }

  void chooseByNetwork(const int16_t* samples, size_t count, double speech_s, Recognition* recognition)
  {
    const std::optional<NetworkCommands::Best> best = network.listenToPiece(samples, count);
    if (!best)
    {
      recognition->reason = "no speech was understood";
      return;
    }
    const Command& command = table.commands[best->command];
    recognition->text = command.text;
    recognition->confidence = best->confidence;
    recognition->evidence.command = command.text;
    recognition->evidence.speech_s = speech_s;
    judge(command, options.networkThresholdOf(command), recognition);
  }

  void choose(const int16_t* samples, size_t count, double speech_s, Recognition* recognition)
  {
    if (!sphinx)
    {
      chooseByNetwork(samples, count, speech_s, recognition);
      return;
    }
    sphinx->listen(samples, count);
    const std::vector<SphinxHypothesis> hypotheses = searchCommands();
    std::vector<double> scores;
    std::vector<double> logits;
    bool any = false;
    for (const SphinxHypothesis& hypothesis : hypotheses)
    {
      scores.push_back(scoreOf(hypothesis));
      logits.push_back(SPHINX_SCALE * scores.back());
      any = any || !hypothesis.words.empty();
    }
    Evidence& evidence = recognition->evidence;
    const auto best = static_cast<size_t>(std::max_element(logits.begin(), logits.end()) - logits.begin());
    if (!any || !std::isfinite(logits[best]))
    {
      recognition->reason = "no speech was understood";
      return;
    }
    const Command& candidate = table.commands[best];
    if (network.hears(best))
    {
      chooseByNetwork(samples, count, speech_s, recognition);
      return;
    }
    recognition->text = candidate.text;
    evidence.command = candidate.text;
    evidence.words = static_cast<int>(1 + std::count(candidate.text.begin(), candidate.text.end(), ' '));
    evidence.speech_s = speech_s;
    evidence.word_margin = margin(logits[best], sumOfOthers(logits, best));
    recognition->confidence = 1.0;
    if (confidence)
    {
      compareBySphinx(hypotheses[best], scores[best], &evidence);
      recognition->confidence = confidence->confidence(evidence);
    }
    judge(candidate, options.thresholdOf(candidate), recognition);
  }

  /// Compares a candidate with other speech.
  void compareBySphinx(const SphinxHypothesis& hypothesis, double score, Evidence* evidence)
  {
    const auto ratio = [&](double other) { return (score - other) / framesOf(hypothesis); };
    if (first_garbage_grammar != 0)
    {
      evidence->garbage_ratio = ratio(scoreOf(sphinx->find(first_garbage_grammar)));
      evidence->talk_ratio = ratio(scoreOf(sphinx->find(first_garbage_grammar + 1)));
    }
    evidence->phone_ratio = ratio(scoreOf(sphinx->findPhones()));
    evidence->word_score = wordScoreOf(hypothesis);
  }

  /// Accepts a candidate or says why not.
  void judge(const Command& candidate, double threshold, Recognition* recognition) const
  {
    const double speech_s = recognition->evidence.speech_s;
    const double most_s = LEAST_COMMAND_S + MORE_PER_WORD_S * recognition->evidence.words;
    if (options.mode == RecognitionMode::CLOSED)
    {
      recognition->accepted = true;
    }
    else if (speech_s > most_s)
    {
      recognition->reason = "too long for it: " + number(speech_s) + " s of speech, " + number(most_s) + " s at most";
    }
    else if (recognition->confidence >= threshold)
    {
      recognition->accepted = true;
    }
    else
    {
      recognition->reason = faint(recognition->confidence, threshold);
      // One that is heard in the stream has been doubtful there.
      recognition->doubtful = candidate.doubt > 0.0 && recognition->confidence >= candidate.doubt &&
                              !network.hearsInStream(static_cast<size_t>(&candidate - table.commands.data()));
    }
  }

  const RecognizerOptions options;
  const CommandTable table;
  NetworkCommands network;
  EndPointer end_pointer;
  std::unique_ptr<SphinxDecoder> sphinx;  ///< its first grammar has all commands
  size_t first_command_grammar = 0;       ///< then each command has one; 0: none
  size_t first_garbage_grammar = 0;       ///< garbage words, then talk; 0: none
  std::optional<ConfidenceModel> confidence;
  Runner runner = [](double, const std::function<void()>& work) { work(); };
  Elsewhere elsewhere;
  UtteranceSink utterance_sink;
  const Sink* sink = nullptr;  ///< of the call of process() or flush() in progress
  // Of the utterance in progress.
  std::optional<Recognition> early;  ///< at the last pause
  int64_t early_end = 0;             ///< where the speech ended then
  bool told_fast = false;
  Recognition fast;
  // Of the network in the stream.
  std::optional<Recognition> held;  ///< waits for the answer of other computers
  Recognition told;                 ///< the last word
  std::string told_text;            ///< the last accepted command of both
  int64_t told_end = NEVER;         ///< where it ended
};

CommandRecognizer::CommandRecognizer(const RecognizerOptions& options, const CommandTable& table)
  : impl_(std::make_unique<Impl>(options, table))
{
}

CommandRecognizer::~CommandRecognizer() = default;

const CommandTable& CommandRecognizer::table() const
{
  return impl_->table;
}

std::vector<std::string> CommandRecognizer::spottedCommands() const
{
  std::vector<std::string> texts;
  for (const size_t command : impl_->network.inStream())
  {
    texts.push_back(impl_->table.commands[command].text);
  }
  return texts;
}

std::vector<std::string> CommandRecognizer::guessedWords() const
{
  return impl_->sphinx ? impl_->sphinx->guesses() : std::vector<std::string>();
}

void CommandRecognizer::process(const int16_t* samples, size_t count, const Sink& sink)
{
  impl_->sink = &sink;
  impl_->process(samples, count);
  impl_->sink = nullptr;
}

void CommandRecognizer::flush(const Sink& sink)
{
  impl_->sink = &sink;
  impl_->flush();
  impl_->sink = nullptr;
}

void CommandRecognizer::reset()
{
  impl_->reset();
}

void CommandRecognizer::setRunner(Runner runner)
{
  impl_->runner = runner ? std::move(runner) : [](double, const std::function<void()>& work) { work(); };
}

void CommandRecognizer::setUtteranceSink(UtteranceSink sink)
{
  impl_->utterance_sink = std::move(sink);
}

void CommandRecognizer::setElsewhere(Elsewhere elsewhere)
{
  impl_->elsewhere = std::move(elsewhere);
}

bool CommandRecognizer::inSpeech() const
{
  return impl_->end_pointer.inSpeech();
}

double CommandRecognizer::noiseLevelDbfs() const
{
  return impl_->end_pointer.noiseLevelDbfs();
}

Recognition CommandRecognizer::recognize(const int16_t* samples, size_t count)
{
  return recognize(samples, count, seconds(static_cast<int64_t>(count)));
}

Recognition CommandRecognizer::recognize(const int16_t* samples, size_t count, double speech_s)
{
  Recognition recognition = impl_->recognize(samples, count, speech_s);
  recognition.speech_end = static_cast<int64_t>(count);
  recognition.decided_at = static_cast<int64_t>(count);
  return recognition;
}

}  // namespace pi_speech
