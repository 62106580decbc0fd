#pragma once

#include <array>
#include <cstddef>

namespace pi_offload
{

/// Distribution of answer times, learned from answers. A value is (time - expected) / deviation: so one distribution
/// holds for fast and slow links, and tells how far expectation and deviation can be trusted.
///
/// It begins as its prior: another distribution, or that of Laplace with a small share that is never answered. Not
/// thread safe; allocates nothing.
class AnswerTimes
{
public:
  /// @param prior  must outlive this; null: Laplace.
  explicit AnswerTimes(const AnswerTimes* prior = nullptr) : prior_(prior) {}

  void add(double value);
  /// No answer came until `value`; then it was not awaited any more. The rest of the distribution takes it in equal
  /// parts (Kaplan and Meier 1958).
  void addBeyond(double value);
  /// Probability that no answer comes until `value`. @param loss_share  of Laplace: answers that never come.
  double beyond(double value, double loss_share) const;

private:
  static constexpr size_t FINE = 32;    ///< of 0.25 in [-4, 4]
  static constexpr size_t COARSE = 21;  ///< four per doubling, to 128; the last one has all beyond
  static constexpr size_t BINS = FINE + COARSE;

  static double position(double value);
  void count(const std::array<double, BINS>& shares);

  const AnswerTimes* prior_;
  std::array<double, BINS> counts_{};
  std::array<double, BINS + 1> above_{};  ///< counts of this bin and later ones
};

}  // namespace pi_offload
