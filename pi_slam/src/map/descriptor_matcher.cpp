#include "map/descriptor_matcher.h"

#include <pi_runtime/runtime.h>

#include <algorithm>

namespace pi_slam::map
{

namespace kernels = pi_runtime::kernels;
using pi_runtime::Argument;
using pi_runtime::Buffer;

static_assert(kernels::HAMMING_BYTES == DESCRIPTOR_BYTES, "descriptors are those of the kernel");

DescriptorMatcher::DescriptorMatcher(std::shared_ptr<pi_runtime::Runtime> runtime) : runtime_(std::move(runtime))
{
  if (runtime_)
  {
    hamming_ = kernels::hammingCodelet();
  }
}

DescriptorMatcher::~DescriptorMatcher() = default;

void DescriptorMatcher::nearest(const FeatureSet& queries, const FeatureSet& trains,
                                std::vector<kernels::HammingMatch>* matches)
{
  matches->resize(queries.size());
  const kernels::HammingShape shape{static_cast<int32_t>(queries.size()), static_cast<int32_t>(trains.size())};
  if (runtime_)
  {
    const auto query_buffer =
        Buffer::wrap(static_cast<const void*>(queries.descriptors.data()), queries.descriptors.size());
    const auto train_buffer =
        Buffer::wrap(static_cast<const void*>(trains.descriptors.data()), trains.descriptors.size());
    const auto result = Buffer::wrap(matches->data(), matches->size() * sizeof(kernels::HammingMatch));
    pi_runtime::TaskRequest request;
    request.codelet = hamming_;
    request.arguments = {Argument::in(query_buffer), Argument::in(train_buffer), Argument::out(result),
                         Argument::value(shape)};
    request.range = queries.size();
    if (runtime_->submit(std::move(request)).wait().ok())
    {
      result->host(pi_runtime::Access::READ);
      return;
    }
  }
  kernels::matchHamming(queries.descriptors.data(), trains.descriptors.data(), shape, 0, queries.size(),
                        matches->data());
}

std::vector<DescriptorMatch> DescriptorMatcher::match(const FeatureSet& queries, const FeatureSet& trains,
                                                      int max_distance)
{
  std::vector<DescriptorMatch> pairs;
  if (queries.size() == 0 || trains.size() == 0)
  {
    return pairs;
  }
  nearest(queries, trains, &forward_);
  nearest(trains, queries, &backward_);
  for (size_t i = 0; i < queries.size(); ++i)
  {
    const kernels::HammingMatch& match = forward_[i];
    if (match.best >= 0 && match.best_distance <= max_distance &&
        backward_[static_cast<size_t>(match.best)].best == static_cast<int32_t>(i))
    {
      pairs.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(match.best), match.best_distance});
    }
  }
  std::sort(pairs.begin(), pairs.end(),
            [](const DescriptorMatch& a, const DescriptorMatch& b)
            { return a.distance != b.distance ? a.distance < b.distance : a.query < b.query; });
  return pairs;
}

}  // namespace pi_slam::map
