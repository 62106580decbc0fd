#include <pi_detect/object_tracker.h>
#include <pi_node/option_check.h>
#include "tracking/assignment.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "tracking/box_filter.h"

namespace pi_detect
{
namespace
{

// Found by measurement (bench_tracking) on recordings of walking people.
constexpr double WEAK_OVERLAP = 0.3;        // of a weak detection and the predicted box, without margin
constexpr double OTHER_CLASS = 0.1;         // taken from the overlap if the classes differ
constexpr float COVERED_SAME_CLASS = 0.5F;  // part of the smaller box: two detections of one object
constexpr float COVERED_ANY_CLASS = 0.8F;   // overlap: one object with two labels
constexpr int MISSES_UNCONFIRMED = 2;       // pictures in a row that an unconfirmed track survives
constexpr double VOTE_FADES = 0.95;         // weight of older votes per new one

Box grown(const Box& box, double margin)
{
  const float x = static_cast<float>(margin) * box.width();
  const float y = static_cast<float>(margin) * box.height();
  return {box.x1 - x, box.y1 - y, box.x2 + x, box.y2 + y};
}

bool isUsable(const Detection& detection, double low_score)
{
  const Box& box = detection.box;
  return detection.score >= low_score && std::isfinite(box.area()) && box.width() > 0.0F && box.height() > 0.0F;
}

/// Whether both are detections of one object.
bool isSameObject(const Detection& a, const Detection& b)
{
  const float smaller = std::min(a.box.area(), b.box.area());
  return (a.class_id == b.class_id && intersection(a.box, b.box) > COVERED_SAME_CLASS * smaller) ||
         overlap(a.box, b.box) > COVERED_ANY_CLASS;
}

enum class Compare
{
  PREDICTED,          ///< the predicted box, with margin
  PREDICTED_CLOSELY,  ///< the predicted box as it is
  LAST_SEEN,          ///< the box of the last detection, with margin
};

}  // namespace

struct FollowedObject
{
  FollowedObject(const Detection& detection, int64_t stamp_ns) : filter(detection.box, BoxFilterNoise())
  {
    track.first_seen_ns = stamp_ns;
    count(detection, stamp_ns);
  }

  void see(const Detection& detection, int64_t stamp_ns)
  {
    filter.correct(detection.box);
    count(detection, stamp_ns);
  }

  void count(const Detection& detection, int64_t stamp_ns)
  {
    seen_box = detection.box;
    misses = 0;
    ++track.hits;
    track.score = detection.score;
    track.last_seen_ns = stamp_ns;
    for (auto& vote : votes)
    {
      vote.second *= VOTE_FADES;
    }
    votes[detection.class_id] += static_cast<double>(detection.score);
    track.class_id =
        std::max_element(votes.begin(), votes.end(), [](const auto& a, const auto& b) { return a.second < b.second; })
            ->first;
  }

  BoxFilter filter;
  ObjectTrack track;  ///< id 0: not confirmed yet; box and velocity are those of the filter
  Box seen_box;       ///< of the last detection
  std::map<int, double> votes;
  int misses = 0;  ///< pictures since the last detection
};

void ObjectTrackerOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("high_score", high_score, 0.0, 1.0);
  check.range("low_score", low_score, 0.0, high_score);
  check.range("min_overlap", min_overlap, 0.01, 0.99);
  check.range("margin", margin, 0.0, 2.0);
  check.range("time_to_live_s", time_to_live_s, 0.0, 60.0);
  check.range("confirm_hits", confirm_hits, 1, 100);
  check.range("max_gap_s", max_gap_s, 0.01, 60.0);
  check.range("max_objects", max_objects, 1, 2000);
}

class ObjectTracker::Implementation
{
public:
  explicit Implementation(const ObjectTrackerOptions& options) : options_(options) { options_.validate(); }

  std::vector<ObjectTrack> update(int64_t stamp_ns, const Detections& detections)
  {
    if (started_ && !advance(stamp_ns))
    {
      return publish();
    }
    started_ = true;
    last_stamp_ns_ = stamp_ns;

    choose(detections);
    std::vector<size_t> confirmed;
    std::vector<size_t> unconfirmed;
    for (size_t i = 0; i < followed_.size(); ++i)
    {
      ++followed_[i].misses;  // until it is seen
      (followed_[i].track.id > 0 ? confirmed : unconfirmed).push_back(i);
    }
    assignRound(Compare::PREDICTED, &confirmed, &strong_);
    std::vector<size_t> seen_before;
    std::vector<size_t> lost;
    for (const size_t i : confirmed)
    {
      (followed_[i].misses == 1 ? seen_before : lost).push_back(i);
    }
    assignRound(Compare::PREDICTED_CLOSELY, &seen_before, &weak_);
    lost.insert(lost.end(), seen_before.begin(), seen_before.end());
    assignRound(Compare::LAST_SEEN, &lost, &strong_);
    assignRound(Compare::PREDICTED, &unconfirmed, &strong_);
    beginTracks();
    endTracks();
    return publish();
  }

  void clear()
  {
    followed_.clear();
    started_ = false;
  }

private:
  /// Predicts to a stamp. @return false if the picture is to be left out.
  bool advance(int64_t stamp_ns)
  {
    const double dt_s = 1e-9 * static_cast<double>(stamp_ns - last_stamp_ns_);
    if (std::abs(dt_s) > options_.max_gap_s)
    {
      followed_.clear();
      return true;
    }
    if (dt_s <= 0.0)
    {
      return false;
    }
    for (FollowedObject& followed : followed_)
    {
      followed.filter.predict(dt_s);
    }
    return true;
  }

  void choose(const Detections& detections)
  {
    strong_.clear();
    weak_.clear();
    seen_.clear();
    std::vector<const Detection*> usable;
    for (const Detection& detection : detections)
    {
      if (isUsable(detection, options_.low_score))
      {
        usable.push_back(&detection);
      }
    }
    std::stable_sort(usable.begin(), usable.end(),
                     [](const Detection* a, const Detection* b) { return a->score > b->score; });
    usable.resize(std::min(usable.size(), static_cast<size_t>(options_.max_objects)));
    for (const Detection* detection : usable)
    {
      (detection->score >= options_.high_score ? strong_ : weak_).push_back(*detection);
    }
  }

  /// Cost of a detection as the next one of a track: below 1, or FORBIDDEN.
  double costOf(Compare compare, const FollowedObject& followed, const Box& box, const Detection& detection) const
  {
    const bool closely = compare == Compare::PREDICTED_CLOSELY;
    double common = closely ? overlap(box, detection.box) : overlap(box, grown(detection.box, options_.margin));
    if (followed.track.class_id != detection.class_id)
    {
      common -= OTHER_CLASS;
    }
    return common >= (closely ? WEAK_OVERLAP : options_.min_overlap) ? 1.0 - common : FORBIDDEN;
  }

  /// Takes the tracks that are seen and their detections out of the lists.
  void assignRound(Compare compare, std::vector<size_t>* tracks, Detections* detections)
  {
    if (tracks->empty() || detections->empty())
    {
      return;
    }
    Eigen::MatrixXd cost(static_cast<Eigen::Index>(tracks->size()), static_cast<Eigen::Index>(detections->size()));
    for (Eigen::Index i = 0; i < cost.rows(); ++i)
    {
      const FollowedObject& followed = followed_[(*tracks)[static_cast<size_t>(i)]];
      const Box box = compare == Compare::LAST_SEEN ? followed.seen_box : followed.filter.box();
      const Box compared = compare == Compare::PREDICTED_CLOSELY ? box : grown(box, options_.margin);
      for (Eigen::Index j = 0; j < cost.cols(); ++j)
      {
        cost(i, j) = costOf(compare, followed, compared, (*detections)[static_cast<size_t>(j)]);
      }
    }
    const std::vector<int> assigned = assign(cost, FORBIDDEN);
    std::vector<bool> taken(detections->size(), false);
    std::vector<size_t> tracks_left;
    for (size_t i = 0; i < tracks->size(); ++i)
    {
      if (assigned[i] < 0)
      {
        tracks_left.push_back((*tracks)[i]);
        continue;
      }
      const size_t j = static_cast<size_t>(assigned[i]);
      taken[j] = true;
      followed_[(*tracks)[i]].see((*detections)[j], last_stamp_ns_);
      seen_.push_back((*detections)[j]);
    }
    Detections detections_left;
    for (size_t j = 0; j < detections->size(); ++j)
    {
      if (!taken[j])
      {
        detections_left.push_back((*detections)[j]);
      }
    }
    *tracks = std::move(tracks_left);
    *detections = std::move(detections_left);
  }

  void beginTracks()
  {
    for (const Detection& detection : strong_)
    {
      const bool known = std::any_of(seen_.begin(), seen_.end(),
                                     [&detection](const Detection& other) { return isSameObject(detection, other); });
      if (!known && followed_.size() < static_cast<size_t>(options_.max_objects))
      {
        followed_.emplace_back(detection, last_stamp_ns_);
        seen_.push_back(detection);
      }
    }
  }

  void endTracks()
  {
    followed_.erase(std::remove_if(followed_.begin(), followed_.end(),
                                   [this](const FollowedObject& followed)
                                   {
                                     const double age_s =
                                         1e-9 * static_cast<double>(last_stamp_ns_ - followed.track.last_seen_ns);
                                     return age_s > options_.time_to_live_s ||
                                            (followed.track.id == 0 && followed.misses > MISSES_UNCONFIRMED);
                                   }),
                    followed_.end());
  }

  std::vector<ObjectTrack> publish()
  {
    std::vector<ObjectTrack> tracks;
    for (FollowedObject& followed : followed_)
    {
      if (followed.track.hits < options_.confirm_hits)
      {
        continue;
      }
      if (followed.track.id == 0)
      {
        followed.track.id = ++last_id_;
      }
      followed.track.box = followed.filter.box();
      followed.track.velocity_x = static_cast<float>(followed.filter.velocityX());
      followed.track.velocity_y = static_cast<float>(followed.filter.velocityY());
      tracks.push_back(followed.track);
    }
    std::sort(tracks.begin(), tracks.end(), [](const ObjectTrack& a, const ObjectTrack& b) { return a.id < b.id; });
    return tracks;
  }

  static constexpr double FORBIDDEN = 2.0;  ///< two good pairs are better than one very good

  const ObjectTrackerOptions options_;
  std::vector<FollowedObject> followed_;
  bool started_ = false;
  int64_t last_stamp_ns_ = 0;
  int64_t last_id_ = 0;

  // Of the picture in work.
  Detections strong_;
  Detections weak_;
  Detections seen_;  ///< that continued or began a track
};

ObjectTracker::ObjectTracker(const ObjectTrackerOptions& options)
  : implementation_(std::make_unique<Implementation>(options))
{
}

ObjectTracker::~ObjectTracker() = default;

std::vector<ObjectTrack> ObjectTracker::update(int64_t stamp_ns, const Detections& detections)
{
  return implementation_->update(stamp_ns, detections);
}

void ObjectTracker::clear()
{
  implementation_->clear();
}

}  // namespace pi_detect
