#include "tracking/sort.h"
#include "tracking/assignment.h"

#include <algorithm>
#include <iterator>

namespace pi_detect
{

std::vector<ObjectTrack> Sort::update(int64_t stamp_ns, const Detections& all)
{
  constexpr double FORBIDDEN = 2.0;
  const double dt_s = 1e-9 * static_cast<double>(stamp_ns - last_stamp_ns_);
  last_stamp_ns_ = stamp_ns;
  Detections detections;
  std::copy_if(all.begin(), all.end(), std::back_inserter(detections),
               [this](const Detection& detection) { return detection.score >= score_; });
  Eigen::MatrixXd cost(static_cast<Eigen::Index>(tracks_.size()), static_cast<Eigen::Index>(detections.size()));
  for (size_t i = 0; i < tracks_.size(); ++i)
  {
    tracks_[i].filter.predict(dt_s);
    ++tracks_[i].misses;
    for (size_t j = 0; j < detections.size(); ++j)
    {
      const double common = overlap(tracks_[i].filter.box(), detections[j].box);
      cost(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = common >= 0.3 ? 1.0 - common : FORBIDDEN;
    }
  }
  const std::vector<int> assigned = assign(cost, FORBIDDEN);
  std::vector<bool> taken(detections.size(), false);
  for (size_t i = 0; i < assigned.size(); ++i)
  {
    if (assigned[i] >= 0)
    {
      taken[static_cast<size_t>(assigned[i])] = true;
      tracks_[i].filter.correct(detections[static_cast<size_t>(assigned[i])].box);
      tracks_[i].misses = 0;
      ++tracks_[i].track.hits;
      tracks_[i].track.last_seen_ns = stamp_ns;
    }
  }
  for (size_t j = 0; j < detections.size(); ++j)
  {
    if (!taken[j])
    {
      tracks_.push_back({BoxFilter(detections[j].box, BoxFilterNoise()), {}, 0});
      tracks_.back().track.id = ++last_id_;
      tracks_.back().track.hits = 1;
      tracks_.back().track.last_seen_ns = stamp_ns;
    }
  }
  tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(),
                               [this](const Followed& followed) { return followed.misses > max_misses_; }),
                tracks_.end());
  std::vector<ObjectTrack> result;
  for (Followed& followed : tracks_)
  {
    followed.track.box = followed.filter.box();
    if (followed.track.hits >= 3)
    {
      result.push_back(followed.track);
    }
  }
  return result;
}

}  // namespace pi_detect
