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
constexpr int PARTS = 8;                  ///< of the window, at which pairs are kept
constexpr size_t MIN_FEATURES = 10;
constexpr size_t LEAST_STAYED = 6;  ///< features that do not move while most do
constexpr double FAST_MPS = 0.2;    ///< no vehicle has this speed at once after a rest
constexpr double SLOW_MPS = 0.05;   ///< faster, as estimated, and a rest needs pictures that do not move
constexpr double MOVED_S = 2.0;     ///< likewise so long after the IMU ended a rest
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
  picture_moves_ = false;
  flow_px_ = -1.0;
}

bool StandstillDetector::update(const FrameFeatures& features, const ImuBuffer& imu, const ImuBias& bias,
                                std::optional<bool> at_rest, double speed_mps)
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
  const std::optional<ImuWindow> window = measureWindow(imu, model_, stamp_ns, options_.window_s);
  const bool imu_calm = reference != nullptr && window && isCalm(*window, bias, slack);
  bool calm = false;
  picture_moves_ = false;
  crept_ = false;
  if (at_rest)
  {
    calm = *at_rest && imu_calm;
    picture_moves_ = calm && flow_px_ > MOVES_FACTOR * options_.max_flow_px;
  }
  else if (imu_calm)
  {
    const bool few = flow_px_ < 0.0;  // what was in view is covered
    const FrameFeatures* const moved_since = few ? reference : movedSince(reference, features, slack);
    const bool imu_at_rest = still_ ? rest_.unmoved(*window)
                                    : speed_mps <= SLOW_MPS && rest_.quiet(*window) &&
                                          stamp_ns - imu_moved_ns_ > std::llround(1e9 * MOVED_S);
    imu_moved_ns_ = still_ && !imu_at_rest ? stamp_ns : imu_moved_ns_;
    picture_moves_ = moved_since != nullptr && imu_at_rest &&
                     (few ? still_ && features.features.size() >= MIN_FEATURES : disputed(*moved_since, features));
    calm = moved_since == nullptr || picture_moves_;
    crept_ = still_ && !calm && moved_since != nullptr && moved_since != reference;
  }
  if (calm && !still_)
  {
    since_ns_ = reference->stamp_ns;
    first_ = picture_moves_ ? unmovedOf(*reference, features) : features;
    rest_.beginRest();
  }
  else if (calm && at_rest)
  {
    first_ = features;  // the way counts from here on should the wheels cease to tell
  }
  still_ = calm;
  if (still_)
  {
    rest_.learn(*window, !picture_moves_);
  }

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

/// The pair since which pictures say that the body has moved; null: since none.
const FrameFeatures* StandstillDetector::movedSince(const FrameFeatures* reference, const FrameFeatures& features,
                                                    double slack)
{
  if (flow_px_ > slack * options_.max_flow_px)
  {
    return reference;
  }
  const FrameFeatures* const earlier =
      pairBefore(features.stamp_ns - std::llround(1e9 * (LONG_WINDOWS * options_.window_s)));
  // Features that are no longer seen do not count.
  if (earlier != nullptr && (!still_ || earlier->stamp_ns >= since_ns_) &&
      flowSince(*earlier, features) > slack * LONG_FLOW_FACTOR * options_.max_flow_px)
  {
    return earlier;
  }
  if (!still_)
  {
    return earlier != nullptr && wayBetween(*earlier, features).value_or(0.0) > CREEPING_M ? earlier : nullptr;
  }
  const std::optional<double> way_m = wayBetween(first_, features);
  if (!way_m)
  {
    first_ = pairs_.front();  // what was seen then is out of sight
  }
  return way_m && *way_m > CREPT_M ? &first_ : nullptr;
}

/// Whether the motion that pictures show may be that of people: after a rest it is faster than a vehicle can be, or
/// some of the features have stayed where they were. Pictures alone cannot tell then.
bool StandstillDetector::disputed(const FrameFeatures& pair, const FrameFeatures& features)
{
  const std::optional<double> way_m = wayBetween(pair, features);
  const bool motion_known = way_m.has_value();
  if (!motion_known && flow_px_ <= MOVES_FACTOR * options_.max_flow_px)
  {
    return false;
  }
  if (still_ && (!way_m || *way_m > FAST_MPS * 1e-9 * static_cast<double>(features.stamp_ns - pair.stamp_ns)))
  {
    return true;
  }
  size_t stayed = 0;
  size_t against = 0;
  size_t index = 0;
  forCommon(pair, features,
            [&](const FeatureObservation& was, const FeatureObservation& is)
            {
              const bool judged = was.seen[LEFT] && was.seen[RIGHT];  // as in wayBetween()
              if (hasStayed(was, is))
              {
                ++stayed;
                against += motion_known && judged ? 1 - consistent_[index] : motion_known ? 0 : 1;
              }
              index += judged ? 1 : 0;
            });
  return against >= LEAST_STAYED && 2 * against >= stayed;
}

bool StandstillDetector::hasStayed(const FeatureObservation& was, const FeatureObservation& is) const
{
  const int camera = is.seen[LEFT] && was.seen[LEFT] ? LEFT : RIGHT;
  return was.seen[camera] && is.seen[camera] &&
         (was.pixel[camera] - is.pixel[camera]).norm() <= LONG_FLOW_FACTOR * options_.max_flow_px;
}

FrameFeatures StandstillDetector::unmovedOf(const FrameFeatures& pair, const FrameFeatures& features) const
{
  FrameFeatures unmoved;
  unmoved.stamp_ns = features.stamp_ns;
  forCommon(pair, features,
            [&](const FeatureObservation& was, const FeatureObservation& is)
            {
              if (hasStayed(was, is))
              {
                unmoved.features.push_back(is);
              }
            });
  return unmoved;
}

/// How far pictures say that the body has gone [m]; nullopt: they do not tell. consistent_ tells of each feature that
/// both cameras saw in `pair` whether it agrees.
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

bool StandstillDetector::isCalm(const ImuWindow& window, const ImuBias& bias, double slack) const
{
  return (window.w - bias.gyro).cwiseAbs().maxCoeff() <= slack * options_.max_rate &&
         window.w_deviation <= slack * options_.max_gyro_deviation + window.w_noise &&
         window.f_deviation <= slack * options_.max_accel_deviation + window.f_noise;
}

}  // namespace pi_slam
