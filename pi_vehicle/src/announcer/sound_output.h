#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// Plays one channel of samples on a device of ALSA, which is open only meanwhile. Returns when they were heard.
/// @param device  its name, as default or plughw:1,0. @param sample_rate  [Hz]; ALSA converts.
/// @param stop    true: returns early.
/// @throws std::runtime_error naming the device and what is wrong with it, also if it takes no sound for a second.
void playSound(const std::string& device, int sample_rate, const std::vector<int16_t>& samples,
               const std::atomic<bool>& stop);

}  // namespace pi_vehicle
