#include "hmm/diagonal_mixtures.h"

#include <cmath>
#include <stdexcept>
#include <string>

namespace pi_speech
{

DiagonalMixtures::DiagonalMixtures(int states, int components)
  : states(states)
  , components(components)
  , means(RowMatrix::Zero(states * components, FEATURES))
  , log_variances(RowMatrix::Zero(states * components, FEATURES))
  , log_weights(Eigen::VectorXf::Constant(states * components, -std::log(static_cast<float>(components))))
{
}

void DiagonalMixtures::validate() const
{
  const Eigen::Index rows = static_cast<Eigen::Index>(states) * components;
  if (states < 1 || components < 1 || means.rows() != rows || log_variances.rows() != rows ||
      log_weights.size() != rows || means.cols() != FEATURES || log_variances.cols() != FEATURES)
  {
    throw std::invalid_argument("sizes of a mixture do not fit: " + std::to_string(states) + " states of " +
                                std::to_string(components) + " components, " + std::to_string(means.rows()) + " means");
  }
  if (!means.allFinite() || !log_variances.allFinite() || !log_weights.allFinite() ||
      log_variances.cwiseAbs().maxCoeff() > 30.0F || log_weights.maxCoeff() > 1e-3F)
  {
    throw std::invalid_argument("a mixture has means, variances or weights that are out of range");
  }
}

MixtureScorer::MixtureScorer(const DiagonalMixtures& mixtures)
  : states_(mixtures.states), components_(mixtures.components)
{
  mixtures.validate();
  const RowMatrix precisions = (-mixtures.log_variances.array()).exp();
  linear_ = mixtures.means.cwiseProduct(precisions).transpose();
  quadratic_ = -0.5F * precisions.transpose();
  const float log_two_pi = std::log(2.0F * static_cast<float>(M_PI));
  constant_ = mixtures.log_weights.transpose() - 0.5F * (mixtures.log_variances.array() + log_two_pi +
                                                         mixtures.means.array().square() * precisions.array())
                                                            .rowwise()
                                                            .sum()
                                                            .matrix()
                                                            .transpose();
}

RowMatrix MixtureScorer::components(const FeatureMatrix& features) const
{
  RowMatrix result(features.rows(), constant_.size());
  result.noalias() = features * linear_;
  result.noalias() += features.cwiseAbs2() * quadratic_;
  result.rowwise() += constant_;
  return result;
}

RowMatrix MixtureScorer::states(const RowMatrix& components) const
{
  RowMatrix result(components.rows(), states_);
  for (Eigen::Index t = 0; t < components.rows(); ++t)
  {
    for (int s = 0; s < states_; ++s)
    {
      const auto row = components.row(t).segment(static_cast<Eigen::Index>(s) * components_, components_);
      const float most = row.maxCoeff();
      result(t, s) = most + std::log((row.array() - most).exp().sum());
    }
  }
  return result;
}

}  // namespace pi_speech
