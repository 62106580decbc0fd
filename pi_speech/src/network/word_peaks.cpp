#include "network/word_peaks.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace pi_speech
{

namespace
{

/// A word that has reached its threshold is told at its peak, or after so many steps.
constexpr int MOST_WAIT = 6;
/// Two words cannot end within so many steps: the second answer is to the same sound.
constexpr int LEAST_BETWEEN_WORDS = 12;
/// Share of the threshold below which a word is over.
constexpr double OVER = 0.5;
/// Probability of one step from which a word may have ended.
constexpr float RISEN = 0.5F;

}  // namespace

WordPeaks::WordPeaks(std::vector<SpottedWord> words, std::vector<Eigen::Index> outputs)
  : words_(std::move(words)), outputs_(std::move(outputs)), states_(words_.size())
{
}

void WordPeaks::follow(size_t word, float probability)
{
  State& state = states_[word];
  state.last[oldest_] = probability;
  state.mean = std::accumulate(state.last.begin(), state.last.end(), 0.0) / MEAN_STEPS;
  state.risen += state.risen > 0 || probability > RISEN ? 1 : 0;
  if (state.mean > best_.probability)
  {
    best_ = {word, state.mean, state.risen};
  }
  const double threshold = words_[word].threshold;
  if (state.mean < OVER * threshold)
  {
    state.peak = 0.0;
    state.waited = 0;
    state.risen = probability > RISEN ? state.risen : 0;
    state.heard = false;
  }
  else if (state.mean >= threshold || state.waited > 0)
  {
    state.peak = std::max(state.peak, state.mean);
    ++state.waited;
  }
}

std::optional<WordPeaks::Peak> WordPeaks::add(const Eigen::VectorXf& probabilities)
{
  const size_t none = words_.size();
  size_t due = none;
  size_t highest = none;
  for (size_t w = 0; w < words_.size(); ++w)
  {
    const double before = states_[w].mean;
    follow(w, probabilities[outputs_[w]]);
    const State& state = states_[w];
    if (state.heard || state.waited == 0)
    {
      continue;
    }
    highest = highest == none || state.peak > states_[highest].peak ? w : highest;
    if (words_[w].fast || state.mean < before || state.waited > MOST_WAIT)
    {
      due = due == none || words_[w].fast ? w : due;
    }
  }
  oldest_ = (oldest_ + 1) % MEAN_STEPS;
  const bool only_fast = steps_left_ > 0;
  steps_left_ -= only_fast ? 1 : 0;
  if (due == none)
  {
    return std::nullopt;
  }
  const size_t chosen = words_[due].fast ? due : highest;
  for (State& state : states_)
  {
    state.heard = state.heard || state.waited > 0;
  }
  if (only_fast && !words_[chosen].fast)
  {
    return std::nullopt;
  }
  steps_left_ = LEAST_BETWEEN_WORDS;
  return Peak{chosen, states_[chosen].peak, states_[chosen].risen};
}

std::optional<WordPeaks::Peak> WordPeaks::finish()
{
  std::optional<Peak> last;
  for (size_t w = 0; w < words_.size(); ++w)
  {
    const State& state = states_[w];
    if (!state.heard && state.waited > 0 && (!last || state.peak > last->probability))
    {
      last = Peak{w, state.peak, state.risen};
    }
  }
  std::fill(states_.begin(), states_.end(), State());
  steps_left_ = 0;
  best_ = Peak();
  return last;
}

}  // namespace pi_speech
