#pragma once

#include <algorithm>

namespace pi_slam::estimator
{

/// Keeps the time per pair within a budget by doing less: each level takes a tenth of the features and one iteration.
class FrameBudget
{
public:
  /// @param budget_s  0: no bound.
  explicit FrameBudget(double budget_s) : budget_s_(budget_s) {}

  int features(int wanted) const { return std::max(wanted / 3, wanted - level_ * wanted / 10); }
  int iterations(int wanted) const { return std::max(1, wanted - level_); }
  bool reduced() const { return level_ > 0; }

  /// @param spent_s  for the last pair.
  void update(double spent_s)
  {
    if (budget_s_ <= 0.0)
    {
      return;
    }
    if (spent_s > budget_s_)
    {
      level_ = std::min(level_ + 1, MAX_LEVEL);
      calm_ = 0;
    }
    else if (level_ > 0 && spent_s < 0.7 * budget_s_ && ++calm_ >= CALM_PAIRS)
    {
      --level_;
      calm_ = 0;
    }
  }

private:
  static constexpr int MAX_LEVEL = 6;
  static constexpr int CALM_PAIRS = 20;  ///< in a row, before one level more is tried again

  double budget_s_;
  int level_ = 0;
  int calm_ = 0;
};

}  // namespace pi_slam::estimator
