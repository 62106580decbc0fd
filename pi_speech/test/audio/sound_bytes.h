#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace pi_speech
{

/// Little endian, so many bytes.
inline std::string littleEndian(uint32_t value, int bytes)
{
  std::string text;
  for (int i = 0; i < bytes; ++i)
  {
    text += static_cast<char>(value >> (8 * i) & 0xFF);
  }
  return text;
}

inline std::string sampleBytes(const std::vector<int16_t>& samples)
{
  std::string text;
  for (const int16_t sample : samples)
  {
    text += littleEndian(static_cast<uint16_t>(sample), 2);
  }
  return text;
}

/// A WAV file of 16 bit samples, written by hand. @param samples  interleaved.
inline std::string wavBytes(int rate_hz, int channels, const std::vector<int16_t>& samples)
{
  const std::string data = sampleBytes(samples);
  const auto size = static_cast<uint32_t>(data.size());
  return "RIFF" + littleEndian(36 + size, 4) + "WAVEfmt " + littleEndian(16, 4) + littleEndian(1, 2) +
         littleEndian(static_cast<uint32_t>(channels), 2) + littleEndian(static_cast<uint32_t>(rate_hz), 4) +
         littleEndian(static_cast<uint32_t>(rate_hz * channels * 2), 4) +
         littleEndian(static_cast<uint32_t>(channels * 2), 2) + littleEndian(16, 2) + "data" + littleEndian(size, 4) +
         data;
}

/// One channel.
inline std::vector<int16_t> sine(double frequency_hz, double amplitude, double duration_s, int rate_hz)
{
  std::vector<int16_t> samples(static_cast<size_t>(std::lround(duration_s * rate_hz)));
  for (size_t i = 0; i < samples.size(); ++i)
  {
    samples[i] = static_cast<int16_t>(
        std::lround(amplitude * std::sin(2.0 * M_PI * frequency_hz * static_cast<double>(i) / rate_hz)));
  }
  return samples;
}

/// 0, 1, 2 ...: each sample says where it stood.
inline std::vector<int16_t> counting(size_t count, int first = 0)
{
  std::vector<int16_t> samples(count);
  for (size_t i = 0; i < count; ++i)
  {
    samples[i] = static_cast<int16_t>(first + static_cast<int>(i));
  }
  return samples;
}

}  // namespace pi_speech
