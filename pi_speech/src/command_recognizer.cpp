#include <pi_runtime/option_check.h>
#include <pi_speech/command_recognizer.h>
#include <pi_speech/grammar.h>
#include <pi_speech/speech_features.h>
#include <pi_speech/word_models.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>

namespace pi_speech
{

namespace
{

/// How much more likely a command becomes, in natural logarithms, where PocketSphinx understood it.
constexpr double SPHINX_VOTE = 2.0;
/// Scores of the word models are brought to this scale for choosing a command and for the margins.
constexpr double WORD_SCALE = 0.5;
/// Words whose likelihood cannot be compared with that of the phones.
constexpr double NO_RATIO = -8.0;
/// A word of the garbage in a row, at most.
constexpr int MOST_GARBAGE_WORDS = 2;

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

/// ln likelihood per frame of the words, from the first to the last.
double meanScore(const SphinxHypothesis& hypothesis)
{
  double sum = 0.0;
  for (const SphinxHypothesis::Word& word : hypothesis.words)
  {
    sum += word.score;
  }
  return sum / (hypothesis.words.back().last_frame - hypothesis.words.front().first_frame + 1);
}

std::string number(double value)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
}

}  // namespace

const char* toString(RecognitionMode mode)
{
  return mode == RecognitionMode::SAFE ? "safe" : "closed";
}

RecognitionMode parseRecognitionMode(const std::string& name)
{
  for (const RecognitionMode mode : {RecognitionMode::SAFE, RecognitionMode::CLOSED})
  {
    if (name == toString(mode))
    {
      return mode;
    }
  }
  throw std::invalid_argument("mode = \"" + name + "\", must be safe or closed");
}

void RecognizerOptions::validate() const
{
  const pi_runtime::OptionCheck check("");
  check.range("threshold", threshold, 0.001, 0.999);
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

struct CommandRecognizer::Impl
{
  Impl(const RecognizerOptions& options_in, const CommandTable& table_in)
    : options(options_in)
    , table(table_in)
    , end_pointer((options_in.validate(), options_in.end_pointer),
                  [this](EndPointer::Event event, const Utterance& utterance) { onEvent(event, utterance); })
  {
    table.validate();
    std::vector<std::string> words = table.words();
    std::vector<std::string> garbage;
    if (options.mode == RecognitionMode::SAFE)
    {
      garbage = readGarbageWords(options.garbage_words);
      confidence = ConfidenceModel::load(options.confidence);
    }
    else if (!options.confidence.empty())
    {
      confidence = ConfidenceModel::load(options.confidence);
    }
    const std::string grammar = toJsgf(table, garbage, MOST_GARBAGE_WORDS);
    words.insert(words.end(), garbage.begin(), garbage.end());
    std::sort(words.begin(), words.end());
    words.erase(std::unique(words.begin(), words.end()), words.end());
    sphinx = std::make_unique<SphinxDecoder>(options.sphinx, grammar, words);
    loadWordModels();
  }

  /// They take part where they have all words of all commands.
  void loadWordModels()
  {
    if (options.word_models.empty())
    {
      return;
    }
    word_scorer.emplace(WordModels::load(options.word_models));
    for (const Command& command : table.commands)
    {
      WordSequence sequence;
      std::istringstream stream(command.text);
      for (std::string word; stream >> word;)
      {
        const int found = word_scorer->find(word);
        if (found < 0)
        {
          word_scorer.reset();
          sequences.clear();
          return;
        }
        sequence.push_back(found);
      }
      sequences.push_back(sequence);
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
        // Decided while it is not certain yet that the speech has ended: then the command comes without delay.
        early = decide(utterance);
        early_end = utterance.speech_end;
        tellFast(utterance);
        return;
      case EndPointer::Event::END:
        break;
    }
    const bool is_decided = early && early_end == utterance.speech_end && !utterance.cut;
    Recognition recognition = is_decided ? *early : decide(utterance);
    // What was told already is not told again; but another command that was heard after all is.
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

  void tellFast(const Utterance& utterance)
  {
    const auto command = find(early->text);
    if (!told_fast && early->accepted && command != table.commands.end() && command->fast)
    {
      told_fast = true;
      fast = *early;
      fast.fast = true;
      tell(&fast, utterance);
    }
  }

  void tell(Recognition* recognition, const Utterance& utterance)
  {
    recognition->speech_begin = utterance.speech_begin;
    recognition->speech_end = utterance.speech_end;
    recognition->decided_at = end_pointer.samplesSeen();
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
    return recognize(utterance.samples.data(), utterance.samples.size(), speech_s, utterance.snr_db);
  }

  Recognition recognize(const int16_t* samples, size_t count, double speech_s, double snr_db)
  {
    const auto start = std::chrono::steady_clock::now();
    Recognition recognition;
    recognition.snr_db = snr_db;
    runner(speech_s, [&] { choose(samples, count, speech_s, snr_db, &recognition); });
    recognition.work_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return recognition;
  }

  void choose(const int16_t* samples, size_t count, double speech_s, double snr_db, Recognition* recognition)
  {
    const SphinxHypothesis hypothesis = sphinx->decode(samples, count);
    const std::string understood = hypothesis.text();
    const auto sphinx_command = find(understood);
    Evidence& evidence = recognition->evidence;
    evidence.speech_s = speech_s;
    evidence.snr_db = snr_db;
    evidence.has_word_models = word_scorer.has_value();
    auto candidate = sphinx_command;
    if (word_scorer)
    {
      const WordScorer::Scores scores = word_scorer->score(features.compute(samples, count), sequences);
      std::vector<double> logits;
      for (const float score : scores.sequences)
      {
        logits.push_back(WORD_SCALE * static_cast<double>(score));
      }
      std::vector<double> votes = logits;
      if (sphinx_command != table.commands.end())
      {
        votes[static_cast<size_t>(sphinx_command - table.commands.begin())] += SPHINX_VOTE;
      }
      const auto best = static_cast<size_t>(std::max_element(votes.begin(), votes.end()) - votes.begin());
      if (std::isfinite(votes[best]))
      {
        candidate = table.commands.begin() + static_cast<std::ptrdiff_t>(best);
        evidence.word_margin = margin(logits[best], sumOfOthers(logits, best));
        evidence.filler_margin = margin(logits[best], WORD_SCALE * static_cast<double>(scores.filler));
        evidence.background_margin = margin(logits[best], WORD_SCALE * static_cast<double>(scores.background));
      }
    }
    if (candidate == table.commands.end())
    {
      recognition->reason = understood.empty() ? "no speech was understood" : "other speech";
      return;
    }
    recognition->text = candidate->text;
    evidence.command = candidate->text;
    evidence.words = static_cast<int>(1 + std::count(candidate->text.begin(), candidate->text.end(), ' '));
    evidence.sphinx_agrees = candidate == sphinx_command;
    evidence.sphinx_garbage = sphinx_command == table.commands.end() && !understood.empty();
    evidence.sphinx_nothing = understood.empty();
    evidence.phone_ratio = NO_RATIO;
    if (confidence && evidence.sphinx_agrees)
    {
      const int first = hypothesis.words.front().first_frame;
      const int last = hypothesis.words.back().last_frame;
      evidence.phone_ratio = meanScore(hypothesis) - sphinx->phoneLoopScore(samples, count, first, last);
    }
    if (confidence)
    {
      recognition->confidence = confidence->confidence(evidence);
    }
    else
    {
      recognition->confidence = 1.0;
    }
    if (options.mode == RecognitionMode::CLOSED)
    {
      recognition->accepted = true;
      return;
    }
    const double threshold = candidate->threshold > 0.0 ? candidate->threshold : options.threshold;
    recognition->accepted = recognition->confidence >= threshold;
    if (!recognition->accepted)
    {
      recognition->reason = "confidence " + number(recognition->confidence) + " below " + number(threshold);
    }
  }

  const RecognizerOptions options;
  const CommandTable table;
  EndPointer end_pointer;
  SpeechFeatures features;
  std::unique_ptr<SphinxDecoder> sphinx;
  std::optional<WordScorer> word_scorer;
  std::vector<WordSequence> sequences;  ///< of the commands
  std::optional<ConfidenceModel> confidence;
  Runner runner = [](double, const std::function<void()>& work) { work(); };
  UtteranceSink utterance_sink;
  const Sink* sink = nullptr;  ///< of the call of process() or flush() in progress
  // Of the utterance in progress.
  std::optional<Recognition> early;  ///< at the last pause
  int64_t early_end = 0;             ///< where the speech ended then
  bool told_fast = false;
  Recognition fast;
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

bool CommandRecognizer::usesWordModels() const
{
  return impl_->word_scorer.has_value();
}

void CommandRecognizer::process(const int16_t* samples, size_t count, const Sink& sink)
{
  impl_->sink = &sink;
  impl_->end_pointer.process(samples, count);
  impl_->sink = nullptr;
}

void CommandRecognizer::flush(const Sink& sink)
{
  impl_->sink = &sink;
  impl_->end_pointer.flush();
  impl_->sink = nullptr;
}

void CommandRecognizer::reset()
{
  impl_->end_pointer.reset();
}

void CommandRecognizer::setRunner(Runner runner)
{
  impl_->runner = runner ? std::move(runner) : [](double, const std::function<void()>& work) { work(); };
}

void CommandRecognizer::setUtteranceSink(UtteranceSink sink)
{
  impl_->utterance_sink = std::move(sink);
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
  Recognition recognition = impl_->recognize(samples, count, seconds(static_cast<int64_t>(count)), 0.0);
  recognition.speech_end = static_cast<int64_t>(count);
  recognition.decided_at = static_cast<int64_t>(count);
  return recognition;
}

}  // namespace pi_speech
