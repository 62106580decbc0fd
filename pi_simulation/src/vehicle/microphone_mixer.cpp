#include "vehicle/microphone_mixer.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace pi_simulation
{
namespace
{

constexpr double FULL_SCALE = 32768.0;
constexpr size_t CALIBRATION = 4 * pi_speech::SAMPLE_RATE_HZ;  ///< samples of noise that tell its level
constexpr size_t GUSTS = 60 * pi_speech::SAMPLE_RATE_HZ;       ///< the same of noise with slow changes

double amplitude(double db)
{
  return std::pow(10.0, db / 20.0);
}

MicrophoneMixerOptions validated(const MicrophoneMixerOptions& options)
{
  options.validate();
  return options;
}

/// Factor that brings a source of any scale to this level.
double gainTo(double level_dbfs, const std::vector<float>& values)
{
  const double sum =
      std::accumulate(values.begin(), values.end(), 0.0, [](double s, float v) { return s + 1.0 * v * v; });
  const double rms = std::sqrt(sum / static_cast<double>(values.size()));
  return FULL_SCALE * amplitude(level_dbfs) / rms;
}

}  // namespace

void MicrophoneMixerOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("noise_level_dbfs", noise_level_dbfs, -120.0, 0.0);
  check.range("seed", seed, 0, 2147483647);
  check.range("background_level_dbfs", background_level_dbfs, -120.0, 0.0);
  check.range("play_gain_db", play_gain_db, -60.0, 20.0);
}

MicrophoneMixer::MicrophoneMixer(const MicrophoneMixerOptions& options)
  : noise_("pink", static_cast<uint32_t>(validated(options).seed)), play_gain_(amplitude(options.play_gain_db))
{
  noise_gain_ = gainTo(options.noise_level_dbfs, noise_.next(CALIBRATION));
  if (!options.background.empty())
  {
    background_ = std::make_unique<pi_speech::NoiseSource>(options.background, static_cast<uint32_t>(options.seed));
    const size_t round = background_->period() > 0 ? background_->period() : GUSTS;
    background_gain_ = gainTo(options.background_level_dbfs, background_->next(round));
  }
}

SoundPlace MicrophoneMixer::play(pi_speech::Samples samples)
{
  SoundPlace place;
  place.begin = position_;
  place.speech_end = position_ + static_cast<int64_t>(pi_speech::endOfSpeech(samples));
  place.end = position_ + static_cast<int64_t>(samples.size());
  if (!samples.empty())
  {
    playing_.push_back({std::move(samples), 0});
  }
  return place;
}

pi_speech::Samples MicrophoneMixer::next(size_t count)
{
  std::vector<double> sum(count, 0.0);
  const auto add = [&sum](const std::vector<float>& values, double gain)
  {
    std::transform(sum.begin(), sum.end(), values.begin(), sum.begin(),
                   [gain](double total, float value) { return total + gain * value; });
  };
  add(noise_.next(count), noise_gain_);
  if (background_)
  {
    add(background_->next(count), background_gain_);
  }
  for (Playing& one : playing_)
  {
    const size_t part = std::min(count, one.samples.size() - one.at);
    for (size_t i = 0; i < part; ++i)
    {
      sum[i] += play_gain_ * one.samples[one.at + i];
    }
    one.at += part;
  }
  playing_.remove_if([](const Playing& one) { return one.at == one.samples.size(); });
  pi_speech::Samples samples(count);
  std::transform(sum.begin(), sum.end(), samples.begin(),
                 [](double value) { return static_cast<int16_t>(std::lround(std::clamp(value, -32768.0, 32767.0))); });
  position_ += static_cast<int64_t>(count);
  return samples;
}

}  // namespace pi_simulation
