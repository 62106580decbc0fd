#pragma once

#include <cstddef>
#include <cstdint>

#include <pi_runtime/kernels/ssd_postprocess.h>

namespace pi_runtime::kernels
{

/// The work memory of ssd_postprocess, which the kernels of ssd_postprocess.cl divide up in the same way. Keys are
/// score << 32 | ~(class * priors + prior), the score as bits, so that a larger one is a better candidate.
struct SsdWork
{
  float* boxes;     ///< of the detections found so far, not cut at the border: 4 * keep_top_k
  uint64_t* keys;   ///< candidates, as heaps: classes * priors; list i begins at i * priors
  int32_t* counts;  ///< candidates per list: classes
};

inline SsdWork ssdWork(void* memory, const SsdShape& shape)
{
  SsdWork work;
  const auto classes = static_cast<size_t>(shape.classes);
  work.boxes = static_cast<float*>(memory);
  work.keys = reinterpret_cast<uint64_t*>(work.boxes + 4 * static_cast<size_t>(shape.keep_top_k));
  work.counts = reinterpret_cast<int32_t*>(work.keys + classes * static_cast<size_t>(shape.priors));
  return work;
}

/// Confidences (less the highest one of the prior, for softmax) below this cannot reach the score threshold: softmax
/// divides the exponential by a sum that is 1 at least.
float ssdConfidenceBound(const SsdShape& shape);

}  // namespace pi_runtime::kernels
