#include "policies/answer_times.h"

#include <algorithm>
#include <cmath>

namespace pi_offload
{
namespace
{
/// The prior counts as so many answers.
constexpr double PRIOR_ANSWERS = 20.0;
/// An answer counts 1/e after so many later ones.
constexpr double REMEMBERED = 300.0;
/// Part of an unanswered request that is taken as never answered before there are late answers.
constexpr double NEVER_SHARE = 0.5;
constexpr double LEAST = -4.0;
constexpr double FINE_STEP = 0.25;
}  // namespace

/// In bins, from 0.
double AnswerTimes::position(double value)
{
  const double at =
      value < -LEAST ? (value - LEAST) / FINE_STEP : static_cast<double>(FINE) + 4.0 * std::log2(value / -LEAST);
  return std::clamp(at, 0.0, static_cast<double>(BINS) - 1e-6);
}

void AnswerTimes::add(double value)
{
  if (!std::isnan(value))
  {
    std::array<double, BINS> shares{};
    shares[static_cast<size_t>(position(value))] = 1.0;
    count(shares);
  }
}

void AnswerTimes::addBeyond(double value)
{
  if (std::isnan(value))
  {
    return;
  }
  std::array<double, BINS> shares{};
  double sum = NEVER_SHARE;
  for (auto bin = static_cast<size_t>(position(value)); bin < BINS; ++bin)
  {
    shares[bin] = counts_[bin];
    sum += counts_[bin];
  }
  shares.back() += NEVER_SHARE;
  for (double& share : shares)
  {
    share /= sum;
  }
  count(shares);
}

void AnswerTimes::count(const std::array<double, BINS>& shares)
{
  for (size_t bin = BINS; bin-- > 0;)
  {
    counts_[bin] += shares[bin] - counts_[bin] / REMEMBERED;
    above_[bin] = above_[bin + 1] + counts_[bin];
  }
}

double AnswerTimes::beyond(double value, double loss_share) const
{
  const double laplace = value >= 0.0 ? 0.5 * std::exp(-value) : 1.0 - 0.5 * std::exp(value);
  const double before =
      prior_ != nullptr ? prior_->beyond(value, loss_share) : loss_share + (1.0 - loss_share) * laplace;
  if (!(above_[0] > 0.0))
  {
    return before;
  }
  const double at = position(value);
  const auto bin = static_cast<size_t>(at);
  const double counted = bin + 1 == BINS ? above_[bin] : above_[bin] - (at - static_cast<double>(bin)) * counts_[bin];
  return (PRIOR_ANSWERS * before + counted) / (PRIOR_ANSWERS + above_[0]);
}

}  // namespace pi_offload
