#pragma once

#include <pi_speech/audio.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace pi_speech
{

/// Mean square of the loudest 30 % of a clip's pieces of 50 ms, at least one piece: that of its speech, whatever the
/// pauses around it. A clip shorter than one piece is one piece; 0 for one without samples.
double activePower(const Samples& samples);

/// Noise without end, the same for the same seed. Not thread safe.
class NoiseSource
{
public:
  /// @param name  "white", "pink" (equal power in each octave), or a sound file, looped, from a place that the seed
  ///   chooses.
  /// @throws std::runtime_error naming the file and what is wrong: missing, no sound, silent.
  NoiseSource(const std::string& name, uint32_t seed);

  /// The next of the stream. Its level is of no meaning: see mixNoise().
  std::vector<float> next(size_t count);

private:
  std::function<float()> sample_;
};

/// The clip and noise behind it, with the power of the clip's speech (activePower()) snr_db above the mean power of the
/// noise over the clip. Where the sum would exceed full scale all of it is made quieter, so that nothing is clipped. A
/// silent clip stays as it is: it has no speech that noise could be compared with.
/// @param noise   as many samples as the clip has, not all 0.
/// @param snr_db  in [-60, 100].
/// @param first   only so many samples count for the ratio: what is behind them is no part of the recording.
/// @throws std::invalid_argument naming what is out of range.
Samples mixNoise(const Samples& clip, const std::vector<float>& noise, double snr_db,
                 size_t first = std::numeric_limits<size_t>::max());

/// What the room of a clip sounds like without speech: the clip's quietest 100 ms forward and backward in turns, so
/// that there is no step. From a clip without samples it is silence.
Samples continueBackground(const Samples& clip, size_t count);

}  // namespace pi_speech
