#pragma once

#include <pi_speech/audio.h>
#include <pi_speech/filter_bank.h>
#include "network/word_network.h"
#include "network/word_peaks.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace pi_speech
{

/// Hears words in running sound with a WordNetwork: no pause is needed, before or after a word. Allocates nothing after
/// the constructor. Not thread safe.
class WordSpotter
{
public:
  struct Spotted
  {
    size_t word = 0;          ///< in the order of the constructor's list
    double confidence = 0.0;  ///< mean probability
    int64_t begin = 0;        ///< about where the word began [samples since the beginning of the stream]
    int64_t end = 0;          ///< about where it ended
    bool doubtful = false;    ///< the threshold was not reached, but the word's doubt
  };
  using Sink = std::function<void(const Spotted& spotted)>;

  /// @throws std::invalid_argument if the network does not know a word.
  WordSpotter(std::shared_ptr<const WordNetwork> network, const std::vector<SpottedWord>& words);

  void process(const int16_t* samples, size_t count, const Sink& sink);
  /// Forgets the sound before, because another piece begins. A word that waits for its peak is told.
  /// @param next_sample  number of the first sample that comes.
  void restart(int64_t next_sample, const Sink& sink);

  /// The word that fits best since the restart, heard or not. Its probability is 0 before the first decision.
  const WordPeaks::Peak& best() const { return peaks_.best(); }

private:
  Spotted place(const WordPeaks::Peak& peak) const;
  void tell(const std::optional<WordPeaks::Peak>& peak, const std::optional<WordPeaks::Peak>& doubt, const Sink& sink);

  WordNetworkStream network_;
  FilterBank bank_;
  std::vector<int16_t> frame_;  ///< the samples of the next frame that have come
  int64_t begin_ = 0;           ///< of the sound that it remembers [samples]
  int64_t seen_ = 0;            ///< [samples]
  const std::vector<SpottedWord> words_;
  WordPeaks peaks_;
  std::vector<size_t> doubtful_words_;  ///< of words_: those that may be doubtful
  WordPeaks doubts_;                    ///< of these: the same with doubts as thresholds
};

}  // namespace pi_speech
