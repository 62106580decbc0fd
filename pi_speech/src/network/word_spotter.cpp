#include "network/word_spotter.h"

#include <algorithm>
#include <stdexcept>

namespace pi_speech
{

namespace
{

constexpr int64_t STEP = static_cast<int64_t>(WordNetworkStream::FRAMES_PER_STEP) * HOP_SAMPLES;
/// The length of a usual word, as the network tells only where words end. [samples]
constexpr int64_t WORD = SAMPLE_RATE_HZ * 2 / 5;

std::vector<Eigen::Index> outputsOf(const WordNetwork& network, const std::vector<SpottedWord>& words)
{
  std::vector<Eigen::Index> outputs;
  for (const SpottedWord& word : words)
  {
    outputs.push_back(network.find(word.word));
    if (outputs.back() < 0)
    {
      throw std::invalid_argument("the word network does not know \"" + word.word + "\"");
    }
  }
  return outputs;
}

std::vector<size_t> doubtfulOf(const std::vector<SpottedWord>& words)
{
  std::vector<size_t> doubtful;
  for (size_t w = 0; w < words.size(); ++w)
  {
    if (words[w].doubt > 0.0)
    {
      doubtful.push_back(w);
    }
  }
  return doubtful;
}

/// They wait for their peak: only then it is certain that the threshold is not reached.
std::vector<SpottedWord> doubtsOf(const std::vector<SpottedWord>& words)
{
  std::vector<SpottedWord> doubts;
  for (const size_t w : doubtfulOf(words))
  {
    doubts.push_back({words[w].word, words[w].doubt});
  }
  return doubts;
}

}  // namespace

WordSpotter::WordSpotter(std::shared_ptr<const WordNetwork> network, const std::vector<SpottedWord>& words)
  : network_(std::move(network))
  , words_(words)
  , peaks_(words, outputsOf(network_.network(), words))
  , doubtful_words_(doubtfulOf(words))
  , doubts_(doubtsOf(words), outputsOf(network_.network(), doubtsOf(words)))
{
  frame_.reserve(FRAME_SAMPLES);
}

void WordSpotter::process(const int16_t* samples, size_t count, const Sink& sink)
{
  while (count > 0)
  {
    const size_t taken = std::min(count, static_cast<size_t>(FRAME_SAMPLES) - frame_.size());
    frame_.insert(frame_.end(), samples, samples + taken);
    samples += taken;
    count -= taken;
    seen_ += static_cast<int64_t>(taken);
    if (frame_.size() < static_cast<size_t>(FRAME_SAMPLES))
    {
      return;
    }
    if (network_.add(bank_.energies(frame_.data())))
    {
      const std::optional<WordPeaks::Peak> peak = peaks_.add(network_.probabilities());
      tell(peak, doubts_.add(network_.probabilities()), sink);
    }
    frame_.erase(frame_.begin(), frame_.begin() + HOP_SAMPLES);
  }
}

void WordSpotter::restart(int64_t next_sample, const Sink& sink)
{
  const std::optional<WordPeaks::Peak> peak = peaks_.finish();
  tell(peak, doubts_.finish(), sink);
  network_.reset();
  frame_.clear();
  begin_ = next_sample;
  seen_ = next_sample;
}

void WordSpotter::tell(const std::optional<WordPeaks::Peak>& peak, const std::optional<WordPeaks::Peak>& doubt,
                       const Sink& sink)
{
  if (peak)
  {
    sink(place(*peak));
  }
  if (doubt && doubt->probability < words_[doubtful_words_[doubt->word]].threshold)
  {
    Spotted spotted = place(*doubt);
    spotted.word = doubtful_words_[doubt->word];
    spotted.doubtful = true;
    sink(spotted);
  }
}

WordSpotter::Spotted WordSpotter::place(const WordPeaks::Peak& peak) const
{
  const int64_t end = std::max(begin_, seen_ - peak.age_steps * STEP);
  return {peak.word, peak.probability, std::max(begin_, end - WORD), end, false};
}

}  // namespace pi_speech
