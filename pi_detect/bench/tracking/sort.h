#pragma once

#include <pi_detect/object_tracker.h>

#include <cstdint>
#include <vector>

#include "tracking/box_filter.h"

namespace pi_detect
{

/// The baseline, SORT (Bewley et al. 2016): one round of detections from a score on, predicted boxes must overlap by
/// 0.3, tracks end after more than some pictures without detection. Boxes are filtered as by ObjectTracker.
class Sort
{
public:
  Sort(double score, int max_misses) : score_(score), max_misses_(max_misses) {}

  std::vector<ObjectTrack> update(int64_t stamp_ns, const Detections& all);

private:
  struct Followed
  {
    BoxFilter filter;
    ObjectTrack track;
    int misses;
  };

  const double score_;
  const int max_misses_;
  std::vector<Followed> tracks_;
  int64_t last_stamp_ns_ = 0;
  int64_t last_id_ = 0;
};

}  // namespace pi_detect
