#include "odometry/vio_impl.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_slam/so3.h>

#include <cmath>

namespace pi_slam
{
namespace
{

constexpr double MARGIN_S = 0.1;  ///< more than a correction of the time offset

/// What was taken over.
std::string describe(const RigReport& found)
{
  using pi_node::format;
  const ImuCorrection& used = found.used;
  const Eigen::Vector3d turn = -logSo3(Eigen::Quaterniond(used.R_body_imu)) * 180.0 / M_PI;
  std::string text = format(
      "calibration: the cameras are %.1f ms late (+- %.1f) and turned by %.2f, %.2f, %.2f degrees about the IMU's axes",
      1e3 * used.late_s, 1e3 * found.lateDeviation(), turn.x(), turn.y(), turn.z());
  const Eigen::Vector3d p = 1e3 * used.p_body_imu;
  text += p.isZero() ? std::string() : format(", the IMU lies %.1f, %.1f, %.1f mm off", p.x(), p.y(), p.z());
  const Eigen::Vector3d off = 100.0 * (used.gyro_scale - Eigen::Vector3d::Ones());
  text += off.isZero() ? std::string()
                       : format(", the gyroscope says %.1f, %.1f, %.1f %% too much", off.x(), off.y(), off.z());
  return text + ", beyond what is configured; taken over; calibration/refined_camchain and refined_imu keep it";
}

}  // namespace

void Vio::Impl::refineCalibration(FrameReport* report)
{
  if (options.refine_calibration && status != VioStatus::STANDSTILL)
  {
    rig.add(features, imu);
    // The samples since the newest keyframe are integrated again.
    const bool covered = status != VioStatus::TRACKING || pi_node::seconds(keyframe_ns - imu.firstNs()) > MARGIN_S;
    if (const std::optional<ImuCorrection> due = covered ? rig.take() : std::nullopt)
    {
      correctImu(*due);
      if (status == VioStatus::TRACKING)
      {
        correctEstimate(*due, report);
      }
      else if (status == VioStatus::BLIND)
      {
        giveUp("the calibration was wrong", report);
      }
      else
      {
        initializer.reset();
      }
      report->message = describe(rig.report());
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
  due.correct(&inbox);
  imu.correct(due);
  propagator.correct(due);
  newest_imu_ns += std::llround(1e9 * due.late_s);
}

/// The window keeps its keyframes; what the IMU says between them is integrated again.
void Vio::Impl::correctEstimate(const ImuCorrection& due, FrameReport* report)
{
  const int64_t now_ns = filter.state().stamp_ns;
  // Cameras that are early want samples that have not come yet.
  ImuBuffer samples = imu;
  samples.holdUntil(now_ns);
  window.correct(due, samples);
  optimize(options.window.max_iterations, report);
  if (status != VioStatus::TRACKING)
  {
    return;
  }
  keyframe_q = filter.state().q;
  if (now_ns > keyframe_ns)
  {
    since_keyframe = samples.integrate(keyframe_ns, now_ns, filter.state().bias, nullptr);
    filter.predict(since_keyframe);
    filter.update(viewsOfKnown(), MIN_VIEWS);
  }
}

}  // namespace pi_slam
