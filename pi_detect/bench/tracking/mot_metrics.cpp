#include "tracking/mot_metrics.h"
#include "tracking/assignment.h"

#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

namespace pi_detect
{
namespace
{

void checkIds(const std::vector<IdentifiedBox>& boxes, const char* what)
{
  std::set<int64_t> ids;
  for (const IdentifiedBox& box : boxes)
  {
    if (!ids.insert(box.id).second)
    {
      throw std::invalid_argument("id " + std::to_string(box.id) + " is twice among the " + what + " of one picture");
    }
  }
}

}  // namespace

class MotEvaluation::Implementation
{
public:
  explicit Implementation(double min_overlap) : min_overlap_(min_overlap)
  {
    if (!(min_overlap > 0.0 && min_overlap <= 1.0))
    {
      throw std::invalid_argument("min_overlap = " + std::to_string(min_overlap) + ", must be in (0, 1]");
    }
  }

  void add(const std::vector<IdentifiedBox>& truth, const std::vector<IdentifiedBox>& tracks,
           const std::vector<Box>& ignored)
  {
    checkIds(truth, "true boxes");
    checkIds(tracks, "tracks");
    ++sum_.pictures;
    sum_.truth_boxes += static_cast<int>(truth.size());
    const std::vector<int> track_of_truth = match(truth, tracks);
    std::vector<bool> matched(tracks.size(), false);
    for (size_t i = 0; i < truth.size(); ++i)
    {
      count(truth[i], track_of_truth[i] < 0 ? nullptr : &tracks[static_cast<size_t>(track_of_truth[i])]);
      if (track_of_truth[i] >= 0)
      {
        matched[static_cast<size_t>(track_of_truth[i])] = true;
      }
    }
    for (size_t i = 0; i < tracks.size(); ++i)
    {
      if (!matched[i] && isIgnored(tracks[i].box, ignored))
      {
        continue;
      }
      ++sum_.track_boxes;
      sum_.false_positives += matched[i] ? 0 : 1;
      for (const IdentifiedBox& object : truth)
      {
        if (overlap(object.box, tracks[i].box) >= min_overlap_)
        {
          ++together_[{object.id, tracks[i].id}];
        }
      }
    }
  }

  MotMetrics metrics() const
  {
    MotMetrics result = sum_;
    if (sum_.truth_boxes > 0)
    {
      result.mota = 1.0 - static_cast<double>(sum_.misses + sum_.false_positives + sum_.switches) / sum_.truth_boxes;
      result.recall = static_cast<double>(sum_.matches) / sum_.truth_boxes;
    }
    if (sum_.track_boxes > 0)
    {
      result.precision = static_cast<double>(sum_.matches) / sum_.track_boxes;
    }
    if (sum_.matches > 0)
    {
      result.motp = sum_overlap_ / sum_.matches;
    }
    if (sum_.truth_boxes + sum_.track_boxes > 0)
    {
      result.idf1 = 2.0 * identityMatches() / (sum_.truth_boxes + sum_.track_boxes);
    }
    return result;
  }

private:
  struct Object
  {
    bool ever_matched = false;
    bool matched_last = false;  ///< in the last picture that showed it
    int64_t track_id = 0;       ///< of the last match
  };

  /// Index of the track of each true box, or -1.
  std::vector<int> match(const std::vector<IdentifiedBox>& truth, const std::vector<IdentifiedBox>& tracks) const
  {
    std::vector<int> result(truth.size(), -1);
    std::vector<bool> taken(tracks.size(), false);
    for (size_t i = 0; i < truth.size(); ++i)
    {
      const auto known = last_pairs_.find(truth[i].id);
      for (size_t j = 0; known != last_pairs_.end() && j < tracks.size(); ++j)
      {
        if (tracks[j].id == known->second && overlap(truth[i].box, tracks[j].box) >= min_overlap_)
        {
          result[i] = static_cast<int>(j);
          taken[j] = true;
        }
      }
    }
    // Any pair that is allowed is better than none: matches are as many as can be, then overlap counts.
    const double forbidden = 2.0 * static_cast<double>(truth.size() + 1);
    Eigen::MatrixXd cost = Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(truth.size()),
                                                     static_cast<Eigen::Index>(tracks.size()), forbidden);
    for (size_t i = 0; i < truth.size(); ++i)
    {
      for (size_t j = 0; j < tracks.size(); ++j)
      {
        const double common = overlap(truth[i].box, tracks[j].box);
        if (result[i] < 0 && !taken[j] && common >= min_overlap_)
        {
          cost(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = 1.0 - common;
        }
      }
    }
    const std::vector<int> rest = assign(cost, forbidden);
    for (size_t i = 0; i < truth.size(); ++i)
    {
      result[i] = result[i] >= 0 ? result[i] : rest[i];
    }
    return result;
  }

  void count(const IdentifiedBox& truth, const IdentifiedBox* track)
  {
    Object& object = objects_[truth.id];
    if (track == nullptr)
    {
      ++sum_.misses;
      object.matched_last = false;
      last_pairs_.erase(truth.id);
      return;
    }
    ++sum_.matches;
    sum_overlap_ += overlap(truth.box, track->box);
    if (object.ever_matched)
    {
      sum_.switches += object.track_id != track->id ? 1 : 0;
      sum_.fragments += object.matched_last ? 0 : 1;
    }
    object = {true, true, track->id};
    last_pairs_[truth.id] = track->id;
  }

  static bool isIgnored(const Box& box, const std::vector<Box>& ignored)
  {
    for (const Box& region : ignored)
    {
      if (intersection(box, region) > 0.5F * box.area())
      {
        return true;
      }
    }
    return false;
  }

  /// IDTP: boxes that agree when each true object has one track for the whole time, chosen for the largest sum.
  double identityMatches() const
  {
    std::map<int64_t, Eigen::Index> rows;
    std::map<int64_t, Eigen::Index> columns;
    for (const auto& [pair, pictures] : together_)
    {
      rows.emplace(pair.first, static_cast<Eigen::Index>(rows.size()));
      columns.emplace(pair.second, static_cast<Eigen::Index>(columns.size()));
    }
    Eigen::MatrixXd cost =
        Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(rows.size()), static_cast<Eigen::Index>(columns.size()));
    for (const auto& [pair, pictures] : together_)
    {
      cost(rows.at(pair.first), columns.at(pair.second)) = -pictures;
    }
    const std::vector<int> assigned = assign(cost, 0.0);
    double sum = 0.0;
    for (size_t row = 0; row < assigned.size(); ++row)
    {
      sum -= assigned[row] < 0 ? 0.0 : cost(static_cast<Eigen::Index>(row), assigned[row]);
    }
    return sum;
  }

  const double min_overlap_;
  MotMetrics sum_;
  double sum_overlap_ = 0.0;
  std::map<int64_t, Object> objects_;
  std::map<int64_t, int64_t> last_pairs_;                ///< true object to track, of the last picture with it
  std::map<std::pair<int64_t, int64_t>, int> together_;  ///< pictures in which true object and track overlap
};

MotEvaluation::MotEvaluation(double min_overlap) : implementation_(std::make_unique<Implementation>(min_overlap)) {}

MotEvaluation::~MotEvaluation() = default;

void MotEvaluation::add(const std::vector<IdentifiedBox>& truth, const std::vector<IdentifiedBox>& tracks,
                        const std::vector<Box>& ignored)
{
  implementation_->add(truth, tracks, ignored);
}

MotMetrics MotEvaluation::metrics() const
{
  return implementation_->metrics();
}

}  // namespace pi_detect
