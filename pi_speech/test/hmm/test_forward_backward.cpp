#include "hmm/forward_backward.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>
#include <vector>

namespace pi_speech
{
namespace
{

constexpr float NONE = -std::numeric_limits<float>::infinity();
using Path = std::vector<int>;

RowMatrix randomEmissions(Eigen::Index frames, Eigen::Index states, uint32_t seed)
{
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(-3.0F, 2.0F);
  RowMatrix emissions(frames, states);
  return emissions.unaryExpr([&](float) { return normal(random); });
}

/// Emissions that allow one path only, at no cost.
RowMatrix onlyPath(const Path& path, int states)
{
  RowMatrix emissions = RowMatrix::Constant(static_cast<Eigen::Index>(path.size()), states, NONE);
  for (size_t t = 0; t < path.size(); ++t)
  {
    emissions(static_cast<Eigen::Index>(t), path[t]) = 0.0F;
  }
  return emissions;
}

/// All sequences of so many states.
std::vector<Path> allPaths(size_t frames, int states)
{
  std::vector<Path> paths{{}};
  for (size_t t = 0; t < frames; ++t)
  {
    std::vector<Path> longer;
    for (const Path& path : paths)
    {
      for (int s = 0; s < states; ++s)
      {
        longer.push_back(path);
        longer.back().push_back(s);
      }
    }
    paths = longer;
  }
  return paths;
}

/// ln of the sum over all paths of prior(path) * p(utterance | path), one path after another.
double enumerate(const RowMatrix& emissions, const std::function<float(const Path&)>& prior)
{
  double sum = 0.0;
  for (const Path& path : allPaths(static_cast<size_t>(emissions.rows()), static_cast<int>(emissions.cols())))
  {
    double score = prior(path);
    for (size_t t = 0; t < path.size(); ++t)
    {
      score += emissions(static_cast<Eigen::Index>(t), path[t]);
    }
    sum += std::exp(score);
  }
  return std::log(sum);
}

/// d score / d emissions.
RowMatrix derivative(const RowMatrix& emissions, const std::function<float(const RowMatrix&)>& score)
{
  constexpr float STEP = 0.03F;
  RowMatrix result(emissions.rows(), emissions.cols());
  for (Eigen::Index t = 0; t < emissions.rows(); ++t)
  {
    for (Eigen::Index s = 0; s < emissions.cols(); ++s)
    {
      RowMatrix more = emissions;
      RowMatrix less = emissions;
      more(t, s) += STEP;
      less(t, s) -= STEP;
      result(t, s) = (score(more) - score(less)) / (2.0F * STEP);
    }
  }
  return result;
}

std::vector<int> chainOf(int states)
{
  std::vector<int> columns;
  for (int s = 0; s < states; ++s)
  {
    columns.push_back(s);
  }
  return columns;
}

float chainPrior(const Path& path, int states)
{
  return chainScore(onlyPath(path, states), chainOf(states), nullptr);
}

/// Symbol 0 is the background, the others are the filler's states.
float fillerPrior(const Path& path, int states)
{
  const RowMatrix emissions = onlyPath(path, states + 1);
  return fillerScore(emissions.rightCols(states), emissions.leftCols(1), nullptr, nullptr);
}

// Tolerances below: scores are sums of some ten single-precision numbers of about 30; derivatives are taken with steps
// of 0.03.
constexpr double SCORE_TOLERANCE = 1e-4;
constexpr double OCCUPANCY_TOLERANCE = 2e-3;

TEST(ChainScore, OnlyPathsFromLeftToRightThatSkipAtMostOneStateArePossible)
{
  constexpr int STATES = 4;
  for (const size_t frames : {1U, 2U, 3U, 4U, 5U})
  {
    for (const Path& path : allPaths(frames, STATES))
    {
      bool possible = path.front() <= 1 && path.back() >= STATES - 2;
      for (size_t t = 1; t < path.size(); ++t)
      {
        const int step = path[t] - path[t - 1];
        possible = possible && step >= 0 && step <= 2;
      }
      EXPECT_EQ(possible, std::isfinite(chainPrior(path, STATES))) << testing::PrintToString(path);
    }
  }
}

TEST(ChainScore, TransitionsOfAPathAreIndependent)
{
  // The same transitions in another order and at other states have the same probability.
  EXPECT_NEAR(chainPrior({0, 0, 1, 2, 3}, 4), chainPrior({0, 1, 2, 2, 3}, 4), 1e-5);
  EXPECT_NEAR(chainPrior({0, 2, 3, 4}, 5), chainPrior({0, 1, 2, 4}, 5), 1e-5);
  const float stay = chainPrior({0, 0, 1, 2}, 3) - chainPrior({0, 1, 2}, 3);
  const float next = chainPrior({0, 1, 2, 3}, 4) - chainPrior({0, 1, 2}, 3);
  const float skip = chainPrior({0, 2, 3, 4}, 5) - chainPrior({0, 1, 2}, 3);
  EXPECT_NEAR(1.0, std::exp(stay) + std::exp(next) + std::exp(skip), 1e-5);
}

TEST(ChainScore, IsTheSumOverAllPaths)
{
  for (const int states : {3, 4})
  {
    for (const Eigen::Index frames : {2, 3, 5, 7})
    {
      const RowMatrix emissions = randomEmissions(frames, states, static_cast<uint32_t>(10 * frames + states));
      const double expected = enumerate(emissions, [&](const Path& path) { return chainPrior(path, states); });
      EXPECT_NEAR(expected, chainScore(emissions, chainOf(states), nullptr), SCORE_TOLERANCE) << states << frames;
    }
  }
}

TEST(ChainScore, AColumnMayStandForMoreThanOneState)
{
  // As the background before and behind a word does.
  const RowMatrix emissions = randomEmissions(6, 3, 5);
  RowMatrix apart(6, 4);
  apart << emissions.col(2), emissions.col(0), emissions.col(1), emissions.col(2);

  EXPECT_NEAR(chainScore(apart, {0, 1, 2, 3}, nullptr), chainScore(emissions, {2, 0, 1, 2}, nullptr), 1e-5);
}

TEST(ChainScore, TooFewFramesAreImpossible)
{
  RowMatrix occupancies;
  EXPECT_EQ(NONE, chainScore(RowMatrix(0, 3), {0, 1, 2}, nullptr));
  EXPECT_EQ(NONE, chainScore(randomEmissions(1, 4, 1), {0, 1, 2, 3}, &occupancies));
  EXPECT_TRUE(std::isfinite(chainScore(randomEmissions(1, 3, 1), {0, 1, 2}, nullptr)));
  EXPECT_EQ(NONE, chainScore(randomEmissions(3, 12, 1), chainOf(12), nullptr));
}

TEST(ChainScore, OccupanciesAreTheDerivativeOfTheScore)
{
  const RowMatrix emissions = randomEmissions(8, 4, 6);
  RowMatrix occupancies;

  const float score = chainScore(emissions, chainOf(4), &occupancies);

  EXPECT_EQ(score, chainScore(emissions, chainOf(4), nullptr));
  ASSERT_EQ(8, occupancies.rows());
  ASSERT_EQ(4, occupancies.cols());
  const RowMatrix expected =
      derivative(emissions, [](const RowMatrix& changed) { return chainScore(changed, chainOf(4), nullptr); });
  EXPECT_LT((occupancies - expected).cwiseAbs().maxCoeff(), OCCUPANCY_TOLERANCE) << occupancies << "\n\n" << expected;
  for (Eigen::Index t = 0; t < 8; ++t)
  {
    EXPECT_NEAR(1.0F, occupancies.row(t).sum(), 1e-4F);
  }
}

TEST(ChainScore, OccupanciesStayExactInLongUtterances)
{
  // 500 frames with emissions as real ones: scores of some ten thousand.
  const RowMatrix emissions = 10.0F * randomEmissions(500, 12, 7);
  RowMatrix occupancies;

  ASSERT_TRUE(std::isfinite(chainScore(emissions, chainOf(12), &occupancies)));

  EXPECT_TRUE(occupancies.allFinite());
  const Eigen::VectorXf sums = occupancies.rowwise().sum();
  EXPECT_NEAR(1.0F, sums.minCoeff(), 0.05F);
  EXPECT_NEAR(1.0F, sums.maxCoeff(), 0.05F);
}

TEST(FillerScore, OnlySpeechWithBackgroundAroundItIsPossible)
{
  for (const size_t frames : {1U, 2U, 3U, 4U})
  {
    for (const Path& path : allPaths(frames, 3))
    {
      // Background, states in any order, background: the states are together, and there are some.
      int changes = 0;
      bool some = false;
      for (size_t t = 0; t < path.size(); ++t)
      {
        some = some || path[t] > 0;
        changes += t > 0 && path[t - 1] > 0 && path[t] == 0 ? 1 : 0;
        changes += t > 0 && path[t - 1] == 0 && path[t] > 0 && changes > 0 ? 1 : 0;
      }
      EXPECT_EQ(some && changes <= 1, std::isfinite(fillerPrior(path, 2))) << testing::PrintToString(path);
    }
  }
}

TEST(FillerScore, NoStateIsPreferred)
{
  EXPECT_NEAR(fillerPrior({0, 1, 2, 2, 0}, 3), fillerPrior({0, 3, 1, 1, 0}, 3), 1e-5);
  EXPECT_NEAR(fillerPrior({1, 2, 3, 0}, 3), fillerPrior({2, 1, 2, 0}, 3), 1e-5);
}

TEST(FillerScore, IsTheSumOverAllPaths)
{
  for (const int states : {1, 2, 3})
  {
    for (const Eigen::Index frames : {1, 2, 5, 6})
    {
      const RowMatrix emissions = randomEmissions(frames, states + 1, static_cast<uint32_t>(10 * frames + states));
      const double expected = enumerate(emissions, [&](const Path& path) { return fillerPrior(path, states); });
      EXPECT_NEAR(expected, fillerScore(emissions.rightCols(states), emissions.leftCols(1), nullptr, nullptr),
                  SCORE_TOLERANCE)
          << states << frames;
    }
  }
}

TEST(FillerScore, OccupanciesAreTheDerivativeOfTheScore)
{
  const RowMatrix emissions = randomEmissions(7, 4, 8);
  RowMatrix filler;
  RowMatrix background;

  const float score = fillerScore(emissions.rightCols(3), emissions.leftCols(1), &filler, &background);

  EXPECT_EQ(score, fillerScore(emissions.rightCols(3), emissions.leftCols(1), nullptr, nullptr));
  ASSERT_EQ(7, filler.rows());
  ASSERT_EQ(3, filler.cols());
  ASSERT_EQ(7, background.rows());
  ASSERT_EQ(1, background.cols());
  RowMatrix occupancies(7, 4);
  occupancies << background, filler;
  const RowMatrix expected =
      derivative(emissions, [](const RowMatrix& changed)
                 { return fillerScore(changed.rightCols(3), changed.leftCols(1), nullptr, nullptr); });
  EXPECT_LT((occupancies - expected).cwiseAbs().maxCoeff(), OCCUPANCY_TOLERANCE) << occupancies << "\n\n" << expected;
  for (Eigen::Index t = 0; t < 7; ++t)
  {
    EXPECT_NEAR(1.0F, occupancies.row(t).sum(), 1e-4F);
  }
}

TEST(FillerScore, WithoutFramesItIsImpossible)
{
  EXPECT_EQ(NONE, fillerScore(RowMatrix(0, 3), RowMatrix(0, 1), nullptr, nullptr));
}

TEST(BackgroundScore, IsTheSumOfItsEmissions)
{
  const RowMatrix emissions = randomEmissions(9, 1, 9);
  const float prior = backgroundScore(RowMatrix::Zero(9, 1));

  EXPECT_NEAR(emissions.sum() + prior, backgroundScore(emissions), 1e-4);
  // Each frame more is one more transition to itself.
  const float stay = backgroundScore(RowMatrix::Zero(2, 1)) - backgroundScore(RowMatrix::Zero(1, 1));
  EXPECT_LT(stay, 0.0F);
  EXPECT_NEAR(8.0F * stay, prior - backgroundScore(RowMatrix::Zero(1, 1)), 1e-5);
}

}  // namespace
}  // namespace pi_speech
