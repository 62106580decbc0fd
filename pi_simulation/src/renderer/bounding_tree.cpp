#include "renderer/bounding_tree.h"

#include <algorithm>
#include <numeric>

namespace pi_simulation::synthetic
{

BoundingTree::BoundingTree(const std::vector<Bounds>& primitives)
{
  std::vector<int32_t> order(primitives.size());
  std::iota(order.begin(), order.end(), 0);
  if (!order.empty())
  {
    build(primitives, order.data(), order.data() + order.size());
  }
}

void BoundingTree::build(const std::vector<Bounds>& primitives, int32_t* begin, int32_t* end)
{
  const size_t index = nodes_.size();
  nodes_.emplace_back();
  Bounds all;
  for (const int32_t* i = begin; i != end; ++i)
  {
    all.add(primitives[static_cast<size_t>(*i)]);
  }
  nodes_[index].bounds = all;
  if (end - begin == 1)
  {
    nodes_[index].leaf = *begin;
    return;
  }
  Eigen::Index axis = 0;
  (all.high - all.low).maxCoeff(&axis);
  int32_t* middle = begin + (end - begin) / 2;
  const auto center = [&](int32_t i)
  { return primitives[static_cast<size_t>(i)].low[axis] + primitives[static_cast<size_t>(i)].high[axis]; };
  // Ties are broken by index, for the same tree on every machine.
  std::sort(begin, end, [&](int32_t a, int32_t b) { return center(a) != center(b) ? center(a) < center(b) : a < b; });
  build(primitives, begin, middle);
  nodes_[index].right = static_cast<int32_t>(nodes_.size());
  build(primitives, middle, end);
}

}  // namespace pi_simulation::synthetic
