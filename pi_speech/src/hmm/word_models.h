#pragma once

#include "hmm/diagonal_mixtures.h"

#include <string>
#include <vector>

namespace pi_speech
{

/// Hidden Markov models of whole words with Gaussian mixtures, one for other speech (the filler: states in any order)
/// and one for the background.
///
/// A word is a sequence of states from left to right; each is passed, repeated or skipped. Background surrounds it.
/// Scores are ln p(utterance | model) by the forward algorithm (Rabiner 1989), brought to the scale of posteriors by
/// `scale` and the biases, which are trained together with the mixtures for the share of right answers (maximum mutual
/// information, Bahl et al. 1986).
struct WordModels
{
  std::vector<std::string> words;  ///< in lower case
  int states_per_word = 0;
  DiagonalMixtures word_mixtures;  ///< states_per_word states of the first word, then of the second, ...
  DiagonalMixtures filler;
  DiagonalMixtures background;     ///< one state
  float scale = 1.0F;              ///< of scores
  std::vector<float> word_biases;  ///< one per word
  float filler_bias = 0.0F;
  float background_bias = 0.0F;

  /// @return number of the word, or -1.
  int find(const std::string& word) const;

  /// @throws std::invalid_argument naming what is wrong.
  void validate() const;

  /// Reads the file that save() writes.
  /// @throws std::runtime_error naming the file and what is wrong: missing, not of this kind, truncated, damaged.
  static WordModels load(const std::string& path);
  /// Writes a binary file, little endian, with a check sum. The file appears when it is complete.
  /// @throws std::runtime_error naming the file and the reason.
  void save(const std::string& path) const;
};

/// A sequence of words by their numbers.
using WordSequence = std::vector<int>;

/// Scores utterances. Const methods are thread safe.
class WordScorer
{
public:
  explicit WordScorer(const WordModels& models);

  const std::vector<std::string>& words() const { return models_.words; }
  int find(const std::string& word) const { return models_.find(word); }

  /// Posterior logits of an utterance; -infinity where a model has more states than can be passed in these frames.
  struct Scores
  {
    std::vector<float> sequences;
    float filler = 0.0F;
    float background = 0.0F;
  };
  Scores score(const FeatureMatrix& features, const std::vector<WordSequence>& sequences) const;

private:
  WordModels models_;
  MixtureScorer word_scorer_;
  MixtureScorer filler_scorer_;
  MixtureScorer background_scorer_;
};

}  // namespace pi_speech
