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

/// How strictly utterances are rejected.
enum class RecognitionMode
{
  SAFE,    ///< other words and noises are rejected; for vehicles
  CLOSED,  ///< every utterance is taken for the command that fits best
};
const char* toString(RecognitionMode mode);

struct RecognizerOptions
{
  RecognitionMode mode = RecognitionMode::SAFE;
  double threshold = 0.5;  ///< least confidence of a command that has none of its own, in (0, 1)
  /// Confidence above which every command is reported after end_pointer/early_silence_s, like fast commands, unless
  /// another command begins with it. In (0, 1]; 1: never.
  double sure_confidence = 0.8;
  double max_command_s = 2.5;  ///< of speech; longer speech is talk, no command. For mode SAFE
  EndPointerOptions end_pointer;
  SphinxModel sphinx;
  /// File of a WordNetwork. It hears its words of the table in running speech; empty: none, PocketSphinx decides alone.
  std::string word_network;
  /// All words of the network are heard inside sentences, not only those of fast commands. The others need a pause.
  bool all_in_running_speech = false;
  std::string garbage_words;  ///< list of words that stand for other speech
  std::string confidence;     ///< file of ConfidenceModel

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
  /// Its own, or that of all.
  double thresholdOf(const Command& command) const;
  /// The same where the word network hears it.
  double networkThresholdOf(const Command& command) const;
};

/// Result for an utterance.
struct Recognition
{
  std::string text;  ///< the command that fits best, as in the table; empty: none
  bool accepted = false;
  bool doubtful = false;     ///< not accepted, but its confidence is not below the command's doubt: ask, or be careful
  std::string reason;        ///< why it was rejected: "other speech", "confidence 0.31 below 0.5", "too long", ...
  double confidence = 0.0;   ///< that this command was said, in [0, 1]
  bool fast = false;         ///< reported before the pause that ends an utterance
  int64_t speech_begin = 0;  ///< samples since the stream's beginning
  int64_t speech_end = 0;
  int64_t decided_at = 0;  ///< samples of the stream that had come at the decision
  double snr_db = 0.0;
  double work_s = 0.0;  ///< time of the decision, here or elsewhere
  std::string place;    ///< where the decision was made; empty: here
  Evidence evidence;    ///< for the command; undefined without one
};

/// Recognises spoken commands in a stream of sound. Commands of one word that the word network knows are decided
/// by it: fast ones wherever they are said, others at a pause. For all others it finds utterances, decodes each with
/// PocketSphinx, and computes a confidence. Not thread safe.
class CommandRecognizer
{
public:
  /// Loads the models. @throws std::runtime_error, std::invalid_argument naming what is wrong and the way out.
  CommandRecognizer(const RecognizerOptions& options, const CommandTable& table);
  ~CommandRecognizer();
  CommandRecognizer(const CommandRecognizer&) = delete;
  CommandRecognizer& operator=(const CommandRecognizer&) = delete;

  const CommandTable& table() const;
  /// Commands that the word network hears in running speech.
  std::vector<std::string> spottedCommands() const;
  /// Words that no dictionary has, with the phones that the rules made of them: "zorble Z AO R B AH L".
  std::vector<std::string> guessedWords() const;

  /// Called for each utterance that has ended, and for fast and doubtful commands, on the thread of process().
  using Sink = std::function<void(const Recognition& recognition)>;
  /// @param samples  the next of the stream. At the end of an utterance PocketSphinx takes about 70 ms per second of
  ///   speech; the word network takes 10 ms per second of sound.
  void process(const int16_t* samples, size_t count, const Sink& sink);
  /// Ends an utterance in progress, because the stream ends or has a gap.
  void flush(const Sink& sink);
  /// Forgets the noise, because another stream begins.
  void reset();
  /// Called with the sound of each utterance that has ended, after its Recognition was reported.
  using UtteranceSink = std::function<void(const Utterance& utterance, const Recognition& recognition)>;
  void setUtteranceSink(UtteranceSink sink);
  /// Runs each decision, for example on a scheduler: must call `work` on any thread before it returns.
  /// @param speech_s  length of the speech [s].
  using Runner = std::function<void(double speech_s, const std::function<void()>& work)>;
  void setRunner(Runner runner);
  /// Asked before each decision, within process() and flush(). Returns the decision of another computer (text,
  /// accepted, confidence, reason), or nothing to decide here. A text that is no command of the table counts as empty.
  using Elsewhere = std::function<std::optional<Recognition>(const Utterance& utterance)>;
  void setElsewhere(Elsewhere elsewhere);
  bool inSpeech() const;
  double noiseLevelDbfs() const;

  /// Recognises one utterance, without end-pointing: speech with some sound before and after it.
  /// @param speech_s  length of the speech in it [s].
  Recognition recognize(const int16_t* samples, size_t count, double speech_s);
  /// All of it is speech.
  Recognition recognize(const int16_t* samples, size_t count);

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_speech
