#include "odometry/vio.h"

#include <pi_node/formatting.h>

#include "estimator/factors.h"
#include "estimator/frame_budget.h"

#include <pi_slam/so3.h>
#include "estimator/window_estimator.h"
#include "front_end/frame_filter.h"
#include "inertial/imu_preintegration.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <mutex>
#include <unordered_map>
#include <utility>

namespace pi_slam
{

namespace
{

constexpr int MIN_VIEWS = 10;           ///< that a correction needs
constexpr double MIN_AGREEING = 0.35;   ///< part of the views; fewer, and pictures and IMU are at odds
constexpr int FEW_VIEWS = 30;           ///< fewer of known landmarks ask for a keyframe
constexpr int MIN_NEW_LANDMARKS = 15;   ///< seen by both cameras, to begin with again after darkness
constexpr double MAX_ODDS_S = 1.0;      ///< at odds for longer: what is tracked is not believed any more
constexpr double BLIND_AFTER_S = 0.25;  ///< without a correction
constexpr int MAX_STRIKES = 3;          ///< pairs in a row in which a landmark may disagree
constexpr double MAX_GYRO_BIAS = 1.0;   ///< beyond it the estimate has failed [rad/s]
constexpr double MAX_ACCEL_BIAS = 5.0;  ///< [m/s^2]
constexpr double MAX_ERROR_PX = 8.0;    ///< mean error after optimisation beyond which it has failed
constexpr int START_ITERATIONS = 20;
constexpr double LONGEST_GAP_S = 0.2;  ///< of the IMU, after which there is no pose before pictures have corrected it
constexpr double IMU_KEPT_S = 12.0;    ///< of samples, for the initialiser and long gaps

using pi_node::format;
using pi_node::seconds;
using Clock = std::chrono::steady_clock;

double millisecondsSince(Clock::time_point start)
{
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

}  // namespace

struct Vio::Impl
{
  Impl(const StereoCalibration& calibration_in, const VioOptions& options_in,
       std::shared_ptr<pi_runtime::Runtime> runtime)
    : calibration(calibration_in)
    , options(options_in)
    , cameras(estimator::cameraGeometry(calibration))
    , tracker(calibration, options.tracker, std::move(runtime))
    , initializer(calibration, options.imu, options.initializer)
    , standstill(options.imu, options.standstill)
    , window(calibration, options.imu, options.window)
    , filter(calibration, options.window.pixel_noise)
    , propagator(options.imu)
    , imu(options.imu)
    , inbox_check(options.imu)
    , since_keyframe(options.imu, ImuBias())
    , budget(options.frame_budget_s)
  {
  }

  // The thread of the IMU.
  std::optional<PropagatedState> addImu(ImuSample sample);

  // The thread of the pictures.
  FrameReport addPair(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right);
  void forgetPairs();
  void clearEstimate();
  void takeInbox();
  std::string whyUnusable(int64_t stamp_ns, bool running) const;
  TrackerPrediction predictViews(const ImuPreintegration& since_pair, bool running);
  void runFrontEnd(const cv::Mat& left, const cv::Mat& right, const TrackerPrediction& prediction, int64_t stamp_ns,
                   FrameReport* report);
  void start(FrameReport* report);
  void track(const ImuPreintegration& since_pair, const ImuBuffer::Quality& quality, FrameReport* report);
  void noteMissingCorrection(const FilterReport& filtered, size_t views, FrameReport* report);
  void enterStandstill();
  bool leaveStandstill(FrameReport* report);
  std::vector<LandmarkView> viewsOfKnown() const;
  void noteOutliers(const FilterReport& filtered);
  bool keyframeDue(const FrameReport& report, size_t views) const;
  double parallaxSinceKeyframe(double* tracked_ratio) const;
  void addKeyframe(FrameReport* report);
  void optimize(int iterations, FrameReport* report);
  void rememberKeyframe();
  void offerToMap(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right);
  std::string failure(const FrameReport& report) const;
  void giveUp(const std::string& why, FrameReport* report);
  Matrix15d outputCovariance() const;
  void publish();

  const StereoCalibration calibration;
  const VioOptions options;
  const std::array<estimator::CameraGeometry, 2> cameras;
  StereoTracker tracker;
  Initializer initializer;
  StandstillDetector standstill;
  WindowEstimator window;
  FrameFilter filter;
  ImuPropagator propagator;

  // Between the threads.
  std::mutex inbox_mutex;
  std::vector<ImuSample> inbox;
  std::string imu_message;
  std::atomic<int64_t> newest_imu_ns{INT64_MIN};
  std::atomic<bool> forget_imu{false};    ///< asked for by reset(), done by the next addImu()
  std::atomic<bool> forget_pairs{false};  ///< likewise by the next addPair()

  mutable std::mutex output_mutex;
  std::optional<PropagatedState> corrected;
  FrameFeatures shown_features;
  std::vector<WindowLandmark> shown_landmarks;

  std::function<void(const MapFrame&)> keyframe_callback;

  // Of the pictures' thread alone.
  ImuBuffer imu;
  ImuBuffer inbox_check;  ///< of the IMU's thread: finds gaps and disorder, holds two samples
  std::vector<ImuSample> taken;
  VioStatus status = VioStatus::INITIALIZING;
  int64_t last_pair_ns = INT64_MIN;
  int64_t last_corrected_ns = 0;
  int64_t odds_since_ns = 0;  ///< 0: pictures and IMU agree
  FrameFeatures features;
  ImuPreintegration since_keyframe;
  int64_t keyframe_ns = 0;
  std::unordered_map<int64_t, FeatureObservation> keyframe_features;
  Eigen::Quaterniond keyframe_q = Eigen::Quaterniond::Identity();
  std::unordered_map<int64_t, int> strikes;
  Matrix15d common_covariance = Matrix15d::Zero();  ///< of position and heading of the window as a whole
  NavState still_state;
  Matrix15d still_covariance = Matrix15d::Zero();
  FrameFeatures still_features;
  std::optional<NavState> last_known;  ///< where to go on from after the estimate was given up
  estimator::FrameBudget budget;
};

std::optional<PropagatedState> Vio::Impl::addImu(ImuSample sample)
{
  if (forget_imu.exchange(false))
  {
    inbox_check.clear();
  }
  // Inside, all stamps are those of the cameras.
  const int64_t own_stamp_ns = sample.stamp_ns;
  sample.stamp_ns -= std::llround(1e9 * options.imu.time_offset_s);
  const int64_t before_ns = inbox_check.empty() ? 0 : inbox_check.lastNs();
  const ImuBuffer::Added added = inbox_check.add(sample);
  {
    const std::lock_guard<std::mutex> lock(inbox_mutex);
    switch (added)
    {
      case ImuBuffer::Added::OUT_OF_ORDER:
        imu_message = format("imu/data: stamp goes back by %.4f s, sample ignored; check the driver's clock",
                             seconds(before_ns - sample.stamp_ns));
        break;
      case ImuBuffer::Added::NOT_FINITE:
        imu_message = "imu/data: a sample is not finite, ignored; check the driver";
        break;
      case ImuBuffer::Added::GAP:
        imu_message = format("imu/data: gap of %.3f s, bridged by interpolation; check load and transport",
                             seconds(sample.stamp_ns - before_ns));
        break;
      case ImuBuffer::Added::SATURATED:
        imu_message = "imu/data: an axis is at the sensor's limit, the pose gets inaccurate; choose a wider range";
        break;
      case ImuBuffer::Added::OK:
        break;
    }
    if (added == ImuBuffer::Added::OUT_OF_ORDER || added == ImuBuffer::Added::NOT_FINITE)
    {
      return std::nullopt;
    }
    inbox.push_back(sample);
  }
  inbox_check.forgetBefore(sample.stamp_ns);
  newest_imu_ns.store(sample.stamp_ns, std::memory_order_release);
  if (added == ImuBuffer::Added::GAP && seconds(sample.stamp_ns - before_ns) > LONGEST_GAP_S)
  {
    propagator.reset();
  }
  std::optional<PropagatedState> result = propagator.add(sample);
  if (result)
  {
    result->state.stamp_ns = own_stamp_ns;
  }
  return result;
}

/// As after construction.
void Vio::Impl::forgetPairs()
{
  clearEstimate();
  status = VioStatus::INITIALIZING;
  last_known.reset();
  last_pair_ns = INT64_MIN;
  features = FrameFeatures();
  imu.clear();
  const std::lock_guard<std::mutex> lock(output_mutex);
  corrected.reset();
}

/// Forgets everything but the samples of the IMU.
void Vio::Impl::clearEstimate()
{
  window.clear();
  tracker.reset();
  initializer.reset();
  standstill.reset();
  propagator.reset();
  strikes.clear();
  odds_since_ns = 0;
  since_keyframe = ImuPreintegration(options.imu, ImuBias());
}

void Vio::Impl::takeInbox()
{
  taken.clear();
  {
    const std::lock_guard<std::mutex> lock(inbox_mutex);
    std::swap(taken, inbox);
  }
  for (const ImuSample& sample : taken)
  {
    imu.add(sample);
  }
}

FrameReport Vio::Impl::addPair(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right)
{
  const Clock::time_point begin = Clock::now();
  FrameReport report;
  report.stamp_ns = stamp_ns;
  if (forget_pairs.exchange(false))
  {
    forgetPairs();
  }
  report.status = status;
  takeInbox();
  const bool running = status != VioStatus::INITIALIZING && status != VioStatus::LOST;
  report.message = whyUnusable(stamp_ns, running);
  if (!report.message.empty())
  {
    return report;
  }

  ImuPreintegration since_pair(options.imu, filter.state().bias);
  ImuBuffer::Quality quality;
  if (last_pair_ns != INT64_MIN && imu.firstNs() <= last_pair_ns)
  {
    since_pair = imu.integrate(last_pair_ns, stamp_ns, running ? filter.state().bias : ImuBias(), &quality);
  }

  runFrontEnd(left, right, predictViews(since_pair, running), stamp_ns, &report);
  report.front_end_ms = millisecondsSince(begin);
  last_pair_ns = stamp_ns;
  if (running)
  {
    track(since_pair, quality, &report);
  }
  else
  {
    start(&report);
  }
  if (status == VioStatus::TRACKING && report.keyframe && keyframe_callback)
  {
    offerToMap(stamp_ns, left, right);
  }
  report.status = status;
  imu.forgetBefore(stamp_ns - std::llround(1e9 * IMU_KEPT_S));
  publish();
  report.total_ms = millisecondsSince(begin);
  budget.update(1e-3 * report.total_ms);
  return report;
}

/// Why a pair cannot be used; empty if it can.
std::string Vio::Impl::whyUnusable(int64_t stamp_ns, bool running) const
{
  if (stamp_ns <= last_pair_ns)
  {
    return format("pictures: stamp goes back by %.3f s, pair ignored; call reset if the recording began anew",
                  seconds(last_pair_ns - stamp_ns));
  }
  if (imu.empty())
  {
    return "imu/data: no sample yet, pair ignored";
  }
  if (imu.lastNs() < stamp_ns)
  {
    return format("imu/data: newest sample is %.3f s older than the pair, pair ignored",
                  seconds(stamp_ns - imu.lastNs()));
  }
  if (imu.firstNs() > (running ? last_pair_ns : stamp_ns))
  {
    return format("imu/data: first sample is %.3f s younger than the pair, pair ignored",
                  seconds(imu.firstNs() - stamp_ns));
  }
  return std::string();
}

/// Where the tracker has to look for features, by the IMU.
TrackerPrediction Vio::Impl::predictViews(const ImuPreintegration& since_pair, bool running)
{
  TrackerPrediction prediction;
  if (since_pair.empty())
  {
    return prediction;
  }
  prediction.R_last_now = since_pair.deltaR();
  if (running)
  {
    const NavState predicted = since_pair.predict(filter.state());
    const Eigen::Matrix3d R_body_odom = predicted.q.toRotationMatrix().transpose();
    prediction.p_body = [this, R_body_odom, p = predicted.p](int64_t id) -> std::optional<Eigen::Vector3d>
    {
      const LandmarkEstimate* const landmark = window.landmark(id);
      if (landmark == nullptr)
      {
        return std::nullopt;
      }
      return Eigen::Vector3d(R_body_odom * (landmark->p_odom - p));
    };
  }
  return prediction;
}

void Vio::Impl::runFrontEnd(const cv::Mat& left, const cv::Mat& right, const TrackerPrediction& prediction,
                            int64_t stamp_ns, FrameReport* report)
{
  TrackerReport& tracked = report->tracker;
  still_features = features;
  features =
      tracker.process(stamp_ns, left, right, prediction, budget.features(options.tracker.max_features), &tracked);
  report->features = static_cast<int>(features.features.size());
  report->processed = true;
  report->reduced = budget.reduced();
  if (tracked.blank[LEFT] || tracked.blank[RIGHT])
  {
    const int camera = tracked.blank[LEFT] ? LEFT : RIGHT;
    const std::string which = tracked.blank[LEFT] && tracked.blank[RIGHT] ? "both pictures are"
                              : tracked.blank[LEFT]                       ? "left picture is"
                                                                          : "right picture is";
    report->message = which + format(
                                  " without content (mean grey %.0f, contrast %.1f); check lens cap, light and "
                                  "exposure",
                                  tracked.mean_grey[camera], tracked.contrast[camera]);
  }
}

/// Before the start, and after the estimate was given up.
void Vio::Impl::start(FrameReport* report)
{
  InitialSolution solution;
  const Initializer::Outcome outcome = initializer.add(features, imu, &solution);
  if (outcome != Initializer::Outcome::DONE)
  {
    if (report->message.empty() && outcome != Initializer::Outcome::COLLECTING)
    {
      report->message = "no start yet: " + initializer.message();
    }
    return;
  }
  if (last_known)
  {
    // Continues where the estimate ended: same position and heading, the new tilt.
    const NavState& now = solution.states.back();
    const Eigen::Matrix3d turn = (last_known->q * now.q.conjugate()).toRotationMatrix();
    const Eigen::Quaterniond heading(
        Eigen::AngleAxisd(std::atan2(turn(1, 0) - turn(0, 1), turn(0, 0) + turn(1, 1)), Eigen::Vector3d::UnitZ()));
    const Eigen::Vector3d p_now = now.p;
    for (NavState& state : solution.states)
    {
      state.p = last_known->p + heading * (state.p - p_now);
      state.q = heading * state.q;
      state.v = heading * state.v;
    }
  }
  window.start(solution, imu);
  report->reset = last_known.has_value();
  const int64_t stamp_ns = solution.states.back().stamp_ns;
  optimize(START_ITERATIONS, report);
  const std::string wrong = failure(*report);
  if (!wrong.empty())
  {
    report->message = "no start yet: " + wrong;
    window.clear();
    initializer.reset();
    return;
  }
  status = VioStatus::TRACKING;
  initializer.reset();
  standstill.reset();
  strikes.clear();
  odds_since_ns = 0;
  last_corrected_ns = stamp_ns;
  report->keyframe = true;
  rememberKeyframe();
  if (stamp_ns != features.stamp_ns)
  {
    // The newest pair used is older than this one.
    ImuBuffer::Quality quality;
    const ImuPreintegration rest = imu.integrate(stamp_ns, features.stamp_ns, filter.state().bias, &quality);
    filter.predict(rest);
    since_keyframe = rest;
    filter.update(viewsOfKnown(), MIN_VIEWS);
    report->keyframe = false;
  }
}

/// One pair while the state is known.
void Vio::Impl::track(const ImuPreintegration& since_pair, const ImuBuffer::Quality& quality, FrameReport* report)
{
  const Clock::time_point begin = Clock::now();
  if (quality.saturated && report->message.empty())
  {
    report->message = "imu/data: an axis is at the sensor's limit, the pose gets inaccurate; choose a wider range";
  }
  const int64_t stamp_ns = features.stamp_ns;
  const bool still = standstill.update(features, imu, filter.state().bias);
  if (status == VioStatus::STANDSTILL && !still && !leaveStandstill(report))
  {
    return;
  }
  const bool standing = status == VioStatus::STANDSTILL;
  filter.predict(since_pair);
  if (!standing)
  {
    if (since_keyframe.empty())
    {
      since_keyframe = ImuPreintegration(options.imu, filter.state().bias);
    }
    since_keyframe.append(since_pair);
  }

  const std::vector<LandmarkView> views = viewsOfKnown();
  if (standing)
  {
    filter.holdStill(still_state, still_covariance);
    last_corrected_ns = stamp_ns;
    report->inliers = static_cast<int>(views.size());
    report->filter_ms = millisecondsSince(begin);
    return;
  }

  const FilterReport filtered =
      filter.update(views, std::max(MIN_VIEWS, static_cast<int>(MIN_AGREEING * static_cast<double>(views.size()))));
  report->inliers = filtered.updated ? filtered.used : 0;
  report->filter_ms = millisecondsSince(begin);
  if (filtered.updated)
  {
    last_corrected_ns = stamp_ns;
    odds_since_ns = 0;
    status = VioStatus::TRACKING;
    noteOutliers(filtered);
  }
  else
  {
    noteMissingCorrection(filtered, views.size(), report);
    if (status == VioStatus::LOST || status == VioStatus::INITIALIZING)
    {
      return;
    }
  }

  if (still || keyframeDue(*report, views.size()))
  {
    addKeyframe(report);
    if (status == VioStatus::LOST)
    {
      return;
    }
  }
  if (still && report->keyframe)
  {
    enterStandstill();
  }
  const std::string wrong = failure(*report);
  if (!wrong.empty())
  {
    giveUp(wrong, report);
  }
}

/// The filter found too few views that agree: by IMU only, and after a while the estimate is given up.
void Vio::Impl::noteMissingCorrection(const FilterReport& filtered, size_t views, FrameReport* report)
{
  const int64_t stamp_ns = features.stamp_ns;
  const double uncorrected_s = seconds(stamp_ns - last_corrected_ns);
  const bool at_odds = views >= 2 * MIN_VIEWS;
  if (at_odds && odds_since_ns == 0)
  {
    odds_since_ns = stamp_ns;
  }
  if (uncorrected_s > BLIND_AFTER_S)
  {
    status = VioStatus::BLIND;
    if (report->message.empty())
    {
      report->message =
          at_odds ? format(
                        "pictures and IMU are at odds for %.2f s (%.0f of %.0f views agree): check that their stamps "
                        "are of one clock, and the calibration",
                        seconds(stamp_ns - odds_since_ns), filtered.used, views)
                  : format("%.0f known landmarks in view, need %.0f: by IMU only for %.2f s", views, MIN_VIEWS,
                           uncorrected_s);
    }
  }
  if (at_odds && seconds(stamp_ns - odds_since_ns) > MAX_ODDS_S)
  {
    // Landmarks and state will not agree again: both are kept, but the tracks between them are not.
    tracker.reset();
    odds_since_ns = 0;
  }
  if (uncorrected_s > options.max_blind_s)
  {
    giveUp(format("no pictures that help for %.1f s", uncorrected_s), report);
  }
}

void Vio::Impl::enterStandstill()
{
  status = VioStatus::STANDSTILL;
  still_state = filter.state();
  still_state.v.setZero();
  still_covariance = filter.covariance();
  filter.holdStill(still_state, still_covariance);
}

/// The last pair at rest becomes a keyframe, tied to the one at which the rest began.
/// @return false if the estimate was given up.
bool Vio::Impl::leaveStandstill(FrameReport* report)
{
  status = VioStatus::TRACKING;
  NavState state = filter.state();
  state.v.setZero();
  if (state.stamp_ns > keyframe_ns)
  {
    ImuSample from;
    from.stamp_ns = keyframe_ns;
    from.w = state.bias.gyro;
    from.f = state.q.conjugate() * Eigen::Vector3d(0.0, 0.0, options.imu.gravity) + state.bias.accel;
    ImuSample to = from;
    to.stamp_ns = state.stamp_ns;
    ImuPreintegration rest(options.imu, state.bias);
    rest.append(from, to);
    window.addKeyframe(state, still_features, rest, true);
    optimize(budget.iterations(options.window.max_iterations), report);
    const FrameFeatures now = std::exchange(features, still_features);
    rememberKeyframe();
    features = now;
    const std::string wrong = failure(*report);
    if (!wrong.empty())
    {
      giveUp(wrong, report);
      return false;
    }
  }
  return true;
}

std::vector<LandmarkView> Vio::Impl::viewsOfKnown() const
{
  std::vector<LandmarkView> views;
  views.reserve(2 * features.features.size());
  for (const FeatureObservation& feature : features.features)
  {
    const LandmarkEstimate* const landmark = window.landmark(feature.id);
    if (landmark == nullptr)
    {
      continue;
    }
    for (int camera : {LEFT, RIGHT})
    {
      if (feature.seen[camera])
      {
        views.push_back(
            LandmarkView{feature.id, camera, feature.bearing[camera], landmark->p_odom, landmark->covariance});
      }
    }
  }
  return views;
}

/// Views that disagree are not used by the window either; a landmark that keeps disagreeing is given up: it moves, or
/// was never one.
void Vio::Impl::noteOutliers(const FilterReport& filtered)
{
  std::unordered_map<int64_t, int> now;
  std::vector<int64_t> gone;
  for (int64_t id : filtered.outliers)
  {
    const auto before = strikes.find(id);
    const int count = 1 + (before != strikes.end() ? before->second : 0);
    if (count >= MAX_STRIKES)
    {
      gone.push_back(id);
    }
    else
    {
      now.emplace(id, count);
    }
  }
  strikes = std::move(now);
  if (!gone.empty())
  {
    tracker.drop(gone);
  }
  if (!filtered.outliers.empty())
  {
    auto& list = features.features;
    list.erase(
        std::remove_if(list.begin(), list.end(),
                       [&](const FeatureObservation& feature)
                       { return std::binary_search(filtered.outliers.begin(), filtered.outliers.end(), feature.id); }),
        list.end());
  }
}

double Vio::Impl::parallaxSinceKeyframe(double* tracked_ratio) const
{
  const Eigen::Matrix3d R_keyframe_now = (keyframe_q.conjugate() * filter.state().q).toRotationMatrix();
  std::vector<double> angles;
  angles.reserve(features.features.size());
  for (const FeatureObservation& feature : features.features)
  {
    const auto before = keyframe_features.find(feature.id);
    if (before == keyframe_features.end())
    {
      continue;
    }
    for (int camera : {LEFT, RIGHT})
    {
      if (feature.seen[camera] && before->second.seen[camera])
      {
        const Eigen::Matrix3d& R = cameras[camera].R_camera_body;
        const Eigen::Vector3d turned = R * (R_keyframe_now * (R.transpose() * feature.bearing[camera]));
        angles.push_back(turned.cross(before->second.bearing[camera]).norm());
        break;
      }
    }
  }
  *tracked_ratio = keyframe_features.empty()
                       ? 0.0
                       : static_cast<double>(angles.size()) / static_cast<double>(keyframe_features.size());
  if (angles.size() < 5)
  {
    return 0.0;
  }
  std::nth_element(angles.begin(), angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2), angles.end());
  return angles[angles.size() / 2] * cameras[LEFT].focal_px;
}

bool Vio::Impl::keyframeDue(const FrameReport& report, size_t views) const
{
  const double since_s = seconds(features.stamp_ns - keyframe_ns);
  if (since_s < options.keyframe_min_interval_s || odds_since_ns != 0)
  {
    return false;
  }
  if (report.inliers == 0)
  {
    // Without a correction only new landmarks help, and only if there are some.
    return views < 2 * MIN_VIEWS && report.tracker.stereo >= MIN_NEW_LANDMARKS;
  }
  double tracked_ratio = 0.0;
  const double parallax_px = parallaxSinceKeyframe(&tracked_ratio);
  return report.inliers < FEW_VIEWS || since_s >= options.keyframe_max_interval_s ||
         parallax_px >= options.keyframe_parallax_px || tracked_ratio < options.keyframe_tracked_ratio;
}

void Vio::Impl::addKeyframe(FrameReport* report)
{
  window.addKeyframe(filter.state(), features, since_keyframe, false);
  report->keyframe = true;
  optimize(budget.iterations(options.window.max_iterations), report);
  rememberKeyframe();
}

/// Optimises the window; the filter begins again from its newest state.
void Vio::Impl::optimize(int iterations, FrameReport* report)
{
  const Clock::time_point begin = Clock::now();
  const WindowReport optimized = window.optimize(iterations);
  report->iterations = optimized.iterations;
  report->landmarks = optimized.landmarks;
  if (optimized.failed || optimized.mean_error_px > MAX_ERROR_PX)
  {
    giveUp(optimized.failed ? "the optimisation found no finite solution"
                            : format("mean reprojection error of %.1f px", optimized.mean_error_px),
           report);
    return;
  }
  if (!optimized.rejected.empty())
  {
    tracker.drop(optimized.rejected);
  }
  filter.reset(window.newest(), window.newestRelativeCovariance());
  common_covariance = window.newestCovariance() - window.newestRelativeCovariance();
  report->window_ms += millisecondsSince(begin);
}

void Vio::Impl::rememberKeyframe()
{
  keyframe_ns = window.empty() ? features.stamp_ns : window.newest().stamp_ns;
  keyframe_q = filter.state().q;
  since_keyframe = ImuPreintegration(options.imu, filter.state().bias);
  keyframe_features.clear();
  for (const FeatureObservation& feature : features.features)
  {
    keyframe_features.emplace(feature.id, feature);
  }
}

void Vio::Impl::offerToMap(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right)
{
  MapFrame frame;
  frame.stamp_ns = stamp_ns;
  frame.T_odom_body = filter.state().T_odom_body();
  frame.left = left;
  frame.right = right;
  const Eigen::Isometry3d T_body_odom = frame.T_odom_body.inverse();
  for (const FeatureObservation& feature : features.features)
  {
    const LandmarkEstimate* const landmark = feature.seen[LEFT] ? window.landmark(feature.id) : nullptr;
    if (landmark != nullptr)
    {
      MapFrame::Landmark seen;
      seen.id = feature.id;
      seen.pixel = feature.pixel[LEFT];
      seen.p_body = T_body_odom * landmark->p_odom;
      const Eigen::Vector3d along = (landmark->p_odom - frame.T_odom_body.translation()).normalized();
      seen.deviation_m = std::sqrt(along.dot(landmark->covariance * along));
      frame.landmarks.push_back(seen);
    }
  }
  keyframe_callback(frame);
}

/// @return the fault of the estimate; empty: none.
std::string Vio::Impl::failure(const FrameReport& report) const
{
  if (window.empty())
  {
    return report.message.empty() ? "the window is empty" : report.message;
  }
  const NavState& state = filter.state();
  if (!state.isFinite() || !filter.covariance().allFinite())
  {
    return "the state is not finite";
  }
  if (state.v.norm() > options.max_speed)
  {
    return format("speed %.1f m/s, above vio/max_speed = %.1f", state.v.norm(), options.max_speed);
  }
  if (state.bias.gyro.norm() > MAX_GYRO_BIAS || state.bias.accel.norm() > MAX_ACCEL_BIAS)
  {
    return format("biases of %.2f rad/s and %.2f m/s^2 cannot be: check calibration and time offset of camera and IMU",
                  state.bias.gyro.norm(), state.bias.accel.norm());
  }
  return std::string();
}

void Vio::Impl::giveUp(const std::string& why, FrameReport* report)
{
  // Odometry continues from the last pose that a correction confirmed, or came near to.
  if (corrected && corrected->state.isFinite())
  {
    last_known = corrected->state;
  }
  status = corrected ? VioStatus::LOST : VioStatus::INITIALIZING;
  report->message = "estimate given up: " + why;
  report->reset = true;
  clearEstimate();
}

Matrix15d Vio::Impl::outputCovariance() const
{
  return filter.covariance() + common_covariance;
}

/// The results for other threads.
void Vio::Impl::publish()
{
  const bool running = status != VioStatus::INITIALIZING && status != VioStatus::LOST;
  PropagatedState state;
  if (running)
  {
    state.state = filter.state();
    state.covariance = outputCovariance();
    propagator.rebase(state.state, state.covariance);
  }
  std::vector<WindowLandmark> landmarks;
  if (running)
  {
    for (const LandmarkEstimate& landmark : window.landmarks())
    {
      const Eigen::Vector3d along = (landmark.p_odom - state.state.p).normalized();
      landmarks.push_back(
          WindowLandmark{landmark.id, landmark.p_odom, std::sqrt(along.dot(landmark.covariance * along))});
    }
  }
  const std::lock_guard<std::mutex> lock(output_mutex);
  if (running)
  {
    corrected = state;
  }
  shown_features = features;
  shown_landmarks = std::move(landmarks);
}

Vio::Vio(const StereoCalibration& calibration, const VioOptions& options, std::shared_ptr<pi_runtime::Runtime> runtime)
{
  options.validate();
  impl_ = std::make_unique<Impl>(calibration, options, std::move(runtime));
}

Vio::~Vio() = default;

std::optional<PropagatedState> Vio::addImu(const ImuSample& sample)
{
  return impl_->addImu(sample);
}

bool Vio::imuCovers(int64_t stamp_ns) const
{
  return impl_->newest_imu_ns.load(std::memory_order_acquire) >= stamp_ns;
}

FrameReport Vio::addPair(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right)
{
  return impl_->addPair(stamp_ns, left, right);
}

std::string Vio::imuMessage()
{
  const std::lock_guard<std::mutex> lock(impl_->inbox_mutex);
  return std::exchange(impl_->imu_message, std::string());
}

std::optional<PropagatedState> Vio::newestCorrected() const
{
  const std::lock_guard<std::mutex> lock(impl_->output_mutex);
  return impl_->corrected;
}

FrameFeatures Vio::newestFeatures() const
{
  const std::lock_guard<std::mutex> lock(impl_->output_mutex);
  return impl_->shown_features;
}

std::vector<WindowLandmark> Vio::landmarks() const
{
  const std::lock_guard<std::mutex> lock(impl_->output_mutex);
  return impl_->shown_landmarks;
}

void Vio::setKeyframeCallback(std::function<void(const MapFrame&)> callback)
{
  impl_->keyframe_callback = std::move(callback);
}

void Vio::reset()
{
  {
    const std::lock_guard<std::mutex> lock(impl_->inbox_mutex);
    impl_->inbox.clear();
    impl_->imu_message.clear();
  }
  impl_->newest_imu_ns.store(INT64_MIN, std::memory_order_release);
  impl_->propagator.clear();
  impl_->forget_imu.store(true);
  impl_->forget_pairs.store(true);
}

}  // namespace pi_slam
