#pragma once

#include <pi_speech/audio.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

namespace pi_speech
{

inline size_t samplesIn(double seconds)
{
  return static_cast<size_t>(std::lround(seconds * SAMPLE_RATE_HZ));
}

inline int16_t toSample(double value)
{
  return static_cast<int16_t>(std::lround(std::clamp(value, -32767.0, 32767.0)));
}

/// Gaussian noise, the same for the same seed. @param deviation  in steps of the samples.
inline Samples whiteNoise(double seconds, double deviation, uint32_t seed = 1)
{
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, deviation);
  Samples samples(samplesIn(seconds));
  for (int16_t& sample : samples)
  {
    sample = toSample(normal(random));
  }
  return samples;
}

/// Adds what sounds like a vowel to the engines here: harmonics of a pitch over all bands, from one time to another.
/// @param amplitude  of each harmonic.
inline void addTones(Samples* samples, double begin_s, double end_s, double amplitude, double pitch_hz = 120.0)
{
  const size_t end = std::min(samples->size(), samplesIn(end_s));
  for (size_t i = samplesIn(begin_s); i < end; ++i)
  {
    double sum = 0.0;
    for (int harmonic = 1; pitch_hz * harmonic < 7000.0; ++harmonic)
    {
      // Phases that grow by the square keep the sum from peaking.
      sum += std::sin(2.0 * M_PI * pitch_hz * harmonic * static_cast<double>(i) / SAMPLE_RATE_HZ + harmonic * harmonic);
    }
    (*samples)[i] = toSample((*samples)[i] + amplitude * sum);
  }
}

}  // namespace pi_speech
