#include "features/speech_features.h"

#include <algorithm>
#include <cmath>

namespace pi_speech
{

namespace
{

constexpr int SLOPE_FRAMES = 2;  ///< on either side

/// Type II cosine transform, orthonormal; one column per cepstrum.
Eigen::Matrix<float, BANDS, CEPSTRA> cosines()
{
  Eigen::Matrix<float, BANDS, CEPSTRA> result;
  for (int c = 0; c < CEPSTRA; ++c)
  {
    const double scale = std::sqrt((c == 0 ? 1.0 : 2.0) / BANDS);
    for (int b = 0; b < BANDS; ++b)
    {
      result(b, c) = static_cast<float>(scale * std::cos(M_PI * c * (b + 0.5) / BANDS));
    }
  }
  return result;
}

/// Least-squares slopes of the columns [from, from + CEPSTRA) into those behind them; the ends are repeated.
void addSlopes(FeatureMatrix* features, int from)
{
  const Eigen::Index frames = features->rows();
  float norm = 0.0F;
  for (int i = 1; i <= SLOPE_FRAMES; ++i)
  {
    norm += 2.0F * static_cast<float>(i * i);
  }
  for (Eigen::Index t = 0; t < frames; ++t)
  {
    Eigen::Matrix<float, 1, CEPSTRA> slope = Eigen::Matrix<float, 1, CEPSTRA>::Zero();
    for (int i = 1; i <= SLOPE_FRAMES; ++i)
    {
      const Eigen::Index after = std::min<Eigen::Index>(frames - 1, t + i);
      const Eigen::Index before = std::max<Eigen::Index>(0, t - i);
      slope += static_cast<float>(i) *
               (features->block<1, CEPSTRA>(after, from) - features->block<1, CEPSTRA>(before, from));
    }
    features->block<1, CEPSTRA>(t, from + CEPSTRA) = slope / norm;
  }
}

}  // namespace

FeatureMatrix SpeechFeatures::compute(const int16_t* samples, size_t count)
{
  static const Eigen::Matrix<float, BANDS, CEPSTRA> COSINES = cosines();
  const auto frames = static_cast<Eigen::Index>(framesOf(count));
  FeatureMatrix features(frames, FEATURES);
  if (frames == 0)
  {
    return features;
  }
  for (Eigen::Index t = 0; t < frames; ++t)
  {
    features.block<1, CEPSTRA>(t, 0) = bank_.energies(samples + t * HOP_SAMPLES).transpose() * COSINES;
  }
  const Eigen::Matrix<float, 1, CEPSTRA> mean = features.leftCols<CEPSTRA>().colwise().mean();
  features.leftCols<CEPSTRA>().rowwise() -= mean;
  addSlopes(&features, 0);
  addSlopes(&features, CEPSTRA);
  return features;
}

}  // namespace pi_speech
