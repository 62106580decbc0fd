#pragma once

#include <pi_speech/audio.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace pi_speech
{

/// Power of a clip's speech, independent of pauses: the mean square of the loudest 30 % of its pieces of 50 ms, at
/// least one piece. 0 for an empty clip.
double activePower(const Samples& samples);

/// Endless noise, equal for equal seeds. Not thread safe.
class NoiseSource
{
public:
  /// @param name  "white", "pink" (equal power in each octave), "wind" (below 300 Hz, in gusts), or a sound file,
  ///   which is looped from a place that the seed chooses.
  /// @throws std::runtime_error naming the file and what is wrong: missing, no sound, silent.
  NoiseSource(const std::string& name, uint32_t seed);
  /// True for the names that are no files.
  static bool isMade(const std::string& name) { return name == "white" || name == "pink" || name == "wind"; }

  /// The next samples. Their level is arbitrary.
  std::vector<float> next(size_t count);
  /// Samples of a looped file; 0: noise that is made.
  size_t period() const { return period_; }

private:
  std::function<float()> sample_;
  size_t period_ = 0;
};

}  // namespace pi_speech
