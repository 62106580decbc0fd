#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

namespace pi_speech
{

/// A word to be heard in the stream.
struct SpottedWord
{
  std::string word;
  double threshold = 0.5;  ///< least mean probability, in (0, 1]
  bool fast = false;       ///< told when the threshold is reached; others wait for their peak: another may fit better
  double doubt = 0.0;      ///< mean probability, below the threshold, from which it is doubtful; 0: never
};

/// Decides which words are heard from their probabilities in steps of 20 ms: those whose mean over 0.1 s has a peak
/// above their threshold. A word is heard again after its mean has fallen below half of the threshold. Not thread safe.
class WordPeaks
{
public:
  static constexpr int MEAN_STEPS = 5;

  struct Peak
  {
    size_t word = 0;           ///< number in the list of words
    double probability = 0.0;  ///< mean
    int age_steps = 0;         ///< since the probability of the word has risen, which is about where it ends
  };

  /// @param words    to be heard. @param outputs  of the network, one for each word.
  WordPeaks(std::vector<SpottedWord> words, std::vector<Eigen::Index> outputs);

  /// @param probabilities  of all outputs at the next step. @return the word that is heard now.
  std::optional<Peak> add(const Eigen::VectorXf& probabilities);
  /// @return the word that waits for its peak, as no more sound comes; then forgets all.
  std::optional<Peak> finish();

  /// The highest mean since the beginning, heard or not. Its probability is 0 before the first step.
  const Peak& best() const { return best_; }

private:
  struct State
  {
    std::array<float, MEAN_STEPS> last{};  ///< a ring
    double mean = 0.0;
    double peak = 0.0;   ///< of the mean, since the threshold was reached
    int waited = 0;      ///< steps since then; 0: it was not
    int risen = 0;       ///< steps since the probability was high first; 0: it was not
    bool heard = false;  ///< has been told, or another word in its place, and the mean has not fallen since
  };
  void follow(size_t word, float probability);

  const std::vector<SpottedWord> words_;
  const std::vector<Eigen::Index> outputs_;
  std::vector<State> states_;
  size_t oldest_ = 0;   ///< in the rings
  int steps_left_ = 0;  ///< in which only fast words are told
  Peak best_;
};

}  // namespace pi_speech
