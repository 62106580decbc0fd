#include <pi_detect/detection.h>

namespace pi_detect
{

void suppressAcrossClasses(float overlap_threshold, Detections* detections)
{
  std::stable_sort(detections->begin(), detections->end(),
                   [](const Detection& a, const Detection& b) { return a.score > b.score; });
  Detections kept;
  kept.reserve(detections->size());
  for (const Detection& candidate : *detections)
  {
    const bool suppressed =
        std::any_of(kept.begin(), kept.end(),
                    [&](const Detection& better) { return overlap(better.box, candidate.box) > overlap_threshold; });
    if (!suppressed)
    {
      kept.push_back(candidate);
    }
  }
  *detections = std::move(kept);
}

}  // namespace pi_detect
