#pragma once

#include <pi_speech/audio.h>
#include <pi_speech/noise_mixing.h>

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <string>
#include <vector>

namespace pi_simulation
{

struct MicrophoneMixerOptions
{
  double noise_level_dbfs = -62.0;       ///< of pink noise [dB of full scale], in [-120, 0]
  int seed = 1;                          ///< of the noise, at least 0
  std::string background;                ///< of pi_speech::NoiseSource: a noise or a file; empty: none
  double background_level_dbfs = -50.0;  ///< mean level of the background, in [-120, 0]
  double play_gain_db = 0.0;             ///< of sounds that are played, in [-60, 20]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Place of a played sound in the stream, as sample numbers since the start.
struct SoundPlace
{
  int64_t begin = 0;       ///< first sample
  int64_t speech_end = 0;  ///< behind the last one of speech
  int64_t end = 0;         ///< behind the last one
};

/// An endless stream of sound at SAMPLE_RATE_HZ in one channel: noise, a background, and played sounds. Overlapping
/// sounds add up; samples beyond full scale are clipped. Not thread safe.
class MicrophoneMixer
{
public:
  /// @throws std::invalid_argument for wrong options, std::runtime_error naming a background that cannot be used.
  explicit MicrophoneMixer(const MicrophoneMixerOptions& options);

  /// Mixes in a sound, starting at the next sample.
  SoundPlace play(pi_speech::Samples samples);
  /// The next samples of the stream.
  pi_speech::Samples next(size_t count);
  int64_t position() const { return position_; }  ///< number of samples given so far

private:
  struct Playing
  {
    pi_speech::Samples samples;
    size_t at = 0;
  };

  pi_speech::NoiseSource noise_;
  double noise_gain_ = 0.0;
  std::unique_ptr<pi_speech::NoiseSource> background_;  ///< null: none
  double background_gain_ = 0.0;
  const double play_gain_;
  std::list<Playing> playing_;
  int64_t position_ = 0;
};

}  // namespace pi_simulation
