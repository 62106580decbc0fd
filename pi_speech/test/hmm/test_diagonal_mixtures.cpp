#include <gtest/gtest.h>
#include "hmm/diagonal_mixtures.h"

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{
namespace
{

DiagonalMixtures randomMixtures(int states, int components, uint32_t seed)
{
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  DiagonalMixtures mixtures(states, components);
  const auto any = [&](float) { return normal(random); };
  mixtures.means = 2.0F * mixtures.means.unaryExpr(any);
  mixtures.log_variances = mixtures.log_variances.unaryExpr(any);
  for (int s = 0; s < states; ++s)
  {
    Eigen::VectorXf weights = Eigen::VectorXf::Zero(components).unaryExpr(any).array().exp();
    mixtures.log_weights.segment(static_cast<Eigen::Index>(s) * components, components) =
        (weights / weights.sum()).array().log();
  }
  return mixtures;
}

FeatureMatrix randomFeatures(Eigen::Index frames, uint32_t seed)
{
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0.0F, 2.0F);
  FeatureMatrix features(frames, FEATURES);
  return features.unaryExpr([&](float) { return normal(random); });
}

/// ln p(x, k | s), in double and as it is written in books.
double density(const DiagonalMixtures& mixtures, Eigen::Index row, const FeatureMatrix& features, Eigen::Index t)
{
  double sum = mixtures.log_weights[row];
  for (int i = 0; i < FEATURES; ++i)
  {
    const double variance = std::exp(static_cast<double>(mixtures.log_variances(row, i)));
    const double x = static_cast<double>(features(t, i)) - mixtures.means(row, i);
    sum -= 0.5 * (std::log(2.0 * M_PI * variance) + x * x / variance);
  }
  return sum;
}

std::string errorOf(const std::function<void(DiagonalMixtures*)>& change)
{
  DiagonalMixtures mixtures = randomMixtures(3, 2, 1);
  change(&mixtures);
  try
  {
    mixtures.validate();
    return "";
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
}

TEST(DiagonalMixtures, BeginWithEvenWeightsAroundZero)
{
  const DiagonalMixtures mixtures(3, 4);

  EXPECT_NO_THROW(mixtures.validate());
  EXPECT_EQ(12, mixtures.means.rows());
  for (int s = 0; s < 3; ++s)
  {
    EXPECT_NEAR(1.0F, mixtures.log_weights.segment<4>(4L * s).array().exp().sum(), 1e-6F);
  }
}

TEST(DiagonalMixtures, WhatDoesNotFitIsAnError)
{
  EXPECT_EQ("", errorOf([](DiagonalMixtures*) {}));
  EXPECT_NE("", errorOf([](auto* m) { m->states = 2; }));
  EXPECT_NE("", errorOf([](auto* m) { m->components = 0; }));
  EXPECT_NE("", errorOf([](auto* m) { m->means.conservativeResize(5, Eigen::NoChange); }));
  EXPECT_NE("", errorOf([](auto* m) { m->log_variances.conservativeResize(Eigen::NoChange, 38); }));
  EXPECT_NE("", errorOf([](auto* m) { m->log_weights.conservativeResize(7); }));
  EXPECT_NE("", errorOf([](auto* m) { m->means(5, 38) = std::numeric_limits<float>::quiet_NaN(); }));
  EXPECT_NE("", errorOf([](auto* m) { m->log_variances(0, 0) = std::numeric_limits<float>::infinity(); }));
  EXPECT_NE("", errorOf([](auto* m) { m->log_variances(0, 0) = -80.0F; }));
  EXPECT_NE("", errorOf([](auto* m) { m->log_weights[1] = 1.0F; }));
  EXPECT_THROW(DiagonalMixtures().validate(), std::invalid_argument);
  EXPECT_THROW(MixtureScorer{DiagonalMixtures()}, std::invalid_argument);
}

TEST(MixtureScorer, GivesTheDensitiesOfTheComponents)
{
  const DiagonalMixtures mixtures = randomMixtures(5, 4, 1);
  const FeatureMatrix features = randomFeatures(20, 2);

  const RowMatrix components = MixtureScorer(mixtures).components(features);

  ASSERT_EQ(20, components.rows());
  ASSERT_EQ(20, components.cols());
  for (Eigen::Index t = 0; t < components.rows(); ++t)
  {
    for (Eigen::Index k = 0; k < components.cols(); ++k)
    {
      const double expected = density(mixtures, k, features, t);
      // Single precision over a sum of a hundred terms that partly cancel.
      EXPECT_NEAR(expected, components(t, k), 2e-5 * std::abs(expected) + 2e-3);
    }
  }
}

TEST(MixtureScorer, GivesTheDensitiesOfTheStates)
{
  const DiagonalMixtures mixtures = randomMixtures(5, 4, 3);
  const FeatureMatrix features = randomFeatures(20, 4);
  const MixtureScorer scorer(mixtures);

  const RowMatrix scores = scorer.score(features);

  ASSERT_EQ(5, scorer.states());
  ASSERT_EQ(20, scores.rows());
  ASSERT_EQ(5, scores.cols());
  EXPECT_EQ(scores, scorer.states(scorer.components(features)));
  for (Eigen::Index t = 0; t < scores.rows(); ++t)
  {
    for (int s = 0; s < 5; ++s)
    {
      double most = -std::numeric_limits<double>::infinity();
      for (int k = 0; k < 4; ++k)
      {
        most = std::max(most, density(mixtures, 4 * s + k, features, t));
      }
      double sum = 0.0;
      for (int k = 0; k < 4; ++k)
      {
        sum += std::exp(density(mixtures, 4 * s + k, features, t) - most);
      }
      const double expected = most + std::log(sum);
      EXPECT_NEAR(expected, scores(t, s), 2e-5 * std::abs(expected) + 2e-3);
    }
  }
}

TEST(MixtureScorer, FramesFarFromAllComponentsStayFinite)
{
  const MixtureScorer scorer(randomMixtures(2, 4, 5));
  const FeatureMatrix features = FeatureMatrix::Constant(1, FEATURES, 500.0F);

  const RowMatrix scores = scorer.score(features);

  EXPECT_TRUE(scores.allFinite());
  EXPECT_LT(scores.maxCoeff(), -1e5F);
}

TEST(MixtureScorer, NoFramesHaveNoScores)
{
  const MixtureScorer scorer(randomMixtures(2, 4, 5));

  const RowMatrix scores = scorer.score(FeatureMatrix(0, FEATURES));

  EXPECT_EQ(0, scores.rows());
  EXPECT_EQ(2, scores.cols());
}

}  // namespace
}  // namespace pi_speech
