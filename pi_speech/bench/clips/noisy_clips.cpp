#include "clips/noisy_clips.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace pi_speech
{
namespace
{

constexpr size_t BACKGROUND_PIECE = SAMPLE_RATE_HZ / 10;
constexpr size_t BACKGROUND_STEP = SAMPLE_RATE_HZ / 100;
constexpr double LARGEST = 32767.0;

double power(const int16_t* begin, const int16_t* end)
{
  const double sum = std::accumulate(begin, end, 0.0, [](double total, int16_t s) { return total + 1.0 * s * s; });
  return sum / static_cast<double>(end - begin);
}

}  // namespace

Samples mixNoise(const Samples& clip, const std::vector<float>& noise, double snr_db, size_t first)
{
  pi_node::OptionCheck("").range("snr_db", snr_db, -60.0, 100.0);
  if (noise.size() != clip.size())
  {
    throw std::invalid_argument("mixNoise: " + std::to_string(noise.size()) + " samples of noise, must be " +
                                std::to_string(clip.size()) + ", as the clip has");
  }
  const auto counted = static_cast<std::ptrdiff_t>(std::min(first, clip.size()));
  const double speech_power = activePower(Samples(clip.begin(), clip.begin() + counted));
  if (speech_power <= 0.0)
  {
    return clip;
  }
  const double noise_power =
      std::inner_product(noise.begin(), noise.begin() + counted, noise.begin(), 0.0) / static_cast<double>(counted);
  if (!(noise_power > 0.0 && std::isfinite(noise_power)))
  {
    throw std::invalid_argument("mixNoise: power of the noise = " + std::to_string(noise_power) + ", must be positive");
  }
  const double gain = std::sqrt(speech_power / noise_power * std::pow(10.0, -snr_db / 10.0));
  std::vector<double> sum(clip.size());
  double largest = 0.0;
  for (size_t i = 0; i < clip.size(); ++i)
  {
    sum[i] = clip[i] + gain * noise[i];
    largest = std::max(largest, std::abs(sum[i]));
  }
  const double scale = largest > LARGEST ? LARGEST / largest : 1.0;
  Samples mixed(clip.size());
  std::transform(sum.begin(), sum.end(), mixed.begin(),
                 [scale](double value) { return static_cast<int16_t>(std::lround(scale * value)); });
  return mixed;
}

Samples continueBackground(const Samples& clip, size_t count)
{
  if (clip.empty())
  {
    return Samples(count, 0);
  }
  const size_t length = std::min(BACKGROUND_PIECE, clip.size());
  size_t quietest = 0;
  double least = power(clip.data(), clip.data() + length);
  for (size_t begin = BACKGROUND_STEP; begin + length <= clip.size(); begin += BACKGROUND_STEP)
  {
    const double found = power(clip.data() + begin, clip.data() + begin + length);
    if (found < least)
    {
      least = found;
      quietest = begin;
    }
  }
  Samples background(count);
  for (size_t i = 0; i < count; ++i)
  {
    const size_t step = i % (2 * length);
    background[i] = clip[quietest + (step < length ? step : 2 * length - 1 - step)];
  }
  return background;
}

}  // namespace pi_speech
