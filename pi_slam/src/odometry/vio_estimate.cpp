#include "odometry/vio_impl.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_slam/so3.h>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace pi_slam
{
namespace
{

using pi_node::format;
using pi_node::seconds;
using pi_node::secondsSince;

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
/// A window full of keyframes from one place loses the landmarks' distances: while the body creeps they are rarer.
constexpr double SLOW_PARALLAX_PX = 2.0;
constexpr double SLOW_INTERVALS = 16.0;  ///< of keyframe_max_interval_s
constexpr double WHEEL_STEP_S = 0.1;     ///< of the integration where wheels correct, while pictures are missing
constexpr double WHEELS_OFF_S = 1.0;     ///< from the stamp of a pair, either way, that is no delay
constexpr double BY_WHEELS_S = 2.0;      ///< that the wheels may be silent or slip before what pictures miss counts
constexpr double STOPPED_MPS = 0.1;      ///< faster, as estimated, and wheels that stand are not believed
constexpr double SLIP_S = 0.15;          ///< of disagreement that is worth a message
constexpr double PICTURE_MOVES_S = 2.0;  ///< at rest, likewise
constexpr double UNKNOWN_SPEED = 1.0;    ///< that a vehicle may have gained while there was no estimate [m/s]
/// A rest ends with a pair from before the body moved, 1 to 2 windows of the detector old: what it sees in a window. A
/// body that creeps is noticed later: 3 to 4.
constexpr size_t AT_REST_BEFORE = 1;
constexpr size_t AT_REST_BEFORE_CREEPING = 3;

}  // namespace

/// While there is no estimate, the gyroscope alone tells how the body turns.
void Vio::Impl::turnLastKnown(int64_t stamp_ns)
{
  if (!last_known || stamp_ns <= last_known->stamp_ns)
  {
    return;
  }
  const ImuPreintegration since = imu.integrate(last_known->stamp_ns, stamp_ns, last_known->bias, nullptr);
  if (!since.empty())
  {
    last_known->q = (last_known->q * since.deltaR()).normalized();
    last_known->stamp_ns = stamp_ns;
  }
}

/// The estimate begins again. Since it was given up the body may have stood, or gone on as fast as before and more; it
/// has turned by the error of the gyroscope's bias.
void Vio::Impl::displaceOdom(const NavState& now)
{
  const double lost_s = seconds(now.stamp_ns - given_up_ns);
  const Matrix15d& P = last_known_covariance;
  const double speed = last_known->v.norm() + std::sqrt(P.block<3, 3>(6, 6).trace()) + UNKNOWN_SPEED;
  const Eigen::Vector3d up_body = now.q.conjugate() * Eigen::Vector3d::UnitZ();
  displaced.about = now.p;
  displaced.position = P.topLeftCorner<3, 3>();
  displaced.position.diagonal().array() += std::pow(speed * lost_s, 2);
  const double gyro_noise = options.imu.gyro_noise_density * options.imu.gyro_noise_density;
  displaced.heading = up_body.dot(P.block<3, 3>(3, 3) * up_body) + lost_s * gyro_noise +
                      lost_s * lost_s * up_body.dot(P.block<3, 3>(9, 9) * up_body);
}

Matrix15d Vio::Impl::displacedCovariance(const NavState& state) const
{
  Vector15d by_heading = Vector15d::Zero();
  by_heading.segment<3>(0) = Eigen::Vector3d::UnitZ().cross(state.p - displaced.about);
  by_heading.segment<3>(3) = state.q.conjugate() * Eigen::Vector3d::UnitZ();
  by_heading.segment<3>(6) = Eigen::Vector3d::UnitZ().cross(state.v);
  Matrix15d covariance = displaced.heading * by_heading * by_heading.transpose();
  covariance.topLeftCorner<3, 3>() += displaced.position;
  return covariance;
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
    // Continues where the estimate ended, turned as the gyroscope said meanwhile, with the new tilt.
    const NavState& now = solution.states.back();
    Eigen::Quaterniond q_now = last_known->q;
    if (now.stamp_ns < last_known->stamp_ns)
    {
      const ImuPreintegration since = imu.integrate(now.stamp_ns, last_known->stamp_ns, last_known->bias, nullptr);
      q_now = q_now * since.deltaR().conjugate();
    }
    const Eigen::Matrix3d turn = (q_now * now.q.conjugate()).toRotationMatrix();
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
  if (last_known)
  {
    displaceOdom(filter.state());
  }
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
void Vio::Impl::track(const ImuPreintegration& since_pair, FrameReport* report)
{
  const auto begin = std::chrono::steady_clock::now();
  const int64_t stamp_ns = features.stamp_ns;
  report->wheels.known = !wheels.empty();
  report->wheels.scale = wheel_monitor.scale();
  report->wheels.slips = slips;
  const bool still =
      standstill.update(features, imu, filter.state().bias, wheelsAtRest(stamp_ns), filter.state().v.norm());
  if (status == VioStatus::STANDSTILL && !still && !leaveStandstill(report))
  {
    return;
  }
  const bool standing = status == VioStatus::STANDSTILL;
  if (standing)
  {
    filter.predict(since_pair);
  }
  else
  {
    predict(since_pair, report);
  }

  const std::vector<LandmarkView> views = viewsOfKnown();
  if (standing)
  {
    keepStill();
    wheel_monitor.skip();
    const bool moves = standstill.pictureMoves() || report->tracker.others_move;
    picture_moves_since_ns = !moves ? 0 : picture_moves_since_ns == 0 ? stamp_ns : picture_moves_since_ns;
    if (moves && seconds(stamp_ns - picture_moves_since_ns) > PICTURE_MOVES_S && report->message.empty())
    {
      report->message =
          std::string("much of the picture moves while ") +
          (wheels.empty() ? "the IMU says rest" : "wheels and IMU stand") +
          ": the pose is held; something large passes, or the vehicle is carried, or rolls with its wheels "
          "locked";
    }
    last_corrected_ns = stamp_ns;
    report->inliers = static_cast<int>(views.size());
    report->filter_ms = 1e3 * secondsSince(begin);
    return;
  }

  const FilterReport filtered =
      filter.update(views, std::max(MIN_VIEWS, static_cast<int>(MIN_AGREEING * static_cast<double>(views.size()))));
  report->inliers = filtered.updated ? filtered.used : 0;
  report->filter_ms = 1e3 * secondsSince(begin);
  if (filtered.updated)
  {
    last_corrected_ns = stamp_ns;
    odds_since_ns = 0;
    status = VioStatus::TRACKING;
    noteOutliers(filtered);
    const Eigen::Vector3d up = options.wheels.T_body_wheels.linear().col(2);
    wheel_monitor.add(filter.state(), wheels_since_pair, wheel_turn, up.dot(logSo3(since_pair.deltaR())));
  }
  else
  {
    wheel_monitor.skip();
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

/// Over a pair's interval by IMU, corrected by the wheels where there are some.
void Vio::Impl::predict(const ImuPreintegration& since_pair, FrameReport* report)
{
  if (since_keyframe.empty())
  {
    since_keyframe = ImuPreintegration(options.imu, filter.state().bias);
    wheels_since_keyframe = WheelWay();
  }
  wheels_since_pair = WheelWay();
  wheel_turn = 0.0;
  pair_q = filter.state().q;
  if (wheels.empty() || since_pair.duration() <= 1.5 * WHEEL_STEP_S)
  {
    predictByWheels(since_pair, report);
  }
  else
  {
    const int64_t step_ns = std::llround(1e9 * WHEEL_STEP_S);
    for (int64_t from_ns = since_pair.startNs(); from_ns < since_pair.endNs();)
    {
      const int64_t rest_ns = since_pair.endNs() - from_ns;
      const int64_t to_ns = rest_ns < 2 * step_ns ? since_pair.endNs() : from_ns + step_ns;
      predictByWheels(imu.integrate(from_ns, to_ns, filter.state().bias, nullptr), report);
      from_ns = to_ns;
    }
  }
  since_keyframe.append(since_pair);
  report->wheels.slips = slips;
  if (report->message.empty())
  {
    const double off_s = wheels.empty() ? 0.0 : seconds(since_pair.endNs() - wheels.newest().stamp_ns);
    report->message = std::abs(off_s) < WHEELS_OFF_S
                          ? wheel_monitor.fault()
                          : format(
                                "wheels: their newest sample is %.3f s before the pair and not used; check that the "
                                "chassis driver runs, with the cameras' clock",
                                off_s);
  }
}

void Vio::Impl::predictByWheels(const ImuPreintegration& part, FrameReport* report)
{
  const NavState before = filter.state();
  filter.predict(part);
  const std::optional<WheelSample> mean = wheels.mean(part.startNs(), part.endNs());
  const WheelOptions& options_of = options.wheels;
  WheelWay way;
  way.duration = part.duration();
  way.valid = mean.has_value();
  if (mean)
  {
    const Eigen::Vector3d said = options_of.T_body_wheels.linear() * Eigen::Vector3d(mean->v.x(), mean->v.y(), 0.0);
    way.moved = way.duration * (expSo3(0.5 * logSo3(part.deltaR())) * said);
    way.length = way.moved.norm();
    wheels_since_pair.append(way, (pair_q.conjugate() * before.q).toRotationMatrix());
    wheel_turn += way.duration * mean->yaw_rate;
  }
  else
  {
    wheels_since_pair.valid = false;
  }
  if (mean && wheel_monitor.fault().empty())
  {
    double residual = 0.0;
    report->wheels.used =
        filter.update(*mean, options_of, wheel_monitor.scale(), before, &residual) == WheelVerdict::USED;
    noteSlip(part, *mean, residual, report);
  }
  way.valid = report->wheels.used;
  wheels_since_keyframe.append(way, (keyframe_q.conjugate() * before.q).toRotationMatrix());
}

/// Wheels at odds with IMU and pictures for longer than an encoder's step: they slip, or slide.
void Vio::Impl::noteSlip(const ImuPreintegration& part, const WheelSample& mean, double residual, FrameReport* report)
{
  if (report->wheels.used)
  {
    by_wheels_ns = part.endNs();
    slipping_since_ns = 0;
    return;
  }
  slipping_since_ns = slipping_since_ns == 0 ? part.startNs() : slipping_since_ns;
  const double slipping_s = seconds(part.endNs() - slipping_since_ns);
  report->wheels.slipping = slipping_s >= SLIP_S;
  slips += report->wheels.slipping && slipping_s - part.duration() < SLIP_S ? 1 : 0;
  if (report->wheels.slipping && report->message.empty())
  {
    const double said = wheel_monitor.scale().value * mean.v.x();
    report->message = format(
        "wheels: they say %.2f m/s where IMU and pictures say %.2f: slip or skid for %.1f s, the wheels are not used",
        said, said - residual, slipping_s);
  }
}

/// Over the detector's window; nullopt: they do not tell, or tell of a rest while the vehicle is known to move.
std::optional<bool> Vio::Impl::wheelsAtRest(int64_t stamp_ns) const
{
  if (wheels.empty() || !wheel_monitor.fault().empty())
  {
    return std::nullopt;
  }
  const std::optional<bool> rest = wheels.atRest(stamp_ns - std::llround(1e9 * options.standstill.window_s), stamp_ns);
  return rest.value_or(false) && status != VioStatus::STANDSTILL && filter.state().v.norm() > STOPPED_MPS ? std::nullopt
                                                                                                          : rest;
}

/// Their way since the last keyframe, if it is known over all of since_keyframe.
std::optional<estimator::WheelTie> Vio::Impl::wheelTie() const
{
  const WheelWay& way = wheels_since_keyframe;
  if (!way.valid || std::abs(way.duration - since_keyframe.duration()) > 1e-3)
  {
    return std::nullopt;
  }
  return estimator::WheelTie(way, options.wheels, wheel_monitor.scale());
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
                  : format(report->wheels.used ? "%.0f known landmarks in view, need %.0f: by IMU and wheels for %.2f s"
                                               : "%.0f known landmarks in view, need %.0f: by IMU only for %.2f s",
                           views, MIN_VIEWS, uncorrected_s);
    }
  }
  if (at_odds && seconds(stamp_ns - odds_since_ns) > MAX_ODDS_S)
  {
    // Landmarks and state will not agree again: both are kept, but the tracks between them are not.
    tracker.reset();
    odds_since_ns = 0;
  }
  if (uncorrected_s > options.max_blind_s && seconds(stamp_ns - by_wheels_ns) > BY_WHEELS_S)
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
  at_rest.fill(features);
}

void Vio::Impl::keepStill()
{
  filter.holdStill(still_state, still_covariance);
  if (seconds(features.stamp_ns - at_rest.front().stamp_ns) >= options.standstill.window_s)
  {
    std::rotate(at_rest.begin(), at_rest.end() - 1, at_rest.end());
    at_rest.front() = features;
  }
}

/// A pair at rest becomes a keyframe, tied to the one at which the rest began. Not the last pair: the detector looks
/// over a window, so when it notices, the body has moved for a while. That while is integrated.
/// @return false if the estimate was given up.
bool Vio::Impl::leaveStandstill(FrameReport* report)
{
  status = VioStatus::TRACKING;
  const NavState last = filter.state();
  const FrameFeatures& rested = at_rest[standstill.crept() ? AT_REST_BEFORE_CREEPING : AT_REST_BEFORE];
  if (rested.stamp_ns > keyframe_ns)
  {
    NavState state = last;
    state.v.setZero();
    state.stamp_ns = rested.stamp_ns;
    ImuSample from;
    from.stamp_ns = keyframe_ns;
    from.w = state.bias.gyro;
    from.f = state.q.conjugate() * Eigen::Vector3d(0.0, 0.0, options.imu.gravity) + state.bias.accel;
    ImuSample to = from;
    to.stamp_ns = state.stamp_ns;
    ImuPreintegration rest(options.imu, state.bias);
    rest.append(from, to);
    window.addKeyframe(state, rested, rest, true);
    optimize(budget.iterations(options.window.max_iterations), report);
    if (status != VioStatus::TRACKING)
    {
      return false;
    }
    const FrameFeatures now = std::exchange(features, rested);
    rememberKeyframe();
    features = now;
  }
  else
  {
    filter.reset(window.newest(), window.newestRelativeCovariance());
  }
  if (last.stamp_ns > keyframe_ns)
  {
    since_keyframe = ImuPreintegration(options.imu, filter.state().bias);
    wheels_since_keyframe = WheelWay();
    predict(imu.integrate(keyframe_ns, last.stamp_ns, filter.state().bias, nullptr), report);
  }
  const std::string wrong = failure(*report);
  if (!wrong.empty())
  {
    giveUp(wrong, report);
    return false;
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
    // Without a correction only new landmarks help, if there are some, and the way of the wheels.
    return views < 2 * MIN_VIEWS && (report.tracker.stereo >= MIN_NEW_LANDMARKS ||
                                     (report.wheels.used && since_s >= options.keyframe_max_interval_s));
  }
  double tracked_ratio = 0.0;
  const double parallax_px = parallaxSinceKeyframe(&tracked_ratio);
  const double longest_s = options.keyframe_max_interval_s * (parallax_px < SLOW_PARALLAX_PX ? SLOW_INTERVALS : 1.0);
  return report.inliers < FEW_VIEWS || since_s >= longest_s || parallax_px >= options.keyframe_parallax_px ||
         tracked_ratio < options.keyframe_tracked_ratio;
}

void Vio::Impl::addKeyframe(FrameReport* report)
{
  window.addKeyframe(filter.state(), features, since_keyframe, false, wheelTie());
  report->keyframe = true;
  optimize(budget.iterations(options.window.max_iterations), report);
  rememberKeyframe();
}

/// Optimises the window; the filter begins again from its newest state.
void Vio::Impl::optimize(int iterations, FrameReport* report)
{
  const auto begin = std::chrono::steady_clock::now();
  WindowReport optimized;
  window_stage.run([&] { optimized = window.optimize(iterations); });
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
  report->window_ms += 1e3 * secondsSince(begin);
}

void Vio::Impl::rememberKeyframe()
{
  keyframe_ns = window.empty() ? features.stamp_ns : window.newest().stamp_ns;
  keyframe_q = filter.state().q;
  since_keyframe = ImuPreintegration(options.imu, filter.state().bias);
  wheels_since_keyframe = WheelWay();
  keyframe_features.clear();
  for (const FeatureObservation& feature : features.features)
  {
    keyframe_features.emplace(feature.id, feature);
  }
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
    last_known_covariance = corrected->covariance;
    given_up_ns = last_known->stamp_ns;
  }
  status = corrected ? VioStatus::LOST : VioStatus::INITIALIZING;
  report->message = "estimate given up: " + why;
  report->reset = true;
  clearEstimate();
}

}  // namespace pi_slam
