#include "initialization/initializer.h"

#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <deque>

#include "initialization/inertial_alignment.h"
#include "initialization/stereo_odometry.h"

namespace pi_slam
{

namespace
{

constexpr size_t MOST_PAIRS = 20;               ///< in one attempt: bounds its time
constexpr double MIN_INLIER_RATIO = 0.4;        ///< of a pair's resection
constexpr double MIN_ADJUSTED_RATIO = 0.5;      ///< of all observations afterwards
constexpr double MAX_ROTATION_RMS = 0.01;       ///< of an interval, gyro against pictures [rad]
constexpr double MAX_GRAVITY_SIGMA = 0.026;     ///< 1.5 degrees [rad]
constexpr double MAX_VELOCITY_SIGMA = 0.1;      ///< [m/s]
constexpr double STILL_FLOW_PX = 2.0;           ///< beyond that nobody needs to look closer
constexpr double STILL_DISTANCE_M = 0.015;      ///< that pictures may see over the window of a start at rest
constexpr double STILL_ANGLE = 0.005;           ///< likewise [rad]
constexpr double STILL_GYRO_DEVIATION = 0.02;   ///< beyond the sensor's noise [rad/s]
constexpr double STILL_ACCEL_DEVIATION = 0.15;  ///< likewise [m/s^2]

using pi_node::format;
using pi_node::seconds;

/// Median distance that features went between two pairs in the same camera [px]; a large number for fewer than 8.
double medianFlow(const FrameFeatures& a, const FrameFeatures& b)
{
  std::vector<float> distances;
  auto first = a.features.begin();
  for (const FeatureObservation& feature : b.features)
  {
    first = std::lower_bound(first, a.features.end(), feature.id,
                             [](const FeatureObservation& candidate, int64_t id) { return candidate.id < id; });
    if (first == a.features.end())
    {
      break;
    }
    for (const int camera : {LEFT, RIGHT})
    {
      const float distance = (first->pixel[camera] - feature.pixel[camera]).norm();
      if (first->id == feature.id && first->seen[camera] && feature.seen[camera] && std::isfinite(distance))
      {
        distances.push_back(distance);
      }
    }
  }
  if (distances.size() < 8)
  {
    return 1e6;
  }
  const auto middle = distances.begin() + static_cast<long>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return *middle;
}

/// Without observations whose bearing is no unit vector.
FrameFeatures withoutBroken(FrameFeatures frame)
{
  for (FeatureObservation& feature : frame.features)
  {
    for (const int camera : {LEFT, RIGHT})
    {
      feature.seen[camera] = feature.seen[camera] && std::abs(feature.bearing[camera].squaredNorm() - 1.0) < 1e-3;
    }
  }
  const auto unseen = [](const FeatureObservation& feature) { return !feature.seen[LEFT] && !feature.seen[RIGHT]; };
  frame.features.erase(std::remove_if(frame.features.begin(), frame.features.end(), unseen), frame.features.end());
  return frame;
}

}  // namespace

void InitializerOptions::validate() const
{
  const pi_node::OptionCheck check("initializer");
  check.range("interval_s", interval_s, 0.02, 1.0);
  check.range("still_window_s", still_window_s, 0.2, 5.0);
  check.range("moving_window_s", moving_window_s, 0.5, 5.0);
  check.range("max_window_s", max_window_s, std::max(still_window_s, moving_window_s) + 2.0 * interval_s, 10.0);
  check.range("min_features", min_features, 8, 1000);
  check.positive("gravity_tolerance", gravity_tolerance);
  check.range("gravity_tolerance", gravity_tolerance, 0.0, 0.5);
  check.positive("max_accel_bias", max_accel_bias);
  check.positive("max_gyro_bias", max_gyro_bias);
}

struct Initializer::Impl
{
  Impl(const StereoCalibration& stereo, const ImuModel& imu_model, const InitializerOptions& initializer_options)
    : calibration(stereo), model(imu_model), options(initializer_options), odometry(stereo)
  {
    calibration.left.model.validate();
    calibration.right.model.validate();
    model.validate();
    options.validate();
  }

  Outcome add(const FrameFeatures& features, const ImuBuffer& imu, InitialSolution* solution);
  Outcome tryStill(const ImuBuffer& imu, InitialSolution* solution);
  Outcome tryMoving(const ImuBuffer& imu, InitialSolution* solution);
  Outcome integrate(const std::vector<FrameFeatures>& used, const ImuBuffer& imu,
                    std::vector<ImuPreintegration>* integrals);
  Outcome followPictures(const std::vector<FrameFeatures>& used, const std::vector<ImuPreintegration>& integrals);
  Outcome judge(const InertialAlignment& alignment, const std::vector<StereoOdometry::Pose>& poses);
  void forgetBefore(int64_t stamp_ns);
  Outcome refuse(Outcome outcome, const std::string& reason)
  {
    message = reason;
    return outcome;
  }

  /// Rotation from the body into odom with heading 0 along the horizontal direction of view.
  Eigen::Quaterniond levelBody(const Eigen::Vector3d& up_body) const
  {
    const Eigen::Matrix3d R_body_camera = calibration.left.T_body_camera.linear();
    const Eigen::Vector3d view = R_body_camera.col(2);
    // A camera that looks straight up or down has the upper edge of its picture in front.
    const bool upright = view.cross(up_body.normalized()).norm() > 0.1;
    return levelRotation(up_body, upright ? view : Eigen::Vector3d(-R_body_camera.col(1)));
  }

  const StereoCalibration calibration;
  const ImuModel model;
  const InitializerOptions options;
  StereoOdometry odometry;
  std::deque<FrameFeatures> pairs;
  Eigen::Vector3d gyro_bias_guess = Eigen::Vector3d::Zero();
  int64_t last_ns = 0;
  bool any = false;
  std::string message;
};

Initializer::Outcome Initializer::Impl::add(const FrameFeatures& features, const ImuBuffer& imu,
                                            InitialSolution* solution)
{
  const int64_t stamp_ns = features.stamp_ns;
  if (any && stamp_ns <= last_ns)
  {
    pairs.clear();  // a clock that jumped back
  }
  any = true;
  last_ns = stamp_ns;
  // Pairs come at their own rate: a tenth of the interval early still counts.
  if (!pairs.empty() && stamp_ns - pairs.back().stamp_ns < std::llround(1e9 * (0.9 * options.interval_s)))
  {
    return Outcome::COLLECTING;
  }
  if (imu.empty() || imu.lastNs() < stamp_ns || imu.firstNs() > stamp_ns)
  {
    return refuse(Outcome::NO_IMU,
                  imu.empty() ? std::string("initializer: there are no samples of the IMU")
                              : format("initializer: samples of the IMU reach from %.3f to %.3f s of the pair's stamp, "
                                       "must reach over it; are the clocks of camera and IMU the same?",
                                       seconds(imu.firstNs() - stamp_ns), seconds(imu.lastNs() - stamp_ns)));
  }
  FrameFeatures pair = withoutBroken(features);
  const StereoOdometry::Triangulated stereo = odometry.countStereo(pair);
  if (stereo.valid < options.min_features)
  {
    return refuse(
        Outcome::FEW_FEATURES,
        format("initializer: %.0f features of the pair can be placed by stereo, of %.0f that both cameras "
               "see, must be %.0f; is there light and texture, are the cameras swapped or their calibration wrong?",
               stereo.valid, stereo.matched, options.min_features));
  }
  pairs.push_back(std::move(pair));
  forgetBefore(std::max<int64_t>(stamp_ns - std::llround(1e9 * options.max_window_s), imu.firstNs()));
  const double span_s = seconds(stamp_ns - pairs.front().stamp_ns);
  if (span_s >= 0.95 * options.still_window_s)
  {
    const Outcome outcome = tryStill(imu, solution);
    if (outcome != Outcome::COLLECTING)
    {
      return outcome;
    }
  }
  return span_s >= 0.95 * options.moving_window_s ? tryMoving(imu, solution) : Outcome::COLLECTING;
}

/// COLLECTING: not at rest.
Initializer::Outcome Initializer::Impl::tryStill(const ImuBuffer& imu, InitialSolution* solution)
{
  const int64_t to_ns = pairs.back().stamp_ns;
  const auto first = std::find_if(pairs.rbegin(), pairs.rend(),
                                  [&](const FrameFeatures& pair) {
                                    return to_ns - pair.stamp_ns >= std::llround(1e9 * (0.95 * options.still_window_s));
                                  });
  const auto begin = first.base() - 1;
  Eigen::Vector3d w, f, w_deviation, f_deviation;
  if (!imu.statistics(begin->stamp_ns, to_ns, &w, &f, &w_deviation, &f_deviation))
  {
    return Outcome::COLLECTING;
  }
  const double root_rate = std::sqrt(model.rate_hz);
  if (w_deviation.maxCoeff() > STILL_GYRO_DEVIATION + root_rate * model.gyro_noise_density ||
      f_deviation.maxCoeff() > STILL_ACCEL_DEVIATION + root_rate * model.accel_noise_density ||
      medianFlow(*begin, pairs.back()) > STILL_FLOW_PX)
  {
    return Outcome::COLLECTING;
  }
  std::vector<FrameFeatures> used(begin, pairs.end());
  odometry.start(used.front());
  for (size_t k = 1; k < used.size(); ++k)
  {
    if (odometry.append(used[k], Eigen::Quaterniond::Identity()) < MIN_INLIER_RATIO)
    {
      return Outcome::COLLECTING;
    }
  }
  odometry.adjust();
  for (const StereoOdometry::Pose& pose : odometry.poses())
  {
    if (!(pose.p.norm() < STILL_DISTANCE_M) || !(pose.q.vec().norm() < 0.5 * STILL_ANGLE))
    {
      return Outcome::COLLECTING;
    }
  }

  const double excess = f.norm() - model.gravity;
  const double bound = std::min(options.max_accel_bias, options.gravity_tolerance * model.gravity);
  if (std::abs(excess) > bound)
  {
    return refuse(Outcome::NOT_CONSISTENT,
                  format("initializer: mean force at rest is %.3f m/s^2, must be within %.3f of %.3f; is the "
                         "accelerometer's scale or unit right?",
                         f.norm(), bound, model.gravity));
  }
  if (w.norm() > options.max_gyro_bias)
  {
    return refuse(Outcome::NOT_CONSISTENT, format("initializer: mean rate at rest is %.3f rad/s, must be at most %.3f; "
                                                  "is the gyro's unit rad/s?",
                                                  w.norm(), options.max_gyro_bias));
  }
  NavState state;
  state.q = levelBody(f);
  state.bias.gyro = w;
  state.bias.accel = excess * f.normalized();
  solution->states.clear();
  for (const FrameFeatures& pair : used)
  {
    state.stamp_ns = pair.stamp_ns;
    solution->states.push_back(state);
  }
  solution->frames = std::move(used);
  solution->still = true;
  return Outcome::DONE;
}

/// Rotations, then positions, of pictures and IMU are brought together.
Initializer::Outcome Initializer::Impl::tryMoving(const ImuBuffer& imu, InitialSolution* solution)
{
  // The newest pairs, thinned out if there are too many.
  std::vector<FrameFeatures> used;
  const size_t stride = (pairs.size() + MOST_PAIRS - 1) / MOST_PAIRS;
  for (size_t i = (pairs.size() - 1) % stride; i < pairs.size(); i += stride)
  {
    used.push_back(pairs[i]);
  }
  std::vector<ImuPreintegration> integrals;
  Outcome outcome = integrate(used, imu, &integrals);
  if (outcome == Outcome::DONE)
  {
    outcome = followPictures(used, integrals);
  }
  if (outcome != Outcome::DONE)
  {
    return outcome;
  }
  const std::vector<StereoOdometry::Pose>& poses = odometry.poses();
  double rotation_rms = 0.0;
  const Eigen::Vector3d gyro_bias = alignRotations(poses, &integrals, &rotation_rms);
  if (!(rotation_rms <= MAX_ROTATION_RMS))
  {
    return refuse(Outcome::NOT_CONSISTENT,
                  format("initializer: gyro and pictures differ by %.4f rad per interval, must be at most %.4f; is the "
                         "rotation or the time between camera and IMU wrong?",
                         rotation_rms, MAX_ROTATION_RMS));
  }
  if (!(gyro_bias.norm() <= options.max_gyro_bias))
  {
    return refuse(Outcome::NOT_CONSISTENT, format("initializer: bias of the gyro is %.3f rad/s, must be at most %.3f",
                                                  gyro_bias.norm(), options.max_gyro_bias));
  }
  gyro_bias_guess = gyro_bias;
  const InertialAlignment alignment = alignPositions(poses, integrals, model.gravity);
  outcome = judge(alignment, poses);
  if (outcome != Outcome::DONE)
  {
    return outcome;
  }
  const Eigen::Quaterniond q_odom_ref = levelBody(-alignment.gravity);
  solution->states.clear();
  for (size_t k = 0; k < poses.size(); ++k)
  {
    NavState state;
    state.stamp_ns = used[k].stamp_ns;
    state.p = q_odom_ref * poses[k].p;
    state.q = (q_odom_ref * poses[k].q).normalized();
    state.v = q_odom_ref * alignment.velocities[k];
    state.bias.gyro = gyro_bias;
    state.bias.accel = alignment.accel_bias;
    solution->states.push_back(state);
  }
  solution->frames = std::move(used);
  solution->still = false;
  return Outcome::DONE;
}

void Initializer::Impl::forgetBefore(int64_t stamp_ns)
{
  while (pairs.front().stamp_ns < stamp_ns)
  {
    pairs.pop_front();
  }
}

/// The IMU between neighbouring pairs. DONE: without gap and saturation.
Initializer::Outcome Initializer::Impl::integrate(const std::vector<FrameFeatures>& used, const ImuBuffer& imu,
                                                  std::vector<ImuPreintegration>* integrals)
{
  for (size_t k = 1; k < used.size(); ++k)
  {
    ImuBuffer::Quality quality;
    integrals->push_back(imu.integrate(used[k - 1].stamp_ns, used[k].stamp_ns,
                                       ImuBias{gyro_bias_guess, Eigen::Vector3d::Zero()}, &quality));
    if (!quality.complete || quality.gap_s > 0.0 || quality.saturated)
    {
      forgetBefore(used[k].stamp_ns);  // what is before can no longer be joined
      return quality.saturated
                 ? refuse(Outcome::NOT_CONSISTENT,
                          "initializer: the IMU is saturated (imu/gyro_limit, imu/accel_limit)")
                 : refuse(Outcome::NO_IMU, format("initializer: samples of the IMU have a gap of %.3f s, must be at "
                                                  "most %.3f",
                                                  quality.gap_s, imu.longestInterval()));
    }
  }
  return Outcome::DONE;
}

/// Visual odometry over the pairs. DONE: most features agree with one motion and one scene.
Initializer::Outcome Initializer::Impl::followPictures(const std::vector<FrameFeatures>& used,
                                                       const std::vector<ImuPreintegration>& integrals)
{
  odometry.start(used.front());
  Eigen::Quaterniond last_error = Eigen::Quaterniond::Identity();
  for (size_t k = 1; k < used.size(); ++k)
  {
    // A bias not known yet turns the next interval as it did the last one.
    const double inliers = odometry.append(used[k], integrals[k - 1].deltaR() * last_error);
    if (inliers < MIN_INLIER_RATIO)
    {
      forgetBefore(used[k].stamp_ns);
      return refuse(
          Outcome::NOT_CONSISTENT,
          format("initializer: %.0f %% of the features of a pair agree with one motion, must be %.0f; do most "
                 "of them move, or is the calibration of the cameras wrong?",
                 100.0 * std::max(0.0, inliers), 100.0 * MIN_INLIER_RATIO));
    }
    const std::vector<StereoOdometry::Pose>& poses = odometry.poses();
    last_error = integrals[k - 1].deltaR().conjugate() * rotationBetween(poses[k - 1], poses[k]);
  }
  const double adjusted = odometry.adjust();
  if (adjusted < MIN_ADJUSTED_RATIO)
  {
    return refuse(Outcome::NOT_CONSISTENT,
                  format("initializer: %.0f %% of the observations agree with one scene, must be %.0f; is the "
                         "calibration of the cameras wrong?",
                         100.0 * adjusted, 100.0 * MIN_ADJUSTED_RATIO));
  }
  return Outcome::DONE;
}

/// DONE: gravity, biases and residuals are plausible, and known well enough.
Initializer::Outcome Initializer::Impl::judge(const InertialAlignment& alignment,
                                              const std::vector<StereoOdometry::Pose>& poses)
{
  const double bound = std::min(options.max_accel_bias, options.gravity_tolerance * model.gravity);
  if (!alignment.solvable || std::abs(alignment.gravity_found - model.gravity) > bound)
  {
    return refuse(Outcome::NOT_CONSISTENT,
                  format("initializer: gravity is found to be %.3f m/s^2, must be within %.3f of %.3f",
                         alignment.gravity_found, bound, model.gravity));
  }
  double way_m = 0.0;
  for (size_t k = 1; k < poses.size(); ++k)
  {
    way_m += (poses[k].p - poses[k - 1].p).norm();
  }
  if (alignment.accel_bias.norm() > options.max_accel_bias)
  {
    return refuse(Outcome::NOT_CONSISTENT,
                  format("initializer: bias of the accelerometer is %.3f m/s^2, must be at most %.3f",
                         alignment.accel_bias.norm(), options.max_accel_bias));
  }
  const double max_rms = 0.01 + 0.01 * way_m;
  if (alignment.position_rms > max_rms)
  {
    return refuse(Outcome::NOT_CONSISTENT,
                  format("initializer: positions of pictures and IMU differ by %.3f m, must be at most %.3f",
                         alignment.position_rms, max_rms));
  }
  if (alignment.gravity_sigma > MAX_GRAVITY_SIGMA || alignment.velocity_sigma > MAX_VELOCITY_SIGMA)
  {
    return refuse(Outcome::NOT_CONSISTENT,
                  format("initializer: gravity is known to %.4f rad and velocity to %.3f m/s so far, must be %.4f and "
                         "%.3f",
                         alignment.gravity_sigma, alignment.velocity_sigma, MAX_GRAVITY_SIGMA, MAX_VELOCITY_SIGMA));
  }
  return Outcome::DONE;
}

Initializer::Initializer(const StereoCalibration& calibration, const ImuModel& model, const InitializerOptions& options)
  : impl_(std::make_unique<Impl>(calibration, model, options))
{
}

Initializer::~Initializer() = default;

Initializer::Outcome Initializer::add(const FrameFeatures& features, const ImuBuffer& imu, InitialSolution* solution)
{
  return impl_->add(features, imu, solution);
}

const std::string& Initializer::message() const
{
  return impl_->message;
}

void Initializer::reset()
{
  impl_->pairs.clear();
  impl_->any = false;
  impl_->gyro_bias_guess.setZero();
  impl_->message.clear();
}

}  // namespace pi_slam
