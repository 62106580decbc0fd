#include "initialization/standstill_detector.h"

#include <algorithm>
#include <cmath>

#include <pi_node/option_check.h>

namespace pi_slam
{

namespace
{

constexpr double LONG_WINDOWS = 4.0;      ///< of the second comparison
constexpr double LONG_FLOW_FACTOR = 2.0;  ///< tracking drifts with the root of time
constexpr double LEAVING_FACTOR = 1.5;    ///< of all bounds, for what stands still already
constexpr int PARTS = 8;                  ///< of the window
constexpr size_t MIN_FEATURES = 10;
constexpr double LONGEST_PAUSE_S = 1.0;

}  // namespace

void StandstillOptions::validate() const
{
  const pi_node::OptionCheck check("standstill");
  check.range("window_s", window_s, 0.1, 5.0);
  check.range("max_flow_px", max_flow_px, 0.05, 5.0);
  check.positive("max_gyro_deviation", max_gyro_deviation);
  check.positive("max_accel_deviation", max_accel_deviation);
  check.positive("max_rate", max_rate);
}

StandstillDetector::StandstillDetector(const ImuModel& model, const StandstillOptions& options)
  : model_(model), options_(options)
{
  model_.validate();
  options_.validate();
}

void StandstillDetector::reset()
{
  pairs_.clear();
  still_ = false;
  flow_px_ = -1.0;
}

bool StandstillDetector::update(const FrameFeatures& features, const ImuBuffer& imu, const ImuBias& bias)
{
  if (!options_.enabled)
  {
    return false;
  }
  const int64_t stamp_ns = features.stamp_ns;
  if (!pairs_.empty() && (stamp_ns <= last_ns_ || stamp_ns - last_ns_ > std::llround(1e9 * LONGEST_PAUSE_S)))
  {
    reset();
  }
  last_ns_ = stamp_ns;

  const double slack = still_ ? LEAVING_FACTOR : 1.0;
  const Pair* reference = pairBefore(stamp_ns - std::llround(1e9 * options_.window_s));
  flow_px_ = reference != nullptr ? flowSince(*reference, features) : -1.0;
  bool calm = flow_px_ >= 0.0 && flow_px_ <= slack * options_.max_flow_px && imuIsCalm(stamp_ns, imu, bias, slack);
  const Pair* earlier = pairBefore(stamp_ns - std::llround(1e9 * (LONG_WINDOWS * options_.window_s)));
  if (calm && earlier != nullptr && (!still_ || earlier->stamp_ns >= since_ns_))
  {
    // Features that are no longer seen do not count.
    calm = flowSince(*earlier, features) <= slack * LONG_FLOW_FACTOR * options_.max_flow_px;
  }
  if (calm && !still_)
  {
    since_ns_ = reference->stamp_ns;
  }
  still_ = calm;

  if (pairs_.empty() || stamp_ns - pairs_.back().stamp_ns >= std::llround(1e9 * (options_.window_s / PARTS)))
  {
    const int64_t oldest_ns = stamp_ns - std::llround(1e9 * (LONG_WINDOWS * options_.window_s));
    std::vector<Track> tracks;
    // The last pair at or before the oldest time stays.
    while (pairs_.size() > 1 && pairs_[1].stamp_ns <= oldest_ns)
    {
      tracks = std::move(pairs_.front().tracks);
      pairs_.pop_front();
    }
    tracks.clear();
    for (const FeatureObservation& feature : features.features)
    {
      tracks.push_back(
          {feature.id, {feature.seen[LEFT], feature.seen[RIGHT]}, {feature.pixel[LEFT], feature.pixel[RIGHT]}});
    }
    pairs_.push_back({stamp_ns, std::move(tracks)});
  }
  return still_;
}

const StandstillDetector::Pair* StandstillDetector::pairBefore(int64_t stamp_ns) const
{
  const auto after = std::upper_bound(pairs_.begin(), pairs_.end(), stamp_ns,
                                      [](int64_t stamp, const Pair& pair) { return stamp < pair.stamp_ns; });
  return after == pairs_.begin() ? nullptr : &*(after - 1);
}

double StandstillDetector::flowSince(const Pair& pair, const FrameFeatures& features)
{
  distances_.clear();
  auto track = pair.tracks.begin();
  for (const FeatureObservation& feature : features.features)
  {
    while (track != pair.tracks.end() && track->id < feature.id)
    {
      ++track;
    }
    if (track == pair.tracks.end())
    {
      break;
    }
    for (const int camera : {LEFT, RIGHT})
    {
      const float distance = (track->pixel[camera] - feature.pixel[camera]).norm();
      if (track->id == feature.id && track->seen[camera] && feature.seen[camera] && std::isfinite(distance))
      {
        distances_.push_back(distance);
        break;
      }
    }
  }
  if (distances_.size() < MIN_FEATURES)
  {
    return -1.0;
  }
  const auto middle = distances_.begin() + static_cast<long>(distances_.size() / 2);
  std::nth_element(distances_.begin(), middle, distances_.end());
  return *middle;
}

bool StandstillDetector::imuIsCalm(int64_t stamp_ns, const ImuBuffer& imu, const ImuBias& bias, double slack) const
{
  const int64_t window_ns = std::llround(1e9 * options_.window_s);
  if (imu.empty() || imu.lastNs() < stamp_ns || imu.firstNs() > stamp_ns - window_ns)
  {
    return false;
  }
  // Five samples in each part, where there are as many.
  const int parts = std::clamp(static_cast<int>(options_.window_s * model_.rate_hz / 5.0), 2, PARTS);
  Eigen::Vector3d w_sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d w_squares = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_squares = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_first = Eigen::Vector3d::Zero();
  for (int i = 0; i < parts; ++i)
  {
    Eigen::Vector3d w, f, w_deviation, f_deviation;
    const int64_t from_ns = stamp_ns - window_ns + i * window_ns / parts;
    if (!imu.statistics(from_ns, from_ns + window_ns / parts, &w, &f, &w_deviation, &f_deviation))
    {
      return false;
    }
    f_first = i == 0 ? f : f_first;
    w -= bias.gyro;
    f -= f_first;  // gravity would cost digits
    w_sum += w;
    w_squares += w.cwiseAbs2();
    f_sum += f;
    f_squares += f.cwiseAbs2();
  }
  const Eigen::Vector3d w_mean = w_sum / parts;
  const Eigen::Vector3d w_deviation = (w_squares / parts - w_mean.cwiseAbs2()).cwiseMax(0.0).cwiseSqrt();
  const Eigen::Vector3d f_deviation = (f_squares / parts - (f_sum / parts).cwiseAbs2()).cwiseMax(0.0).cwiseSqrt();
  // Of a mean over one part.
  const double root = std::sqrt(parts / options_.window_s);
  return w_mean.cwiseAbs().maxCoeff() <= slack * options_.max_rate &&
         w_deviation.maxCoeff() <= slack * options_.max_gyro_deviation + root * model_.gyro_noise_density &&
         f_deviation.maxCoeff() <= slack * options_.max_accel_deviation + root * model_.accel_noise_density;
}

}  // namespace pi_slam
