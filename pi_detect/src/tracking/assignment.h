#pragma once

#include <Eigen/Core>
#include <vector>

namespace pi_detect
{

/// Assigns rows to columns, each at most once, such that the sum of costs is least (shortest augmenting paths: Jonker
/// and Volgenant 1987, Crouse 2016). A row that stays without a column adds `forbidden` to the sum.
///
/// A pair whose cost is not below `forbidden`, or not finite, is never assigned. Pairs that are allowed are all that
/// the search looks at, so its time grows with the groups of rows and columns that compete for each other, at worst
/// with rows^2 * columns. Equal inputs give equal results.
/// @param cost  any size, also without rows or columns; values may be negative.
/// @return column of each row, -1 for none.
/// @throws std::invalid_argument if `forbidden` is not finite.
std::vector<int> assign(const Eigen::MatrixXd& cost, double forbidden);

}  // namespace pi_detect
