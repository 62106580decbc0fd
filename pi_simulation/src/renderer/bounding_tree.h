#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace pi_simulation::synthetic
{

/// Axis-aligned box [m].
struct Bounds
{
  Eigen::Vector3f low = Eigen::Vector3f::Constant(1e30f);
  Eigen::Vector3f high = Eigen::Vector3f::Constant(-1e30f);

  void add(const Bounds& other)
  {
    low = low.cwiseMin(other.low);
    high = high.cwiseMax(other.high);
  }
};

/// Bounding-volume hierarchy with one primitive per leaf, split at the median of the longest axis. Built once, then
/// read by any thread.
class BoundingTree
{
public:
  struct Node
  {
    Bounds bounds;
    int32_t right = 0;  ///< index of the second child, the first follows its parent; 0 for a leaf
    int32_t leaf = 0;   ///< index of the primitive
  };

  BoundingTree() = default;
  explicit BoundingTree(const std::vector<Bounds>& primitives);

  /// Root first; empty if there is no primitive.
  const std::vector<Node>& nodes() const { return nodes_; }

private:
  void build(const std::vector<Bounds>& primitives, int32_t* begin, int32_t* end);

  std::vector<Node> nodes_;
};

}  // namespace pi_simulation::synthetic
