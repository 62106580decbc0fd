#pragma once

#include <cstddef>
#include <vector>

namespace pi_node
{

/// The newest values of a series, for mean and quantiles. Not thread safe.
class RecentValues
{
public:
  explicit RecentValues(size_t capacity = 500);
  void add(double value);
  bool empty() const { return values_.empty(); }
  void clear();
  double mean() const;  ///< 0 without values
  /// @param part  in [0, 1]: 0.99 gives the value that 99 % do not exceed. 0 without values.
  double quantile(double part) const;

private:
  const size_t capacity_;
  size_t next_ = 0;
  std::vector<double> values_;
};

}  // namespace pi_node
