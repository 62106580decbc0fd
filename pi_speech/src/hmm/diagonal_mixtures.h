#pragma once

#include "features/speech_features.h"

#include <Eigen/Core>

namespace pi_speech
{

using RowMatrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Gaussian mixtures with diagonal covariances, one for each of so many states, all with the same number of components.
/// Rows are components: those of state s are [s * components, (s + 1) * components).
struct DiagonalMixtures
{
  int states = 0;
  int components = 0;
  RowMatrix means;              ///< states * components x FEATURES
  RowMatrix log_variances;      ///< likewise
  Eigen::VectorXf log_weights;  ///< sum of exp() over a state's components = 1

  DiagonalMixtures() = default;
  DiagonalMixtures(int states, int components);

  /// @throws std::invalid_argument naming what is wrong: sizes, values that are not finite, variances out of range.
  void validate() const;
};

/// Log-likelihoods of frames, as matrix products (the quadratic form of a diagonal Gaussian is linear in x and x^2).
/// Const methods are thread safe.
class MixtureScorer
{
public:
  MixtureScorer() = default;
  explicit MixtureScorer(const DiagonalMixtures& mixtures);

  int states() const { return states_; }
  /// ln p(x_t, k | s): one row per frame, one column per component.
  RowMatrix components(const FeatureMatrix& features) const;
  /// ln p(x_t | s): one row per frame, one column per state. @param components  of components().
  RowMatrix states(const RowMatrix& components) const;
  RowMatrix score(const FeatureMatrix& features) const { return states(components(features)); }

private:
  int states_ = 0;
  int components_ = 0;
  RowMatrix linear_;     ///< FEATURES x rows
  RowMatrix quadratic_;  ///< FEATURES x rows
  Eigen::RowVectorXf constant_;
};

}  // namespace pi_speech
