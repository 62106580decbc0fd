#include "estimator/consistency_run.h"

#include <pi_slam/imu_simulator.h>
#include <pi_slam/so3.h>
#include "front_end/frame_filter.h"
#include "front_end/rolling_shutter.h"
#include "inertial/imu_preintegration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

using namespace pi_slam;

namespace
{

NavState truthAt(const SplineTrajectory& trajectory, int64_t stamp_ns, const ImuBias& bias)
{
  const SplineTrajectory::State truth = trajectory.at(stamp_ns);
  NavState state;
  state.stamp_ns = stamp_ns;
  state.p = truth.T_world_body.translation();
  state.q = Eigen::Quaterniond(truth.T_world_body.linear()).normalized();
  state.v = truth.v_world;
  state.bias = bias;
  return state;
}

ConsistencySample compare(const NavState& truth, const NavState& state, const Matrix15d& covariance)
{
  ConsistencySample sample;
  const Vector15d error = truth.boxMinus(state);
  sample.nees_pose = error.head<6>().dot(covariance.topLeftCorner<6, 6>().llt().solve(error.head<6>()));
  sample.nees_position = error.head<3>().dot(covariance.topLeftCorner<3, 3>().llt().solve(error.head<3>()));
  sample.nees_rotation = error.segment<3>(3).dot(covariance.block<3, 3>(3, 3).llt().solve(error.segment<3>(3)));
  const Eigen::Vector3d up = state.q.conjugate() * Eigen::Vector3d::UnitZ();
  sample.nees_heading = std::pow(up.dot(error.segment<3>(3)), 2) / (up.dot(covariance.block<3, 3>(3, 3) * up));
  sample.nees_state = error.dot(covariance.llt().solve(error));
  sample.position_error_m = error.head<3>().norm();
  sample.rotation_error_rad = error.segment<3>(3).norm();
  return sample;
}

}  // namespace

SplineTrajectory consistencyTrajectory(double duration_s)
{
  std::vector<StampedPose> poses;
  for (double t = 0.0; t <= duration_s + 0.5; t += 0.1)
  {
    StampedPose pose;
    pose.stamp_ns = static_cast<int64_t>(std::llround(1e9 * t));
    const double phase = 0.35 * t;
    pose.T_world_body.translation() =
        Eigen::Vector3d(5.0 * std::sin(phase), 3.0 * std::sin(2.0 * phase), 0.5 * std::sin(0.9 * t));
    const double heading = std::atan2(6.0 * std::cos(2.0 * phase), 5.0 * std::cos(phase));
    pose.T_world_body.linear() = (Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(0.15 * std::sin(1.3 * t), Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(0.15 * std::sin(1.7 * t), Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    poses.push_back(pose);
  }
  return SplineTrajectory::fit(poses, 0.1);
}

std::vector<ConsistencySample> runConsistency(const SplineTrajectory& trajectory, const ConsistencyOptions& options,
                                              uint64_t seed)
{
  ImuSimulatorOptions imu_options;
  imu_options.seed = seed;
  const int64_t start_ns = trajectory.startNs();
  const int64_t end_ns = start_ns + static_cast<int64_t>(std::llround(1e9 * options.duration_s));
  std::vector<ImuBias> biases;
  const std::vector<ImuSample> samples = ImuSimulator(imu_options).simulate(trajectory, start_ns, end_ns, &biases);
  const ImuModel model;
  ImuBuffer imu(model);
  for (const ImuSample& sample : samples)
  {
    imu.add(sample);
  }
  const auto biasAt = [&](int64_t stamp_ns)
  {
    const double index = 1e-9 * static_cast<double>(stamp_ns - start_ns) * imu_options.rate_hz;
    return biases[static_cast<size_t>(std::lround(index))];
  };

  SimulatedFeaturesOptions feature_options;
  feature_options.pixel_noise = options.pixel_noise;
  feature_options.readout_s = options.readout_s;
  feature_options.landmarks = 900;
  feature_options.seed = seed;
  SimulatedFeatures world(trajectory, options.calibration, feature_options);

  Vector15d deviation;
  deviation << Eigen::Vector3d::Constant(1e-3), Eigen::Vector3d::Constant(2e-3), Eigen::Vector3d::Constant(0.05),
      Eigen::Vector3d::Constant(2e-3), Eigen::Vector3d::Constant(0.03);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Vector15d error;
  for (int i = 0; i < 15; ++i)
  {
    error(i) = deviation(i) * normal(random);
  }
  NavState state = truthAt(trajectory, start_ns, biases.front());
  state.boxPlus(error);
  const Matrix15d covariance = deviation.cwiseAbs2().asDiagonal();

  WindowOptions window_options = options.window;
  window_options.pixel_noise = options.pixel_noise;
  window_options.huber_px *= options.pixel_noise;
  window_options.max_error_px *= options.pixel_noise;
  WindowEstimator window(options.calibration, model, window_options);
  FrameFilter filter(options.calibration, options.pixel_noise);
  const RollingShutter shutter(options.calibration, options.readout_s);
  const auto straighten = [&](FrameFeatures* features, const NavState& last)
  {
    Eigen::Vector3d w, f, w_deviation, f_deviation;
    const int64_t from_ns = std::max(features->stamp_ns - 20000000, start_ns);
    if (options.straighten && imu.statistics(from_ns, from_ns + 20000000, &w, &f, &w_deviation, &f_deviation))
    {
      shutter.correct(w - last.bias.gyro, last.q.conjugate() * last.v, features);
    }
  };
  FrameFeatures features = world.at(start_ns);
  straighten(&features, state);
  window.start(state, covariance, features);
  window.optimize(window_options.max_iterations);
  filter.reset(window.newest(), window.newestRelativeCovariance());
  Matrix15d common = window.newestCovariance() - window.newestRelativeCovariance();

  std::vector<ConsistencySample> result;
  ImuPreintegration since_keyframe(model, filter.state().bias);
  const int64_t interval_ns = static_cast<int64_t>(std::llround(1e9 * options.pair_interval_s));
  int pair = 0;
  for (int64_t stamp_ns = start_ns + interval_ns; stamp_ns <= end_ns; stamp_ns += interval_ns)
  {
    const ImuPreintegration since_pair = imu.integrate(stamp_ns - interval_ns, stamp_ns, filter.state().bias, nullptr);
    filter.predict(since_pair);
    since_keyframe.append(since_pair);
    features = world.at(stamp_ns);
    straighten(&features, filter.state());
    std::vector<LandmarkView> views;
    for (const FeatureObservation& feature : features.features)
    {
      const LandmarkEstimate* const landmark = window.landmark(feature.id);
      for (int camera : {LEFT, RIGHT})
      {
        if (landmark != nullptr && feature.seen[camera])
        {
          views.push_back(
              LandmarkView{feature.id, camera, feature.bearing[camera], landmark->p_odom, landmark->covariance});
        }
      }
    }
    filter.update(views, 10);
    const NavState truth = truthAt(trajectory, stamp_ns, biasAt(stamp_ns));
    result.push_back(compare(truth, filter.state(), filter.covariance() + common));
    ++pair;
    if (pair % options.pairs_per_keyframe == 0)
    {
      window.addKeyframe(filter.state(), features, since_keyframe, false);
      if (window.optimize(window_options.max_iterations).failed)
      {
        throw std::runtime_error("the optimisation of the window failed");
      }
      filter.reset(window.newest(), window.newestRelativeCovariance());
      common = window.newestCovariance() - window.newestRelativeCovariance();
      since_keyframe = ImuPreintegration(model, filter.state().bias);
      result.push_back(compare(truth, window.newest(), window.newestCovariance()));
      result.back().keyframe = true;
    }
    result.back().time_s = 1e-9 * static_cast<double>(stamp_ns - start_ns);
  }
  return result;
}
