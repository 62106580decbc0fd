#pragma once

#include <pi_speech/audio.h>

#include <memory>
#include <string>
#include <vector>

namespace pi_speech
{

/// Files of an acoustic model of PocketSphinx.
struct SphinxModel
{
  std::string acoustic_model = "/usr/share/pocketsphinx/model/en-us/en-us";  ///< folder
  std::string dictionary = "/usr/share/pocketsphinx/model/en-us/cmudict-en-us.dict";
  std::string language_model = "/usr/share/pocketsphinx/model/en-us/en-us.lm.bin";  ///< of dictation
  /// Folder with what replaces parts of the acoustic model after training with other speakers or microphones: `means`,
  /// `sendump`, and `pronunciations.dict` with more pronunciations. Empty: none.
  std::string adaptation;
  bool guess_words = true;  ///< pronounce words that the dictionary lacks by rules
  bool check_model = true;  ///< load in a child process first: PocketSphinx ends the process on some damaged files
};

/// What was understood.
struct SphinxHypothesis
{
  struct Word
  {
    std::string text;  ///< without the number of its pronunciation
    int first_frame;   ///< of 10 ms
    int last_frame;
    double score;  ///< acoustic log-likelihood, the sum over its frames (natural logarithm)
  };
  std::vector<Word> words;  ///< without silences and fillers
  int frames = 0;           ///< of the utterance
  double score = 0.0;       ///< acoustic log-likelihood of the utterance per frame (natural logarithm)
  std::string text() const;
};

/// PocketSphinx (GMM/HMM, Viterbi) with the whole utterance at once, so that the cepstral mean is that of the whole
/// utterance: 8 of 100 commands more are right than in a stream. Not thread safe.
class SphinxDecoder
{
public:
  /// @param jsgf   grammar; empty: dictation with the language model.
  /// @param words  those of the grammar; for dictation it is not used.
  /// @throws std::runtime_error naming the file or word, and the way out.
  SphinxDecoder(const SphinxModel& model, const std::string& jsgf, const std::vector<std::string>& words);
  ~SphinxDecoder();
  SphinxDecoder(const SphinxDecoder&) = delete;
  SphinxDecoder& operator=(const SphinxDecoder&) = delete;

  /// An utterance too short to decode (less than 0.12 s) gives no words.
  /// @throws std::invalid_argument if it is longer than 300 s.
  SphinxHypothesis decode(const int16_t* samples, size_t count);
  SphinxHypothesis decode(const Samples& samples) { return decode(samples.data(), samples.size()); }

  /// Mean acoustic log-likelihood per frame (natural logarithm) of the best sequence of phones, whatever the words
  /// (context-independent phones): what a hypothesis' own score is compared with. Takes as long as decode().
  /// @param first_frame, last_frame  the part of the utterance, such as a word of the hypothesis; a last_frame of -1 is
  ///   the end. Phones that are partly inside count in proportion.
  /// @return 0 for an utterance too short to decode, or without a frame in that part.
  double phoneLoopScore(const int16_t* samples, size_t count, int first_frame = 0, int last_frame = -1);

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_speech
