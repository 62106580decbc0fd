#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// Texts to sound, by espeak-ng. That library has one state per process: there may be one synthesizer, and nothing else
/// in the process may use espeak-ng. Not thread safe.
class SpeechSynthesizer
{
public:
  /// @param voice  as espeak-ng names them, as "en-us". @param words_per_minute  in [80, 450].
  /// @throws std::runtime_error naming what is missing and the package that has it.
  SpeechSynthesizer(const std::string& voice, int words_per_minute);

  /// [Hz]
  int sampleRate() const { return sample_rate_; }
  /// One channel. @param text  UTF-8; empty, or with nothing to say in it: no samples.
  std::vector<int16_t> speak(const std::string& text) const;

private:
  int sample_rate_ = 0;
  void* synthesize_ = nullptr;
};

/// Two tones as a car's horn has them.
std::vector<int16_t> hornSound(int sample_rate, double duration_s);

}  // namespace pi_vehicle
