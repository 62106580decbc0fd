#include "odometry/vio_impl.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_slam/so3.h>

#include <cmath>

namespace pi_slam
{
namespace
{

constexpr double GRAVITY_PART = 0.5;     ///< of what a wrong tilt does to the force, that the bias may have taken
constexpr double GYRO_DEVIATION = 1e-3;  ///< of a bias that was estimated beside a wrong mounting [rad/s]
constexpr double LEAST_SPEED_DEVIATION = 0.05;  ///< [m/s]

}  // namespace

void Vio::Impl::refineCalibration(FrameReport* report)
{
  if (options.refine_calibration && status != VioStatus::STANDSTILL)
  {
    rig.add(features, imu);
    if (const std::optional<ImuCorrection> due = rig.take())
    {
      correctImu(*due);
      if (status == VioStatus::TRACKING)
      {
        beginAgain(*due, report);
      }
      else if (status == VioStatus::BLIND)
      {
        giveUp("the calibration was wrong", report);
      }
      else
      {
        initializer.reset();
      }
      const RigReport found = rig.report();
      const Eigen::Vector3d turn = -logSo3(Eigen::Quaterniond(found.used.R_body_imu)) * 180.0 / M_PI;
      report->message = pi_node::format(
          "calibration: the cameras are %.1f ms late (+- %.1f) and turned by %.2f, %.2f, %.2f degrees about the IMU's "
          "axes, beyond what is configured; taken over; calibration/refined_camchain keeps it",
          1e3 * found.used.late_s, 1e3 * found.late_deviation_s, turn.x(), turn.y(), turn.z());
    }
  }
  const std::lock_guard<std::mutex> lock(output_mutex);
  rig_report = rig.report();
}

/// Of samples that are here already, and of those to come.
void Vio::Impl::correctImu(const ImuCorrection& due)
{
  const std::lock_guard<std::mutex> lock(inbox_mutex);
  imu_correction = due.after(imu_correction);
  for (ImuSample& sample : inbox)
  {
    sample = due(sample);
  }
  imu.correct(due);
  propagator.correct(due);
  newest_imu_ns += std::llround(1e9 * due.late_s);
}

/// The window was made with the calibration of before: it begins again from its newest state. The body is where the
/// cameras say, so its tilt changes by what their mounting was off; the heading, which nothing tells, stays.
void Vio::Impl::beginAgain(const ImuCorrection& due, FrameReport* report)
{
  NavState state = filter.state();
  const Eigen::Quaterniond before = state.q;
  const Eigen::Quaterniond tilted = before * Eigen::Quaterniond(due.R_body_imu.transpose());
  const Eigen::Matrix3d turn = (tilted * before.conjugate()).toRotationMatrix();
  const double heading = std::atan2(turn(1, 0) - turn(0, 1), turn(0, 0) + turn(1, 1));
  state.q = (Eigen::AngleAxisd(-heading, Eigen::Vector3d::UnitZ()) * tilted).normalized();
  state.v = state.q * (before.conjugate() * state.v);
  state.bias.gyro = due.R_body_imu * state.bias.gyro;
  state.bias.accel = due.R_body_imu * state.bias.accel;

  const double angle = logSo3(Eigen::Quaterniond(due.R_body_imu)).norm();
  const double speed = LEAST_SPEED_DEVIATION + options.imu.gravity * std::abs(due.late_s) + angle * state.v.norm();
  Vector15d deviation;
  deviation << Eigen::Vector3d::Zero(), Eigen::Vector3d::Constant(0.3 * angle), Eigen::Vector3d::Constant(speed),
      Eigen::Vector3d::Constant(GYRO_DEVIATION),
      Eigen::Vector3d::Constant(GRAVITY_PART * options.imu.gravity * (angle + std::abs(due.late_s)));
  Matrix15d covariance = filter.covariance() + common_covariance;
  covariance.diagonal() += deviation.cwiseAbs2();
  window.start(state, covariance, features);
  filter.reset(state, window.newestRelativeCovariance());
  common_covariance = covariance - window.newestRelativeCovariance();
  optimize(options.window.max_iterations, report);
  standstill.reset();
  strikes.clear();
  if (status == VioStatus::TRACKING)
  {
    report->keyframe = true;
    rememberKeyframe();
  }
}

}  // namespace pi_slam
