#include <pi_node/ros/recent_values.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace pi_node
{

RecentValues::RecentValues(size_t capacity) : capacity_(capacity) {}

void RecentValues::add(double value)
{
  if (values_.size() < capacity_)
  {
    values_.push_back(value);
    return;
  }
  values_[next_] = value;
  next_ = (next_ + 1) % capacity_;
}

void RecentValues::clear()
{
  values_.clear();
  next_ = 0;
}

double RecentValues::mean() const
{
  return values_.empty() ? 0.0
                         : std::accumulate(values_.begin(), values_.end(), 0.0) / static_cast<double>(values_.size());
}

double RecentValues::quantile(double part) const
{
  if (values_.empty())
  {
    return 0.0;
  }
  std::vector<double> sorted = values_;
  const auto rank = static_cast<size_t>(std::ceil(part * static_cast<double>(sorted.size())));
  const auto element = sorted.begin() + static_cast<std::ptrdiff_t>(std::clamp<size_t>(rank, 1, sorted.size()) - 1);
  std::nth_element(sorted.begin(), element, sorted.end());
  return *element;
}

}  // namespace pi_node
