#pragma once

#include <pi_speech/AudioData.h>
#include <pi_speech/AudioDataStamped.h>
#include <pi_speech/AudioInfo.h>
#include <pi_speech/audio.h>
#include <std_msgs/Header.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace pi_speech
{

/// @throws std::invalid_argument naming field, value and way out: another sample format than S16LE, compressed sound, a
/// rate or number of channels out of range.
AudioFormat fromMsg(const AudioInfo& message);
AudioInfo toMsg(const AudioFormat& format);

/// @param[out] samples  interleaved, in place of what was in there.
/// @throws std::invalid_argument if the bytes are no whole number of frames of this format; samples is then empty.
void fromMsg(const AudioData& message, const AudioFormat& format, std::vector<int16_t>* samples);
/// @param header  its stamp is that of the first sample.
AudioDataStamped toMsg(const int16_t* samples, size_t count, const std_msgs::Header& header);

}  // namespace pi_speech
