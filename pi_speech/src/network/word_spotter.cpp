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

}  // namespace

WordSpotter::WordSpotter(std::shared_ptr<const WordNetwork> network, const std::vector<SpottedWord>& words)
  : network_(std::move(network)), peaks_(words, outputsOf(network_.network(), words))
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
      if (const std::optional<WordPeaks::Peak> peak = peaks_.add(network_.probabilities()))
      {
        sink(place(*peak));
      }
    }
    frame_.erase(frame_.begin(), frame_.begin() + HOP_SAMPLES);
  }
}

void WordSpotter::restart(int64_t next_sample, const Sink& sink)
{
  if (const std::optional<WordPeaks::Peak> peak = peaks_.finish())
  {
    sink(place(*peak));
  }
  network_.reset();
  frame_.clear();
  begin_ = next_sample;
  seen_ = next_sample;
}

WordSpotter::Spotted WordSpotter::place(const WordPeaks::Peak& peak) const
{
  const int64_t end = std::max(begin_, seen_ - peak.age_steps * STEP);
  return {peak.word, peak.probability, std::max(begin_, end - WORD), end};
}

}  // namespace pi_speech
