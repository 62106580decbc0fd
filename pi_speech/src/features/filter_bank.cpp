#include <pi_speech/filter_bank.h>

#include <cmath>
#include <complex>
#include <unsupported/Eigen/FFT>
#include <vector>

namespace pi_speech
{

namespace
{

constexpr int FFT_SIZE = 512;
constexpr float PRE_EMPHASIS = 0.97F;
constexpr double LOWEST_HZ = 60.0;
constexpr double HIGHEST_HZ = 7600.0;
/// Energy in a band of sound of far less than one step.
constexpr float ENERGY_FLOOR = 100.0F;

double mel(double hz)
{
  return 2595.0 * std::log10(1.0 + hz / 700.0);
}

double hzOf(double mel)
{
  return 700.0 * (std::pow(10.0, mel / 2595.0) - 1.0);
}

}  // namespace

/// One side of the spectrum of a triangle, from its first bin that is not zero.
struct MelBand
{
  int first = 0;
  std::vector<float> weights;
};

struct FilterBank::Impl
{
  std::array<float, FRAME_SAMPLES> window;
  std::array<MelBand, BANDS> bands;
  Eigen::FFT<float> fft;
  std::vector<float> in = std::vector<float>(FFT_SIZE, 0.0F);
  std::vector<std::complex<float>> out;
};

FilterBank::FilterBank() : impl_(std::make_unique<Impl>())
{
  for (int i = 0; i < FRAME_SAMPLES; ++i)
  {
    impl_->window[i] = static_cast<float>(0.54 - 0.46 * std::cos(2.0 * M_PI * i / (FRAME_SAMPLES - 1)));
  }
  const double low = mel(LOWEST_HZ);
  const double step = (mel(HIGHEST_HZ) - low) / (BANDS + 1);
  for (int b = 0; b < BANDS; ++b)
  {
    const double left = hzOf(low + b * step);
    const double middle = hzOf(low + (b + 1) * step);
    const double right = hzOf(low + (b + 2) * step);
    MelBand& band = impl_->bands[b];
    for (int k = 0; k <= FFT_SIZE / 2; ++k)
    {
      const double hz = static_cast<double>(k) * SAMPLE_RATE_HZ / FFT_SIZE;
      const double weight = std::min((hz - left) / (middle - left), (right - hz) / (right - middle));
      if (weight <= 0.0)
      {
        continue;
      }
      if (band.weights.empty())
      {
        band.first = k;
      }
      band.weights.push_back(static_cast<float>(weight));
    }
  }
  impl_->fft.SetFlag(Eigen::FFT<float>::HalfSpectrum);
}

FilterBank::~FilterBank() = default;
FilterBank::FilterBank(FilterBank&&) noexcept = default;
FilterBank& FilterBank::operator=(FilterBank&&) noexcept = default;

BandEnergies FilterBank::energies(const int16_t* frame)
{
  // The first sample has no predecessor in its frame: it is its own, as in other front ends.
  impl_->in[0] = (1.0F - PRE_EMPHASIS) * frame[0] * impl_->window[0];
  for (int i = 1; i < FRAME_SAMPLES; ++i)
  {
    impl_->in[i] = (static_cast<float>(frame[i]) - PRE_EMPHASIS * static_cast<float>(frame[i - 1])) * impl_->window[i];
  }
  impl_->fft.fwd(impl_->out, impl_->in);
  BandEnergies result;
  for (int b = 0; b < BANDS; ++b)
  {
    const MelBand& band = impl_->bands[b];
    float sum = ENERGY_FLOOR;
    for (size_t k = 0; k < band.weights.size(); ++k)
    {
      sum += band.weights[k] * std::norm(impl_->out[band.first + k]);
    }
    result[b] = std::log(sum);
  }
  return result;
}

}  // namespace pi_speech
