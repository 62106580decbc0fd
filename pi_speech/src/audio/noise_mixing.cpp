#include <pi_speech/noise_mixing.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numeric>
#include <random>
#include <stdexcept>

namespace pi_speech
{
namespace
{

constexpr size_t ACTIVE_PIECE = SAMPLE_RATE_HZ / 20;
constexpr double ACTIVE_SHARE = 0.3;

double power(const int16_t* begin, const int16_t* end)
{
  const double sum = std::accumulate(begin, end, 0.0, [](double total, int16_t s) { return total + 1.0 * s * s; });
  return sum / static_cast<double>(end - begin);
}

/// White noise through a sum of poles that falls by 3 dB per octave (P. Kellet's filter: within 1 dB above a thousandth
/// of half the rate).
class PinkFilter
{
public:
  float operator()(float white)
  {
    b_[0] = 0.99886F * b_[0] + white * 0.0555179F;
    b_[1] = 0.99332F * b_[1] + white * 0.0750759F;
    b_[2] = 0.96900F * b_[2] + white * 0.1538520F;
    b_[3] = 0.86650F * b_[3] + white * 0.3104856F;
    b_[4] = 0.55000F * b_[4] + white * 0.5329522F;
    b_[5] = -0.7616F * b_[5] - white * 0.0168980F;
    const float pink = b_[0] + b_[1] + b_[2] + b_[3] + b_[4] + b_[5] + b_[6] + white * 0.5362F;
    b_[6] = white * 0.115926F;
    return pink;
  }

private:
  float b_[7] = {};
};

/// White noise through two poles at 300 Hz, under gusts of some seconds that nearly still it or nearly double it.
class WindFilter
{
public:
  float operator()(float white, float gust_white)
  {
    gust_ += GUST_POLE * (gust_white / std::sqrt(GUST_POLE / 2.0F) - gust_);  // of deviation 1
    low_ += CUT_OFF_POLE * (white - low_);
    lower_ += CUT_OFF_POLE * (low_ - lower_);
    return lower_ * (1.0F + 0.8F * std::tanh(gust_));
  }

private:
  static constexpr float CUT_OFF_POLE = 6.2832F * 300.0F / SAMPLE_RATE_HZ;
  static constexpr float GUST_POLE = 6.2832F * 0.1F / SAMPLE_RATE_HZ;
  float low_ = 0.0F;
  float lower_ = 0.0F;
  float gust_ = 0.0F;
};

}  // namespace

double activePower(const Samples& samples)
{
  if (samples.empty())
  {
    return 0.0;
  }
  if (samples.size() < ACTIVE_PIECE)
  {
    return power(samples.data(), samples.data() + samples.size());
  }
  std::vector<double> powers;
  for (size_t begin = 0; begin + ACTIVE_PIECE <= samples.size(); begin += ACTIVE_PIECE)
  {
    powers.push_back(power(samples.data() + begin, samples.data() + begin + ACTIVE_PIECE));
  }
  std::sort(powers.begin(), powers.end(), std::greater<>());
  const size_t active = std::max<size_t>(1, std::lround(ACTIVE_SHARE * static_cast<double>(powers.size())));
  return std::accumulate(powers.begin(), powers.begin() + static_cast<std::ptrdiff_t>(active), 0.0) /
         static_cast<double>(active);
}

NoiseSource::NoiseSource(const std::string& name, uint32_t seed)
{
  std::mt19937 random(seed);
  if (name == "wind")
  {
    sample_ = [random, normal = std::normal_distribution<float>(), filter = WindFilter()]() mutable
    {
      const float white = normal(random);
      return filter(white, normal(random));
    };
    return;
  }
  if (isMade(name))
  {
    const bool pink = name == "pink";
    sample_ = [random, pink, normal = std::normal_distribution<float>(), filter = PinkFilter()]() mutable
    {
      const float white = normal(random);
      return pink ? filter(white) : white;
    };
    return;
  }
  const auto samples = std::make_shared<const Samples>(readAudioFile(name));
  if (std::all_of(samples->begin(), samples->end(), [](int16_t sample) { return sample == 0; }))
  {
    throw std::runtime_error("noise " + name + ": there is only silence in this file; give another one");
  }
  period_ = samples->size();
  size_t at = std::uniform_int_distribution<size_t>(0, samples->size() - 1)(random);
  sample_ = [samples, at]() mutable
  {
    const auto sample = static_cast<float>((*samples)[at]);
    at = (at + 1) % samples->size();
    return sample;
  };
}

std::vector<float> NoiseSource::next(size_t count)
{
  std::vector<float> noise(count);
  std::generate(noise.begin(), noise.end(), std::ref(sample_));
  return noise;
}

}  // namespace pi_speech
