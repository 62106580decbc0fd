#include "ros/vio_diagnostics.h"
#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/vehicle_clock.h>

#include <algorithm>
#include <boost/asio/ip/host_name.hpp>
#include <cmath>
#include <numeric>
#include <utility>

namespace pi_slam
{
namespace
{

using pi_node::format;

using diagnostic_msgs::DiagnosticStatus;

constexpr size_t KEPT_FRAMES = 1000;
constexpr size_t KEPT_IMU_SAMPLES = 2000;
constexpr double LONGEST_GAP_S = 0.02;  // at 200 Hz, four poses
constexpr double LOST_PICTURES_PER_S = 0.5;

void addEstimate(const char* what, const Eigen::Vector3d& value, const Eigen::Vector3d& deviation,
                 diagnostic_updater::DiagnosticStatusWrapper* status)
{
  status->add(what, format("%.2f, %.2f, %.2f +- %.2f, %.2f, %.2f", value.x(), value.y(), value.z(), deviation.x(),
                           deviation.y(), deviation.z()));
}

}  // namespace

VioDiagnostics::VioDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                               const pi_node::WarningBoard* warnings, double input_timeout_s)
  : warnings_(warnings)
  , input_timeout_s_(input_timeout_s)
  , updater_(node, private_node, private_node.getNamespace())
  , updated_at_ns_(pi_node::vehicleNs())
  , frame_ms_(KEPT_FRAMES)
  , imu_ms_(KEPT_IMU_SAMPLES)
{
  updater_.setHardwareID(boost::asio::ip::host_name());
  updater_.add("odometry", [this](Status& status) { reportOdometry(status); });
  updater_.add("inputs", [this](Status& status) { reportInputs(status); });
  updater_.add("map", [this](Status& status) { reportMap(status); });
}

void VioDiagnostics::addFrame(const FrameReport& report)
{
  std::lock_guard<std::mutex> lock(mutex_);
  frame_ = report;
  if (report.processed)
  {
    ++frames_;
    frame_ms_.add(static_cast<float>(report.total_ms));
    late_frames_ +=
        frame_stamp_ns_ != 0 && report.total_ms > 1e-6 * static_cast<double>(report.stamp_ns - frame_stamp_ns_);
    frame_stamp_ns_ = report.stamp_ns;
  }
  resets_ += report.reset ? 1 : 0;
}

void VioDiagnostics::addImu(double work_ms)
{
  std::lock_guard<std::mutex> lock(mutex_);
  imu_ms_.add(static_cast<float>(work_ms));
  const auto now = std::chrono::steady_clock::now();
  const double gap_s = odometry_at_ ? std::chrono::duration<double>(now - *odometry_at_).count() : 0.0;
  odometry_at_ = now;
  longest_gap_s_ = std::max(longest_gap_s_, gap_s);
  gaps_ += gap_s > LONGEST_GAP_S;
}

void VioDiagnostics::reset()
{
  std::lock_guard<std::mutex> lock(mutex_);
  frame_.reset();
  frame_stamp_ns_ = 0;
  odometry_at_.reset();
}

void VioDiagnostics::update(const VioFigures& figures)
{
  const int64_t now_ns = pi_node::vehicleNs();
  interval_s_ = pi_node::secondsBetween(updated_at_ns_, now_ns);
  updated_at_ns_ = now_ns;
  now_ = figures;
  updater_.force_update();
  before_ = std::move(now_);
}

void VioDiagnostics::reportOdometry(Status& status)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const VioStatus state = frame_ ? frame_->status : VioStatus::INITIALIZING;
  std::string summary = frame_ ? toString(state) : "no pictures yet";
  if (frame_)
  {
    summary += ", " + std::to_string(frame_->inliers) + " of " + std::to_string(frame_->features) + " features agree";
    summary += format(", %.1f ms per pair", frame_ms_.mean());
  }
  if (!now_.problem.empty())
  {
    status.summary(now_.failed ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, now_.problem);
  }
  else if (state == VioStatus::TRACKING || state == VioStatus::STANDSTILL)
  {
    const std::string complaint = frame_->wheels.known ? scaleComplaint(frame_->wheels.scale) : "";
    status.summary(complaint.empty() ? DiagnosticStatus::OK : DiagnosticStatus::WARN,
                   complaint.empty() ? summary : complaint);
  }
  else
  {
    status.summary(state == VioStatus::LOST ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, summary);
  }
  const double rate = interval_s_ > 0.0 ? static_cast<double>(now_.odometries - before_.odometries) / interval_s_ : 0.0;
  status.add("state", frame_ ? toString(state) : "none");
  status.add("odometry [Hz]", format("%.1f", rate));
  status.add("IMU sample to odometry, mean [ms]", format("%.3f", imu_ms_.mean()));
  status.add("IMU sample to odometry, p99 [ms]", format("%.3f", imu_ms_.quantile(0.99)));
  status.add("frame time, mean [ms]", format("%.2f", frame_ms_.mean()));
  status.add("frame time, p99 [ms]", format("%.2f", frame_ms_.quantile(0.99)));
  status.add("pairs used", frames_);
  status.add("pairs that took longer than a frame", late_frames_);
  status.add("longest time between two odometries [ms]", format("%.1f", 1e3 * std::exchange(longest_gap_s_, 0.0)));
  status.add("times over 20 ms between two odometries", gaps_);
  status.add("resets", resets_);
  for (const auto& [name, text] : now_.stages)
  {
    status.add("stage " + name, text);
  }
  if (frame_)
  {
    status.add("front end [ms]", format("%.2f", frame_->front_end_ms));
    status.add("front end, processor time [ms]", format("%.2f", frame_->front_end_cpu_ms));
    status.add("front end, waited [ms]",
               format("%.2f", std::max(0.0, frame_->front_end_ms - frame_->front_end_cpu_ms)));
    status.add("filter [ms]", format("%.2f", frame_->filter_ms));
    status.add("window [ms]", format("%.2f", frame_->window_ms));
    status.add("features", frame_->features);
    status.add("inliers", frame_->inliers);
    if (const WheelReport& wheels = frame_->wheels; wheels.known)
    {
      status.add("wheels", wheels.used ? "used" : wheels.slipping ? "slip, not used" : "not used");
      status.add("scale of the wheels", format("%.4f +- %.4f", wheels.scale.value, wheels.scale.deviation));
      status.add("slips of the wheels", wheels.slips);
    }
    status.add("features in stereo", frame_->tracker.stereo);
    status.add("landmarks", frame_->landmarks);
    status.add("reduced to keep up", frame_->reduced ? "yes" : "no");
    status.add("mean grey level left", format("%.1f", frame_->tracker.mean_grey[LEFT]));
    status.add("mean grey level right", format("%.1f", frame_->tracker.mean_grey[RIGHT]));
  }
}

void VioDiagnostics::reportInputs(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_->recent();
  const VioFigures::Input* silent = nullptr;
  for (const VioFigures::Input& input : now_.inputs)
  {
    silent = silent == nullptr && input.silent_s > input_timeout_s_ ? &input : silent;
  }
  if (!warnings.empty())
  {
    status.summary(warnings.front().error ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, warnings.front().text);
  }
  else if (silent != nullptr)
  {
    status.summary(DiagnosticStatus::WARN, "nothing on " + silent->topic);
  }
  else if (const uint64_t single = now_.single_pictures - std::min(now_.single_pictures, before_.single_pictures);
           interval_s_ > 0.0 && static_cast<double>(single) > LOST_PICTURES_PER_S * interval_s_)
  {
    status.summary(DiagnosticStatus::WARN,
                   format("%.1f pictures per second come without their partner: they are lost on their way; check "
                          "the cameras' links and the load of the computer",
                          static_cast<double>(single) / interval_s_));
  }
  else
  {
    status.summary(DiagnosticStatus::OK, "all inputs come");
  }
  for (size_t i = 0; i < now_.inputs.size(); ++i)
  {
    const VioFigures::Input& input = now_.inputs[i];
    const uint64_t before = i < before_.inputs.size() ? before_.inputs[i].messages : 0;
    const double rate = interval_s_ > 0.0 ? static_cast<double>(input.messages - before) / interval_s_ : 0.0;
    status.add(input.topic + " [Hz]", format("%.1f", rate));
  }
  status.add("pairs dropped to keep up", now_.dropped_pairs);
  status.add("pictures too late", now_.late_pictures);
  status.add("pictures without partner", now_.single_pictures);
  status.add("pictures behind the IMU [s]", format("%.4f", now_.delay_s));
  const RigReport& rig = now_.rig;
  status.add("cameras are late, estimated [ms]", format("%.2f +- %.2f", 1e3 * rig.late_s, 1e3 * rig.lateDeviation()));
  status.add("cameras are late, taken over [ms]", format("%.2f", 1e3 * rig.used.late_s));
  addEstimate("cameras are turned, estimated [deg]", rig.turn * 180.0 / M_PI, rig.turnDeviation() * 180.0 / M_PI,
              &status);
  addEstimate("IMU lies beside its place, estimated [mm]", 1e3 * rig.p_body_imu, 1e3 * rig.p_body_imu_deviation,
              &status);
  addEstimate("gyroscope says too much, estimated [%]", 100.0 * (rig.gyro_scale - Eigen::Vector3d::Ones()),
              100.0 * rig.gyro_scale_deviation, &status);
  pi_node::addWarnings(warnings, &status);
}

void VioDiagnostics::reportMap(Status& status) const
{
  if (!now_.map)
  {
    status.summary(DiagnosticStatus::OK, "no map");
    return;
  }
  const MapStatistics& map = *now_.map;
  if (map.loaded && !map.localized)
  {
    status.summary(DiagnosticStatus::WARN, "map loaded, no place in it recognised yet");
  }
  else if (!map.disk_defect.empty())
  {
    status.summary(DiagnosticStatus::WARN, "places of the map were lost: " + map.disk_defect);
  }
  else
  {
    status.summary(DiagnosticStatus::OK,
                   std::to_string(map.keyframes) + " keyframes, " + std::to_string(map.landmarks) + " landmarks");
  }
  status.add("keyframes", map.keyframes);
  status.add("keyframes in memory", map.keyframes_in_memory);
  status.add("landmarks", map.landmarks);
  status.add("memory [MiB]", format("%.1f", static_cast<double>(map.bytes) / (1024.0 * 1024.0)));
  status.add("tiles on disk [MiB]", format("%.1f", static_cast<double>(map.bytes_on_disk) / (1024.0 * 1024.0)));
  status.add("places recognised again", map.loops);
  status.add("loaded from a file", map.loaded ? "yes" : "no");
  status.add("localised", map.localized ? "yes" : "no");
  if (map.fixes > 0 || map.on_earth)
  {
    status.add("positions by GNSS", map.fixes);
  }
  if (map.on_earth)
  {
    const auto& origin = map.on_earth->origin;
    status.add("origin of the map on earth",
               format("%.7f, %.7f degrees, %.1f m", origin.latitude_deg, origin.longitude_deg, origin.height_m));
    status.add("its x axis, from east to north [deg]", format("%.2f", 180.0 / M_PI * map.on_earth->heading_rad));
  }
  status.add("time of the last frame [ms]", format("%.2f", map.last_add_ms));
  status.add("frames skipped to keep up", map.skipped);
}

}  // namespace pi_slam
