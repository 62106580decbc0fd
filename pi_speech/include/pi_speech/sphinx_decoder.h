#pragma once

#include <pi_speech/audio.h>

#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace pi_speech
{

class SphinxEngine;

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
    double score;  ///< as the hypothesis' own, over its frames
  };
  std::vector<Word> words;  ///< without silences and fillers
  int frames = 0;           ///< of the utterance
  /// Acoustic log-likelihood of the utterance less that of the best state of any phone in each frame (natural
  /// logarithm, at most 0): it can be compared between grammars. -infinity if nothing fits.
  double score = -std::numeric_limits<double>::infinity();
  std::string text() const;
};

/// PocketSphinx (GMM/HMM, Viterbi) on whole utterances. The cepstral mean is then that of the whole utterance, which
/// gets 8 of 100 commands more right than decoding a stream. The likelihoods of all states are computed once per
/// utterance; each search through a grammar of some words then takes 1 ms. Not thread safe.
class SphinxDecoder
{
public:
  /// @param grammars  in JSGF; none: dictation with the language model.
  /// @param words     those of all grammars; for dictation they are not used.
  /// @throws std::runtime_error naming the file or word, and the way out.
  SphinxDecoder(const SphinxModel& model, const std::vector<std::string>& grammars,
                const std::vector<std::string>& words);
  ~SphinxDecoder();
  SphinxDecoder(const SphinxDecoder&) = delete;
  SphinxDecoder& operator=(const SphinxDecoder&) = delete;

  /// Words that the dictionary lacks, with what the rules made of them: "zorble Z AO R B AH L".
  const std::vector<std::string>& guesses() const { return guesses_; }

  /// Computes the likelihoods of an utterance, which take 1 MB per second, for find() and findPhones(). One too short
  /// (less than 0.12 s) fits nothing.
  /// @throws std::invalid_argument if it is longer than 300 s, std::runtime_error if there is no room for them.
  void listen(const int16_t* samples, size_t count);
  /// The best path through a grammar. @throws std::out_of_range
  SphinxHypothesis find(size_t grammar);
  /// The best sequence of phones, whatever the words (context-independent ones): what other scores are compared with.
  SphinxHypothesis findPhones();

  /// listen() and find() in the first grammar; or dictation, whose scores are not comparable.
  SphinxHypothesis decode(const int16_t* samples, size_t count);
  SphinxHypothesis decode(const Samples& samples) { return decode(samples.data(), samples.size()); }

private:
  std::vector<std::string> guesses_;
  std::unique_ptr<SphinxEngine> engine_;
};

}  // namespace pi_speech
