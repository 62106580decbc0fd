#pragma once

#include <cmath>
#include <string>

#include "audio/synthetic_sounds.h"

namespace pi_speech
{

/// The network whose words are tones: go 400 Hz, left 1000 Hz, stop 2200 Hz, right 4500 Hz. It hears a word about 0.1 s
/// after its tone has begun. Written by training/network/make_golden.
inline std::string toneNetwork()
{
  return std::string(PI_SPEECH_TEST) + "/network/tones.bin";
}

/// Says a word of that network for 0.3 s.
inline void say(Samples* samples, const std::string& word, double begin_s)
{
  const double hertz = word == "go" ? 400.0 : word == "left" ? 1000.0 : word == "stop" ? 2200.0 : 4500.0;
  for (size_t i = samplesIn(begin_s); i < samplesIn(begin_s + 0.3); ++i)
  {
    samples->at(i) =
        toSample(samples->at(i) + 3000.0 * std::sin(2.0 * M_PI * hertz * static_cast<double>(i) / SAMPLE_RATE_HZ));
  }
}

}  // namespace pi_speech
