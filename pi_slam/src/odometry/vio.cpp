#include "odometry/vio_impl.h"

#include "inertial/imu_step.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_slam/so3.h>

#include <chrono>
#include <cmath>

namespace pi_slam
{
namespace
{

using pi_node::format;
using pi_node::seconds;
using pi_node::secondsSince;

constexpr double LONGEST_GAP_S = 0.2;  ///< of the IMU, after which there is no pose before pictures have corrected it
constexpr double LEAST_RATE_S = 0.02;  ///< over which the body's rate is averaged
constexpr double WHEELS_KEPT_S = 6.0;
constexpr double IMU_KEPT_S = 12.0;  ///< of samples, for the initialiser and long gaps

}  // namespace

std::optional<PropagatedState> Vio::Impl::addImu(ImuSample sample)
{
  const int64_t own_stamp_ns = sample.stamp_ns;
  const int64_t before_ns = inbox_check.empty() ? 0 : inbox_check.lastNs();
  const ImuBuffer::Added added = inbox_check.add(sample);
  if (added != ImuBuffer::Added::OUT_OF_ORDER && added != ImuBuffer::Added::NOT_FINITE)
  {
    // Limits are those of the sensor's own axes.
    newest_raw = sample = withoutSaturation(sample, newest_raw ? &*newest_raw : nullptr, options.imu);
    vibration.add(&sample);
  }
  {
    const std::lock_guard<std::mutex> lock(inbox_mutex);
    switch (added)
    {
      case ImuBuffer::Added::OUT_OF_ORDER:
        imu_message = format("imu/data: stamp goes back by %.4f s, sample ignored; check the driver's clock",
                             seconds(before_ns - own_stamp_ns));
        break;
      case ImuBuffer::Added::NOT_FINITE:
        imu_message = "imu/data: a sample is not finite, ignored; check the driver";
        break;
      case ImuBuffer::Added::GAP:
        imu_message = format("imu/data: gap of %.3f s, bridged by interpolation; check load and transport",
                             seconds(own_stamp_ns - before_ns));
        break;
      case ImuBuffer::Added::SATURATED:
        imu_message = "imu/data: an axis is at the sensor's limit, the pose gets inaccurate; choose a wider range";
        break;
      case ImuBuffer::Added::OK:
        imu_message = imu_message.empty() ? vibration.message() : imu_message;
        break;
    }
    if (added == ImuBuffer::Added::OUT_OF_ORDER || added == ImuBuffer::Added::NOT_FINITE)
    {
      return std::nullopt;
    }
    // Inside, all stamps are those of the cameras, and the body is as they are mounted.
    sample.stamp_ns -= std::llround(1e9 * options.imu.time_offset_s);
    sample = imu_correction(sample, inbox_newest ? &*inbox_newest : nullptr);
    inbox_newest = sample;
    inbox.push_back(sample);
  }
  inbox_check.forgetBefore(own_stamp_ns);
  newest_imu_ns.store(sample.stamp_ns, std::memory_order_release);
  if (added == ImuBuffer::Added::GAP && seconds(own_stamp_ns - before_ns) > LONGEST_GAP_S)
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

void Vio::Impl::addWheels(const WheelSample& sample)
{
  {
    const std::lock_guard<std::mutex> lock(inbox_mutex);
    wheel_inbox.push_back(sample);
  }
  propagator.addWheels(sample);
}

/// Forgets everything but the samples of IMU and wheels.
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
  wheels_since_keyframe = WheelWay();
  wheel_monitor.skip();
}

void Vio::Impl::takeInbox()
{
  taken.clear();
  {
    const std::lock_guard<std::mutex> lock(inbox_mutex);
    std::swap(taken, inbox);
    taken_wheels.clear();
    std::swap(taken_wheels, wheel_inbox);
  }
  for (const WheelSample& sample : taken_wheels)
  {
    wheels.add(sample);
  }
  for (const ImuSample& sample : taken)
  {
    imu.add(sample);
  }
}

FrameReport Vio::Impl::addPair(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right)
{
  const auto begin = std::chrono::steady_clock::now();
  FrameReport report;
  report.stamp_ns = stamp_ns;
  report.status = status;
  takeInbox();
  const bool running = status != VioStatus::INITIALIZING && status != VioStatus::LOST;
  const bool silent = running && stamp_ns > last_pair_ns && imu.lastNs() < stamp_ns;
  if (silent)
  {
    bridgeImu(stamp_ns);
  }
  report.message = whyUnusable(stamp_ns, running);
  if (!report.message.empty())
  {
    return report;
  }
  if (silent)
  {
    report.message = format(
        "imu/data: newest sample is %.3f s older than the pair, odometry goes on by pictures alone; "
        "check that the IMU runs",
        seconds(stamp_ns - newest_imu_ns.load(std::memory_order_acquire)));
  }

  ImuPreintegration since_pair(options.imu, filter.state().bias);
  if (last_pair_ns != INT64_MIN && imu.firstNs() <= last_pair_ns)
  {
    since_pair = imu.integrate(last_pair_ns, stamp_ns, running ? filter.state().bias : ImuBias(), nullptr);
  }

  const Eigen::Quaterniond q_before = filter.state().q;
  const TrackerPrediction prediction = predictViews(since_pair, running);
  front_end_stage.run(
      [&]
      {
        const double begin_cpu_s = pi_node::cpuSeconds();
        runFrontEnd(left, right, prediction, stamp_ns, &report);
        report.front_end_cpu_ms = 1e3 * (pi_node::cpuSeconds() - begin_cpu_s);
      });
  if (options.readout_s > 0.0)
  {
    straighten(running);
  }
  report.front_end_ms = 1e3 * secondsSince(begin);
  last_pair_ns = stamp_ns;
  if (running)
  {
    track(since_pair, &report);
    last_rate = logSo3(q_before.conjugate() * filter.state().q) / since_pair.duration();
  }
  else
  {
    turnLastKnown(stamp_ns);
    start(&report);
  }
  refineCalibration(&report);
  if (status == VioStatus::TRACKING && report.keyframe && keyframe_callback)
  {
    offerToMap(stamp_ns, left, right);
  }
  report.status = status;
  imu.forgetBefore(stamp_ns - std::llround(1e9 * IMU_KEPT_S));
  wheels.forgetBefore(stamp_ns - std::llround(1e9 * WHEELS_KEPT_S));
  publish();
  report.total_ms = 1e3 * secondsSince(begin);
  budget.update(1e-3 * report.total_ms);
  return report;
}

/// Pictures come on without the IMU. A sample stands in for it that says that the body goes on as it did, and is no
/// measurement: so the pictures decide.
void Vio::Impl::bridgeImu(int64_t stamp_ns)
{
  const NavState& state = filter.state();
  const Eigen::Quaterniond R_body_odom = state.q.conjugate();
  ImuSample sample;
  sample.stamp_ns = stamp_ns;
  sample.w = last_rate + state.bias.gyro;
  sample.f = last_rate.cross(R_body_odom * state.v) + R_body_odom * Eigen::Vector3d(0.0, 0.0, options.imu.gravity) +
             state.bias.accel;
  if (const std::optional<WheelSample> turn = wheels.mean(last_pair_ns, stamp_ns);
      turn && wheel_monitor.fault().empty())
  {
    const Eigen::Vector3d up = options.wheels.T_body_wheels.linear().col(2);
    sample.w += (turn->yaw_rate - up.dot(last_rate)) * up;
  }
  sample.saturated = true;
  imu.add(sample);
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
    if (status != VioStatus::BLIND && odds_since_ns == 0)
    {
      prediction.p_last_now = filter.state().q.conjugate() * (predicted.p - filter.state().p);
    }
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
    report->message =
        (camera == LEFT ? left : right).empty()
            ? which + " missing: it was lost on its way, or its camera is silent"
            : which + format(" without content (mean grey %.0f, contrast %.1f); check lens cap, light and exposure",
                             tracked.mean_grey[camera], tracked.contrast[camera]);
  }
}

/// Takes what rolling shutters saw to the time of the stamp.
void Vio::Impl::straighten(bool running)
{
  Eigen::Vector3d w, f, w_deviation, f_deviation;
  const int64_t stamp_ns = features.stamp_ns;
  if (imu.statistics(stamp_ns - std::llround(1e9 * std::max(options.readout_s, LEAST_RATE_S)), stamp_ns, &w, &f,
                     &w_deviation, &f_deviation))
  {
    const NavState& last = filter.state();
    shutter.correct(running ? Eigen::Vector3d(w - last.bias.gyro) : w,
                    running ? Eigen::Vector3d(last.q.conjugate() * last.v) : Eigen::Vector3d::Zero(), &features);
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

/// The results for other threads.
void Vio::Impl::publish()
{
  const bool running = status != VioStatus::INITIALIZING && status != VioStatus::LOST;
  PropagatedState state;
  if (running)
  {
    state.state = filter.state();
    state.covariance = filter.covariance() + common_covariance + displacedCovariance(state.state);
    propagator.rebase(state.state, state.covariance);
    propagator.setWheels(options.wheels,
                         wheel_monitor.fault().empty() ? std::optional(wheel_monitor.scale()) : std::nullopt);
  }
  const std::lock_guard<std::mutex> lock(output_mutex);
  if (running)
  {
    corrected = state;
  }
  shown_features = features;
}

Vio::Vio(const StereoCalibration& calibration, const VioOptions& options, std::shared_ptr<pi_runtime::Runtime> runtime,
         const RigReport& found)
{
  options.validate();
  impl_ = std::make_unique<Impl>(calibration, options, std::move(runtime), found);
}

Vio::~Vio() = default;

std::optional<PropagatedState> Vio::addImu(const ImuSample& sample)
{
  return impl_->addImu(sample);
}

void Vio::addWheels(const WheelSample& sample)
{
  impl_->addWheels(sample);
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

RigReport Vio::rig() const
{
  const std::lock_guard<std::mutex> lock(impl_->output_mutex);
  return impl_->rig_report;
}

std::vector<std::pair<std::string, std::string>> Vio::stages() const
{
  return {{"slam_front_end", impl_->front_end_stage.status().text()},
          {"slam_window", impl_->window_stage.status().text()}};
}

void Vio::setKeyframeCallback(std::function<void(const MapFrame&)> callback)
{
  impl_->keyframe_callback = std::move(callback);
}

}  // namespace pi_slam
