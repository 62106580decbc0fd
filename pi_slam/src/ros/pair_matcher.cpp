#include "front_end/frame_features.h"

#include <pi_node/durations.h>
#include "ros/pair_matcher.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace pi_slam
{
namespace
{

/// Pictures of one camera that may wait; more come only with stamps that hardly advance.
constexpr size_t MAX_WAITING = 32;
/// Stamps of cameras that run at the same time differ by less [s]; more is a picture that is missing.
constexpr double MAX_MISMATCH_S = 0.02;
/// Likewise, of the time between two pictures: free-running cameras are at most half of it apart.
constexpr double MAX_MISMATCH_PERIODS = 0.75;

}  // namespace

PairMatcher::PairMatcher(double tolerance_s, double wait_s)
  : tolerance_ns_(std::llround(1e9 * tolerance_s)), wait_ns_(std::llround(1e9 * wait_s))
{
}

void PairMatcher::clear()
{
  waiting_[LEFT].clear();
  waiting_[RIGHT].clear();
  passed_ns_ = INT64_MIN;
  newest_ns_ = INT64_MIN;
  last_ns_[LEFT] = last_ns_[RIGHT] = INT64_MIN;
  period_ns_ = INT64_MAX;
}

std::optional<double> PairMatcher::takeMismatch()
{
  const std::optional<double> mismatch = mismatch_s_;
  mismatch_s_.reset();
  return mismatch;
}

void PairMatcher::passOn(int camera, std::vector<PicturePair>* pairs)
{
  std::deque<Picture>& own = waiting_[camera];
  PicturePair pair;
  pair.stamp_ns = own.front().stamp_ns;
  (camera == LEFT ? pair.left : pair.right) = own.front().picture;
  own.pop_front();
  passed_ns_ = pair.stamp_ns;
  ++single_;
  pairs->push_back(std::move(pair));
}

void PairMatcher::add(int camera, int64_t stamp_ns, const cv::Mat& picture, std::vector<PicturePair>* pairs)
{
  std::deque<Picture>& own = waiting_[camera];
  if (stamp_ns <= passed_ns_ || (!own.empty() && stamp_ns <= own.back().stamp_ns))
  {
    ++late_;
    return;
  }
  own.push_back({stamp_ns, picture});
  if (last_ns_[camera] != INT64_MIN)
  {
    period_ns_ = std::min(period_ns_, stamp_ns - last_ns_[camera]);
  }
  last_ns_[camera] = stamp_ns;
  newest_ns_ = std::max(newest_ns_, stamp_ns);
  while (!waiting_[LEFT].empty() && !waiting_[RIGHT].empty())
  {
    const Picture& left = waiting_[LEFT].front();
    const Picture& right = waiting_[RIGHT].front();
    const int64_t difference_ns = left.stamp_ns - right.stamp_ns;
    if (std::abs(difference_ns) > tolerance_ns_)
    {
      // Stamps increase, so the older one's partner cannot come any more.
      const double difference_s = pi_node::seconds(std::abs(difference_ns));
      if (difference_s < std::min(MAX_MISMATCH_S, MAX_MISMATCH_PERIODS * pi_node::seconds(period_ns_)))
      {
        mismatch_s_ = difference_s;
      }
      passOn(difference_ns < 0 ? LEFT : RIGHT, pairs);
      continue;
    }
    passed_ns_ = std::max(left.stamp_ns, right.stamp_ns);
    pairs->push_back({left.stamp_ns, left.picture, right.picture});
    waiting_[LEFT].pop_front();
    waiting_[RIGHT].pop_front();
  }
  const int oldest = waiting_[LEFT].empty() ? RIGHT : LEFT;  // the other one is empty now
  std::deque<Picture>& alone = waiting_[oldest];
  while (!alone.empty() && (newest_ns_ - alone.front().stamp_ns >= wait_ns_ || alone.size() > MAX_WAITING))
  {
    passOn(oldest, pairs);
  }
}

}  // namespace pi_slam
