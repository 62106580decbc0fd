#pragma once

#include <pi_speech/noise_mixing.h>

#include <limits>
#include <vector>

namespace pi_speech
{

/// Adds noise to a clip, so that the power of its speech (activePower()) is snr_db above the mean power of the noise.
/// If the sum would exceed full scale, all of it is made quieter. A silent clip is returned unchanged.
/// @param noise   as many samples as the clip has, not all 0.
/// @param snr_db  in [-60, 100].
/// @param first   number of samples that count for the ratio, if the clip was continued after its recording.
/// @throws std::invalid_argument naming what is out of range.
Samples mixNoise(const Samples& clip, const std::vector<float>& noise, double snr_db,
                 size_t first = std::numeric_limits<size_t>::max());

/// The background of a clip: its quietest 100 ms, forward and backward in turns so that there is no step. Silence for
/// an empty clip.
Samples continueBackground(const Samples& clip, size_t count);

}  // namespace pi_speech
