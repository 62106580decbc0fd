#pragma once

#include <pi_runtime/kernels/hamming.h>

#include <memory>
#include <vector>

#include "map/feature_set.h"

namespace pi_runtime
{
class Runtime;
}

namespace pi_slam::map
{

struct DescriptorMatch
{
  uint32_t query = 0;
  uint32_t train = 0;
  int distance = 0;  ///< bits
};

/// Pairs of features that are each other's nearest, by the kernels of pi_runtime: called directly, or as tasks of a
/// runtime. A task that fails is done here instead. Not thread safe.
class DescriptorMatcher
{
public:
  /// @param runtime  null: direct calls.
  explicit DescriptorMatcher(std::shared_ptr<pi_runtime::Runtime> runtime = nullptr);
  ~DescriptorMatcher();

  /// @return by increasing distance.
  std::vector<DescriptorMatch> match(const FeatureSet& queries, const FeatureSet& trains, int max_distance);

private:
  void nearest(const FeatureSet& queries, const FeatureSet& trains,
               std::vector<pi_runtime::kernels::HammingMatch>* matches);

  std::shared_ptr<pi_runtime::Runtime> runtime_;
  pi_runtime::CodeletPtr hamming_;
  std::vector<pi_runtime::kernels::HammingMatch> forward_;
  std::vector<pi_runtime::kernels::HammingMatch> backward_;
};

}  // namespace pi_slam::map
