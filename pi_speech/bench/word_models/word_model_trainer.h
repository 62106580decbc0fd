#pragma once

#include "hmm/word_models.h"

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace pi_speech
{

/// An utterance with what was said.
struct TrainingExample
{
  FeatureMatrix features;
  int label = 0;  ///< number of the word; the number of words: other speech; one more: background
};

struct TrainerOptions
{
  int states_per_word = 10;
  int components = 4;  ///< of a word's state; a power of 2, as the next two
  int filler_states = 32;
  int filler_components = 4;
  int background_components = 8;
  int likelihood_passes = 3;  ///< of expectation maximisation per doubling of the components
  int epochs = 12;            ///< of training for right answers
  double rate = 0.01;         ///< of Adam, at its largest; for the means, in standard deviations
  double other_weight = 1.5;  ///< of examples of other speech
  int batch = 64;
  int threads = 2;
  uint32_t seed = 1;

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Called after each pass with its name, number and the mean loss or -log-likelihood per frame.
using TrainingProgress = std::function<void(const std::string& stage, int pass, double loss)>;

/// Models of the greatest likelihood (Baum-Welch; components are doubled by splitting). Scale and biases are set to a
/// tenth and zero.
/// @throws std::invalid_argument if a word has no example, or there is none of other speech or of the background.
WordModels trainLikelihood(const std::vector<std::string>& words, const std::vector<TrainingExample>& examples,
                           const TrainerOptions& options, const TrainingProgress& progress);

/// Trains all parameters on for the posterior of the right answer: gradient steps of Adam (Kingma and Ba 2015) on the
/// cross entropy.
void trainPosterior(WordModels* models, const std::vector<TrainingExample>& examples, const TrainerOptions& options,
                    const TrainingProgress& progress);

/// Posteriors of the words, other speech and background.
std::vector<float> classPosteriors(const WordScorer::Scores& scores);

}  // namespace pi_speech
