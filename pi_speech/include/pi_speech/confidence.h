#pragma once

#include <string>
#include <vector>

namespace pi_speech
{

/// Evidence for a candidate command, from which its confidence is computed. Logarithms are natural.
struct Evidence
{
  std::string command;       ///< the candidate's text
  double word_margin = 0.0;  ///< ln of the candidate's posterior over that of all other commands
  // PocketSphinx's ln likelihoods of the whole utterance: the candidate's less that of another hypothesis, per frame of
  // the candidate's words.
  double garbage_ratio = 0.0;  ///< the best garbage word
  double talk_ratio = 0.0;     ///< the best one or two of the most frequent garbage words
  double phone_ratio = 0.0;    ///< the best phones
  double word_score = 0.0;     ///< ln likelihood of its words per frame less that of the best states, at most 0
  double speech_s = 0.0;       ///< length of the speech
  int words = 1;               ///< of the candidate
};

/// Logistic model of the confidence.
class ConfidenceModel
{
public:
  /// Names of the features, in order, as in the file.
  static const std::vector<std::string>& featureNames();
  static std::vector<double> features(const Evidence& evidence);

  /// Reads
  /// @code{.yaml}
  /// {bias: -1.0, word_margin: 0.3, ...}
  /// @endcode
  /// @throws std::runtime_error naming the file and what is wrong: missing, no YAML, a weight missing or unknown.
  static ConfidenceModel load(const std::string& path);

  /// In (0, 1).
  double confidence(const Evidence& evidence) const;

private:
  double bias_ = 0.0;
  std::vector<double> weights_;  ///< in the order of featureNames()
};

}  // namespace pi_speech
