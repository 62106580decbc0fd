#pragma once

#include <Eigen/Core>
#include <vector>

namespace pi_detect
{

/// Assigns rows to columns, each at most once, at the least sum of costs (shortest augmenting paths: Jonker and
/// Volgenant 1987, Crouse 2016). A row without a column adds `forbidden` to the sum.
///
/// A pair whose cost is not finite or not below `forbidden` is never assigned. The time depends on how many rows and
/// columns compete for each other, at worst on rows^2 * columns. Equal inputs give equal results.
/// @param cost  any size, also without rows or columns; values may be negative.
/// @return column of each row, -1 for none.
/// @throws std::invalid_argument if `forbidden` is not finite.
std::vector<int> assign(const Eigen::MatrixXd& cost, double forbidden);

}  // namespace pi_detect
