#pragma once

#include <pi_speech/audio.h>
#include <pi_speech/command_table.h>
#include <pi_speech/confidence.h>
#include <pi_speech/end_pointer.h>
#include <pi_speech/sphinx_decoder.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace pi_speech
{

/// How much it takes to be a command.
enum class RecognitionMode
{
  SAFE,    ///< other words and noises are rejected: the vehicle's
  CLOSED,  ///< whatever is said is taken for the command that fits best
};
const char* toString(RecognitionMode mode);
/// @throws std::invalid_argument naming the value and the choices.
RecognitionMode parseRecognitionMode(const std::string& name);

struct RecognizerOptions
{
  RecognitionMode mode = RecognitionMode::SAFE;
  double threshold = 0.5;  ///< least confidence of a command that has none of its own, in (0, 1)
  /// Confidence at which any command is told after end_pointer/early_silence_s already, as fast ones are, unless
  /// another command begins with it; in (0, 1], 1: none is.
  double sure_confidence = 0.8;
  double max_command_s = 2.5;  ///< of speech; longer is talk, not a command. Counts in SAFE mode
  EndPointerOptions end_pointer;
  SphinxModel sphinx;
  std::string word_models;    ///< file of WordModels; empty: without. Used where it has all words of the table
  std::string garbage_words;  ///< list of words that stand for other speech
  std::string confidence;     ///< file of ConfidenceModel

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// What was made of an utterance.
struct Recognition
{
  std::string text;  ///< the command that fits best, as in the table; empty: none does
  bool accepted = false;
  std::string reason;        ///< why it was rejected: "other speech", "confidence 0.31 below 0.5", "too long", ...
  double confidence = 0.0;   ///< in [0, 1]: that this command was said, and nothing else
  bool fast = false;         ///< before the pause that ends an utterance
  int64_t speech_begin = 0;  ///< samples since the stream's beginning
  int64_t speech_end = 0;
  int64_t decided_at = 0;  ///< samples of the stream that had come when it was decided
  double snr_db = 0.0;
  double work_s = 0.0;  ///< that the decision took, here or elsewhere
  std::string place;    ///< where it was made; empty: here
  Evidence evidence;    ///< for the command; of no use where there is none
};

/// Spoken commands in a stream of sound: end-pointing, PocketSphinx with the whole utterance, models of whole words,
/// and a confidence from both. Not thread safe.
class CommandRecognizer
{
public:
  /// Loads the models. @throws std::runtime_error, std::invalid_argument naming what is wrong and the way out.
  CommandRecognizer(const RecognizerOptions& options, const CommandTable& table);
  ~CommandRecognizer();
  CommandRecognizer(const CommandRecognizer&) = delete;
  CommandRecognizer& operator=(const CommandRecognizer&) = delete;

  const CommandTable& table() const;
  /// Whether models of whole words take part.
  bool usesWordModels() const;

  /// Called for each utterance that has ended, and for fast commands, on the thread of process().
  using Sink = std::function<void(const Recognition& recognition)>;
  /// @param samples  the next of the stream. Takes long where an utterance ends: some 70 ms per second of speech.
  void process(const int16_t* samples, size_t count, const Sink& sink);
  /// The stream has ended or has a gap.
  void flush(const Sink& sink);
  /// Another stream begins: nothing is known of its noise.
  void reset();
  /// Called for each utterance that has ended, after its Recognition was told: with its sound.
  using UtteranceSink = std::function<void(const Utterance& utterance, const Recognition& recognition)>;
  void setUtteranceSink(UtteranceSink sink);
  /// Called around each decision with the length of the speech [s] and the work, which it has to call before it
  /// returns, on any thread: a scheduler's hook. Without it decisions are plain calls.
  using Runner = std::function<void(double speech_s, const std::function<void()>& work)>;
  void setRunner(Runner runner);
  /// Asked for each decision before it is made here, within process() and flush(): what another computer made of the
  /// utterance (text, accepted, confidence, reason), or nothing. A text that is no command of the table counts as none.
  using Elsewhere = std::function<std::optional<Recognition>(const Utterance& utterance)>;
  void setElsewhere(Elsewhere elsewhere);
  bool inSpeech() const;
  double noiseLevelDbfs() const;

  /// One utterance on its own, without end-pointing: speech with a little sound before and behind it.
  /// @param speech_s  length of the speech in it [s].
  Recognition recognize(const int16_t* samples, size_t count, double speech_s);
  /// All of it is speech.
  Recognition recognize(const int16_t* samples, size_t count);

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_speech
