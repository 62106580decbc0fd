#pragma once

#include <pi_speech/filter_bank.h>

#include <Eigen/Core>

namespace pi_speech
{

constexpr int CEPSTRA = 13;
constexpr int FEATURES = 3 * CEPSTRA;  ///< cepstra, their slopes, the slopes' slopes

/// One row per frame.
using FeatureMatrix = Eigen::Matrix<float, Eigen::Dynamic, FEATURES, Eigen::RowMajor>;

/// Mel-frequency cepstral coefficients of an utterance with their first and second slopes over 5 frames, less the mean
/// of the utterance's cepstra. Not thread safe.
class SpeechFeatures
{
public:
  /// @return no rows for less than a frame.
  FeatureMatrix compute(const int16_t* samples, size_t count);

private:
  FilterBank bank_;
};

}  // namespace pi_speech
