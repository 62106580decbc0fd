#include <pi_detect/object_tracker.h>
#include <pi_node/option_check.h>
#include "tracking/assignment.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "tracking/box_filter.h"
#include "tracking/box_look.h"

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
// Not critical: half and double change less than a single person who is confused does.
constexpr float COVERED_LOOK = 0.2F;  // part of a box that others may cover: its sides, which do not count in its look
constexpr float NEW_LOOK = 0.1F;      // weight of the newest look: a second at 10 Hz, more than a step

Box grown(const Box& box, double margin)
{
  const float x = static_cast<float>(margin) * box.width();
  const float y = static_cast<float>(margin) * box.height();
  return {box.x1 - x, box.y1 - y, box.x2 + x, box.y2 + y};
}

Eigen::Vector2d centreOf(const Box& box)
{
  return {0.5 * (static_cast<double>(box.x1) + box.x2), 0.5 * (static_cast<double>(box.y1) + box.y2)};
}

/// The box through whose sides' middles the moved ones go, upright again.
Box movedBox(const Box& box, const PictureMotion& motion)
{
  const Eigen::Vector2d centre = centreOf(box);
  const Eigen::Vector2d left = motion({box.x1, centre.y()});
  const Eigen::Vector2d right = motion({box.x2, centre.y()});
  const Eigen::Vector2d top = motion({centre.x(), box.y1});
  const Eigen::Vector2d bottom = motion({centre.x(), box.y2});
  const Eigen::Vector2d middle = 0.25 * (left + right + top + bottom);
  const Eigen::Vector2d half(0.5 * (right - left).norm(), 0.5 * (bottom - top).norm());
  return {static_cast<float>(middle.x() - half.x()), static_cast<float>(middle.y() - half.y()),
          static_cast<float>(middle.x() + half.x()), static_cast<float>(middle.y() + half.y())};
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

/// A detection of the picture in work.
struct Candidate
{
  Detection detection;
  BoxLook look;
  bool covered = false;  ///< in part by other detections: its look is not its own
};

struct FollowedObject
{
  FollowedObject(const Candidate& candidate, int64_t stamp_ns)
    : filter(candidate.detection.box, BoxFilterNoise()), look(candidate.look)
  {
    track.first_seen_ns = stamp_ns;
    count(candidate.detection, stamp_ns);
  }

  void see(const Candidate& candidate, int64_t stamp_ns)
  {
    filter.correct(candidate.detection.box);
    if (!candidate.covered)
    {
      look.blend(candidate.look, NEW_LOOK);
    }
    count(candidate.detection, stamp_ns);
  }

  /// The camera moved, in a time.
  void move(const PictureMotion& motion, double dt_s)
  {
    const Box box = filter.box();
    const Box moved = movedBox(box, motion);
    if (!(std::isfinite(moved.area()) && moved.area() > 0.0F))
    {
      return;
    }
    const Eigen::Vector2d shift = centreOf(moved) - centreOf(box);
    filter.shift(shift, std::sqrt(moved.area() / box.area()));
    picture_velocity = shift / dt_s;
    seen_box = movedBox(seen_box, motion);
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
  BoxLook look;
  Eigen::Vector2d picture_velocity = Eigen::Vector2d::Zero();  ///< of the still surroundings at its place [px/s]
  ObjectTrack track;  ///< id 0: not confirmed yet; box and velocity are those of the filter
  Box seen_box;       ///< of the last detection
  std::map<int, double> votes;
  int misses = 0;  ///< pictures since the last detection
};

void ObjectTrackerOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("high_score", scores.high, 0.0, 1.0);
  check.range("low_score", scores.low, 0.0, scores.high);
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
  explicit Implementation(const ObjectTrackerOptions& options) { restart(options); }

  std::vector<ObjectTrack> update(int64_t stamp_ns, const Detections& detections, const TrackerView& view)
  {
    if (started_ && !advance(stamp_ns, view.motion))
    {
      return publish();
    }
    started_ = true;
    last_stamp_ns_ = stamp_ns;

    choose(detections, view.picture);
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

  void restart(const ObjectTrackerOptions& options)
  {
    options.validate();
    options_ = options;
    followed_.clear();
    started_ = false;
  }

private:
  /// Predicts to a stamp. @return false if the picture is to be left out.
  bool advance(int64_t stamp_ns, const PictureMotion& motion)
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
      followed.picture_velocity.setZero();
      if (motion)
      {
        followed.move(motion, dt_s);
      }
      followed.filter.predict(dt_s);
    }
    return true;
  }

  void choose(const Detections& detections, const PictureView* picture)
  {
    strong_.clear();
    weak_.clear();
    seen_.clear();
    std::vector<const Detection*> usable;
    for (const Detection& detection : detections)
    {
      if (isUsable(detection, options_.scores.low))
      {
        usable.push_back(&detection);
      }
    }
    std::stable_sort(usable.begin(), usable.end(),
                     [](const Detection* a, const Detection* b) { return a->score > b->score; });
    usable.resize(std::min(usable.size(), static_cast<size_t>(options_.max_objects)));
    for (const Detection* detection : usable)
    {
      Candidate candidate;
      candidate.detection = *detection;
      if (picture != nullptr)
      {
        candidate.look = BoxLook(*picture, detection->box);
        candidate.covered = std::any_of(usable.begin(), usable.end(),
                                        [detection](const Detection* other) {
                                          return other != detection && intersection(other->box, detection->box) >
                                                                           COVERED_LOOK * detection->box.area();
                                        });
      }
      (detection->score >= options_.scores.high ? strong_ : weak_).push_back(candidate);
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

  /// Where an object has several detections, or a detection several objects, their looks count as much as their
  /// places.
  void compareLooks(const std::vector<size_t>& tracks, const std::vector<Candidate>& detections,
                    Eigen::MatrixXd* cost) const
  {
    const Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> allowed = cost->array() < FORBIDDEN;
    const Eigen::ArrayXi per_row = allowed.cast<int>().rowwise().sum();
    const Eigen::ArrayXi per_column = allowed.cast<int>().colwise().sum();
    for (Eigen::Index i = 0; i < cost->rows(); ++i)
    {
      for (Eigen::Index j = 0; j < cost->cols(); ++j)
      {
        if (allowed(i, j) && (per_row(i) > 1 || per_column(j) > 1))
        {
          const BoxLook& look = followed_[tracks[static_cast<size_t>(i)]].look;
          (*cost)(i, j) += 1.0 - look.similarity(detections[static_cast<size_t>(j)].look);
        }
      }
    }
  }

  /// Takes the tracks that are seen and their detections out of the lists.
  void assignRound(Compare compare, std::vector<size_t>* tracks, std::vector<Candidate>* detections)
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
        cost(i, j) = costOf(compare, followed, compared, (*detections)[static_cast<size_t>(j)].detection);
      }
    }
    compareLooks(*tracks, *detections, &cost);
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
      seen_.push_back((*detections)[j].detection);
    }
    std::vector<Candidate> detections_left;
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
    for (const Candidate& candidate : strong_)
    {
      const Detection& detection = candidate.detection;
      const bool known = std::any_of(seen_.begin(), seen_.end(),
                                     [&detection](const Detection& other) { return isSameObject(detection, other); });
      if (!known && followed_.size() < static_cast<size_t>(options_.max_objects))
      {
        followed_.emplace_back(candidate, last_stamp_ns_);
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
      followed.track.velocity_x = static_cast<float>(followed.filter.velocityX() + followed.picture_velocity.x());
      followed.track.velocity_y = static_cast<float>(followed.filter.velocityY() + followed.picture_velocity.y());
      tracks.push_back(followed.track);
    }
    std::sort(tracks.begin(), tracks.end(), [](const ObjectTrack& a, const ObjectTrack& b) { return a.id < b.id; });
    return tracks;
  }

  /// Two good pairs are better than one very good: above all costs of place (1) and look (1).
  static constexpr double FORBIDDEN = 2.0;

  ObjectTrackerOptions options_;
  std::vector<FollowedObject> followed_;
  bool started_ = false;
  int64_t last_stamp_ns_ = 0;
  int64_t last_id_ = 0;

  // Of the picture in work.
  std::vector<Candidate> strong_;
  std::vector<Candidate> weak_;
  Detections seen_;  ///< that continued or began a track
};

ObjectTracker::ObjectTracker(const ObjectTrackerOptions& options)
  : implementation_(std::make_unique<Implementation>(options))
{
}

ObjectTracker::~ObjectTracker() = default;

std::vector<ObjectTrack> ObjectTracker::update(int64_t stamp_ns, const Detections& detections, const TrackerView& view)
{
  return implementation_->update(stamp_ns, detections, view);
}

void ObjectTracker::restart(const ObjectTrackerOptions& options)
{
  implementation_->restart(options);
}

}  // namespace pi_detect
