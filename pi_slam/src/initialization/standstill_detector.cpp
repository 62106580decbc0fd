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
constexpr double MOVES_FACTOR = 3.0;      ///< of max_flow_px: what is motion for sure, if it is the picture's
constexpr int PARTS = 8;                  ///< of the window
constexpr size_t MIN_FEATURES = 10;
constexpr double LONGEST_PAUSE_S = 1.0;
constexpr double TOLERANCE_PX = 1.0;     ///< as between two pairs in the tracker, of which a rest has many
constexpr double ROTATION_SIGMA = 0.01;  ///< at most, of what turns while all else says rest [rad]

/// Calls with each feature that both pairs have, as it was and as it is.
template <typename Function>
void forCommon(const FrameFeatures& before, const FrameFeatures& now, const Function& function)
{
  auto was = before.features.begin();
  for (const FeatureObservation& feature : now.features)
  {
    while (was != before.features.end() && was->id < feature.id)
    {
      ++was;
    }
    if (was != before.features.end() && was->id == feature.id)
    {
      function(*was, feature);
    }
  }
}

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

StandstillDetector::StandstillDetector(const StereoCalibration& calibration, const ImuModel& model,
                                       const StandstillOptions& options)
  : model_(model), options_(options), geometry_(calibration), motion_check_(geometry_, TOLERANCE_PX)
{
  model_.validate();
  options_.validate();
}

void StandstillDetector::reset()
{
  pairs_.clear();
  still_ = false;
  crept_ = false;
  picture_moves_since_ns_ = 0;
  flow_px_ = -1.0;
}

bool StandstillDetector::update(const FrameFeatures& features, const ImuBuffer& imu, const ImuBias& bias,
                                std::optional<bool> at_rest)
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
  const FrameFeatures* reference = pairBefore(stamp_ns - std::llround(1e9 * options_.window_s));
  flow_px_ = reference != nullptr ? flowSince(*reference, features) : -1.0;
  bool calm = flow_px_ >= 0.0 && flow_px_ <= slack * options_.max_flow_px && imuIsCalm(stamp_ns, imu, bias, slack);
  if (at_rest)
  {
    const bool moves = flow_px_ > MOVES_FACTOR * options_.max_flow_px;
    calm = *at_rest && reference != nullptr && imuIsCalm(stamp_ns, imu, bias, slack);
    picture_moves_since_ns_ = !calm || !moves ? 0 : picture_moves_since_ns_ == 0 ? stamp_ns : picture_moves_since_ns_;
  }
  const bool calm_now = calm;
  const FrameFeatures* earlier = pairBefore(stamp_ns - std::llround(1e9 * (LONG_WINDOWS * options_.window_s)));
  if (calm && !at_rest && earlier != nullptr && (!still_ || earlier->stamp_ns >= since_ns_))
  {
    // Features that are no longer seen do not count.
    calm = flowSince(*earlier, features) <= slack * LONG_FLOW_FACTOR * options_.max_flow_px;
  }
  if (calm && still_ && at_rest)
  {
    first_ = features;  // the way counts from here on should the wheels cease to tell
  }
  else if (calm && still_)
  {
    const std::optional<double> way_m = wayBetween(first_, features);
    calm = !way_m || *way_m <= CREPT_M;
    if (!way_m)
    {
      first_ = pairs_.front();  // what was seen then is out of sight
    }
  }
  else if (calm)
  {
    calm = at_rest || earlier == nullptr || wayBetween(*earlier, features).value_or(0.0) <= CREEPING_M;
    since_ns_ = reference->stamp_ns;
    first_ = features;
  }
  crept_ = still_ && calm_now && !calm && !at_rest;
  still_ = calm;

  if (pairs_.empty() || stamp_ns - pairs_.back().stamp_ns >= std::llround(1e9 * (options_.window_s / PARTS)))
  {
    const int64_t oldest_ns = stamp_ns - std::llround(1e9 * (LONG_WINDOWS * options_.window_s));
    // The last pair at or before the oldest time stays.
    while (pairs_.size() > 1 && pairs_[1].stamp_ns <= oldest_ns)
    {
      pairs_.pop_front();
    }
    pairs_.push_back(features);
  }
  return still_;
}

const FrameFeatures* StandstillDetector::pairBefore(int64_t stamp_ns) const
{
  const auto after = std::upper_bound(pairs_.begin(), pairs_.end(), stamp_ns,
                                      [](int64_t stamp, const FrameFeatures& pair) { return stamp < pair.stamp_ns; });
  return after == pairs_.begin() ? nullptr : &*(after - 1);
}

/// How far pictures say that the body has gone [m]; nullopt: they do not tell.
std::optional<double> StandstillDetector::wayBetween(const FrameFeatures& pair, const FrameFeatures& features)
{
  moved_.clear();
  forCommon(pair, features,
            [this](const FeatureObservation& was, const FeatureObservation& is)
            {
              const int camera = is.seen[LEFT] ? LEFT : RIGHT;
              if (was.seen[LEFT] && was.seen[RIGHT])
              {
                const double inverse_m =
                    geometry_.inverseDistance(camera, was.bearing[camera], was.bearing[LEFT + RIGHT - camera]);
                moved_.push_back({camera, was.bearing[camera], is.bearing[camera], true, std::max(0.0, inverse_m)});
              }
            });
  front_end::BodyMotion motion;
  if (!motion_check_.check(moved_, ROTATION_SIGMA, &motion, &consistent_))
  {
    return std::nullopt;
  }
  return motion.p_now_last.norm();
}

double StandstillDetector::flowSince(const FrameFeatures& pair, const FrameFeatures& features)
{
  distances_.clear();
  forCommon(pair, features,
            [this](const FeatureObservation& was, const FeatureObservation& is)
            {
              for (const int camera : {LEFT, RIGHT})
              {
                const float distance = (was.pixel[camera] - is.pixel[camera]).norm();
                if (was.seen[camera] && is.seen[camera] && std::isfinite(distance))
                {
                  distances_.push_back(distance);
                  break;
                }
              }
            });
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
