#pragma once

#include <pi_speech/audio.h>

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <memory>

namespace pi_speech
{

constexpr int FRAME_SAMPLES = 400;  ///< 25 ms
constexpr int HOP_SAMPLES = 160;    ///< from one frame to the next, 10 ms
constexpr int BANDS = 26;           ///< triangular in mel scale, 60 to 7600 Hz
constexpr double FRAME_S = static_cast<double>(HOP_SAMPLES) / SAMPLE_RATE_HZ;

/// Natural logarithms of the energies of one frame in the bands, with a floor that keeps them finite.
using BandEnergies = Eigen::Matrix<float, BANDS, 1>;

/// Short-time energies in bands, the first half of mel-frequency cepstral coefficients (Davis and Mermelstein 1980):
/// pre-emphasis 0.97, Hamming window, power spectrum, triangles. Not thread safe.
class FilterBank
{
public:
  FilterBank();
  ~FilterBank();
  FilterBank(FilterBank&&) noexcept;
  FilterBank& operator=(FilterBank&&) noexcept;

  /// @param frame  FRAME_SAMPLES samples.
  BandEnergies energies(const int16_t* frame);

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Number of whole frames in so many samples.
constexpr size_t framesOf(size_t samples)
{
  return samples < static_cast<size_t>(FRAME_SAMPLES) ? 0 : 1 + (samples - FRAME_SAMPLES) / HOP_SAMPLES;
}

}  // namespace pi_speech
