#pragma once

#include <map>
#include <string>
#include <vector>

namespace pi_speech
{

/// Evidence for a candidate command, from which its confidence is computed. Logarithms are natural.
struct Evidence
{
  std::string command;  ///< the candidate's text
  bool has_word_models = false;
  double word_margin = 0.0;        ///< ln of the candidate's posterior over that of all other commands, of all models
  double filler_margin = 0.0;      ///< ln likelihood of the words' models over that of other speech; 0 without them
  double background_margin = 0.0;  ///< the same over background
  // PocketSphinx's ln likelihoods of the whole utterance: the candidate's less that of another hypothesis, per frame of
  // the candidate's words.
  double garbage_ratio = 0.0;  ///< the best garbage word
  double talk_ratio = 0.0;     ///< the best one or two of the most frequent garbage words
  double phone_ratio = 0.0;    ///< the best phones
  double word_score = 0.0;     ///< ln likelihood of its words per frame less that of the best states, at most 0
  double speech_s = 0.0;       ///< length of the speech
  int words = 1;               ///< of the candidate
};

/// Logistic model of the confidence, with one set of weights for use with word models and one for use without. With
/// word models each word has its own bias.
class ConfidenceModel
{
public:
  /// Names of the features, in order, as in the file.
  static const std::vector<std::string>& featureNames();
  static std::vector<double> features(const Evidence& evidence);

  /// Reads
  /// @code{.yaml}
  /// with_word_models: {bias: -1.0, word_margin: 0.3, ..., word_biases: {stop: 0.4, ...}}
  /// without_word_models: {bias: ...}
  /// @endcode
  /// @throws std::runtime_error naming the file and what is wrong: missing, no YAML, a weight missing or unknown.
  static ConfidenceModel load(const std::string& path);

  /// In (0, 1).
  double confidence(const Evidence& evidence) const;

private:
  struct Weights
  {
    double bias = 0.0;
    std::vector<double> features;               ///< in the order of featureNames()
    std::map<std::string, double> word_biases;  ///< words that are not there have 0
  };
  static Weights readWeights(const std::string& path, const std::string& name);

  Weights with_word_models_;
  Weights without_word_models_;
};

}  // namespace pi_speech
