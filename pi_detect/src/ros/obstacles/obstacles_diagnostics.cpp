#include "ros/obstacles/obstacles_diagnostics.h"
#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/vehicle_clock.h>

#include <boost/asio/ip/host_name.hpp>
#include <cmath>
#include <utility>

namespace pi_detect
{
namespace
{

using pi_node::format;

using diagnostic_msgs::DiagnosticStatus;

constexpr double NEAR_ENOUGH_M = 2.0;

std::string finite(const char* pattern, double value)
{
  return std::isfinite(value) ? format(pattern, value) : "none";
}

}  // namespace

std::string nearLimitText(double nearest_visible_m)
{
  if (nearest_visible_m <= NEAR_ENOUGH_M)
  {
    return "";
  }
  return "obstacles nearer than " + format("%.1f", nearest_visible_m) +
         " m before the vehicle are not measured: lower stereo/nearest_distance_m; with source: disparity, let its "
         "matcher search more disparities; else the baseline is too long for the picture's width";
}

ObstaclesDiagnostics::ObstaclesDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                                           const pi_node::WarningBoard* warnings, double input_timeout_s,
                                           double min_coverage)
  : warnings_(warnings)
  , input_timeout_s_(input_timeout_s)
  , min_coverage_(min_coverage)
  , updater_(node, private_node, private_node.getNamespace())
  , updated_at_ns_(pi_node::vehicleNs())
{
  updater_.setHardwareID(boost::asio::ip::host_name());
  updater_.add("obstacles", [this](Status& status) { reportObstacles(status); });
  updater_.add("input", [this](Status& status) { reportInput(status); });
  updater_.add("motion", [this](Status& status) { reportMotion(status); });
}

void ObstaclesDiagnostics::addPair(const PairFigures& pair)
{
  std::lock_guard<std::mutex> lock(mutex_);
  pair_ = pair;
  ++pairs_;
  latency_ms_.add(1e3 * pair.latency_s);
  rectify_ms_.add(1e3 * pair.rectify_s);
  stereo_ms_.add(1e3 * pair.stereo_s);
  track_ms_.add(1e3 * pair.track_s);
}

void ObstaclesDiagnostics::update(const ObstaclesFigures& figures)
{
  const int64_t now_ns = pi_node::vehicleNs();
  interval_s_ = pi_node::secondsBetween(updated_at_ns_, now_ns);
  updated_at_ns_ = now_ns;
  now_ = figures;
  updater_.force_update();
  before_ = std::move(now_);
}

void ObstaclesDiagnostics::reportObstacles(Status& status)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const double rate = interval_s_ > 0.0 ? static_cast<double>(pairs_ - pairs_before_) / interval_s_ : 0.0;
  pairs_before_ = pairs_;
  if (!now_.problem.empty())
  {
    status.summary(now_.failed ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, now_.problem);
  }
  else if (!now_.subscribed)
  {
    status.summary(DiagnosticStatus::OK, "nobody listens");
  }
  else if (!pair_)
  {
    status.summary(DiagnosticStatus::WARN, "no pair yet");
  }
  else if (pair_->coverage < min_coverage_)
  {
    status.summary(DiagnosticStatus::WARN, format("%.0f %% of the picture has a disparity", 100.0 * pair_->coverage) +
                                               ": dark, covered or dirty lenses, or another pair's calibration; " +
                                               "no obstacles are published");
  }
  else if (const std::string limit = nearLimitText(pair_->nearest_visible_m); !limit.empty())
  {
    status.summary(DiagnosticStatus::WARN, limit);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, std::to_string(pair_->obstacles) + " obstacles, nearest " +
                                             finite("%.1f m", pair_->nearest_m) + format(", %.1f pairs/s", rate));
  }
  status.add("pairs [Hz]", format("%.1f", rate));
  status.add("pairs worked on", pairs_);
  status.add("stamp to published, p50 [ms]", format("%.1f", latency_ms_.quantile(0.5)));
  status.add("stamp to published, p99 [ms]", format("%.1f", latency_ms_.quantile(0.99)));
  status.add("rectify, mean [ms]", format("%.2f", rectify_ms_.mean()));
  status.add("stereo, mean [ms]", format("%.2f", stereo_ms_.mean()));
  status.add("track, mean [ms]", format("%.2f", track_ms_.mean()));
  for (const auto& [name, text] : now_.stages)
  {
    status.add("stage " + name, text);
  }
  if (pair_)
  {
    status.add("coverage [%]", format("%.1f", 100.0 * pair_->coverage));
    status.add("nearest visible [m]", format("%.2f", pair_->nearest_visible_m));
    status.add("ground measured", pair_->ground_measured ? "yes" : "no");
    status.add("obstacles", pair_->obstacles);
    status.add("nearest [m]", finite("%.2f", pair_->nearest_m));
    status.add("time to collision [s]", finite("%.2f", pair_->time_to_collision_s));
    status.add("age of the tracks [s]", pair_->track_age_s ? format("%.3f", *pair_->track_age_s) : "none");
  }
}

void ObstaclesDiagnostics::reportInput(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_->recent();
  std::string missing;
  for (const ObstaclesFigures::Input& input : now_.inputs)
  {
    if (now_.subscribed && input.required && input.silent_s > input_timeout_s_)
    {
      missing += (missing.empty() ? "" : ", ") + input.topic;
    }
  }
  if (!warnings.empty() && warnings.front().error)
  {
    status.summary(DiagnosticStatus::ERROR, warnings.front().text);
  }
  else if (!missing.empty())
  {
    status.summary(DiagnosticStatus::WARN, "nothing on " + missing);
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, now_.subscribed ? "all inputs come" : "nobody listens");
  }
  for (size_t i = 0; i < now_.inputs.size(); ++i)
  {
    const ObstaclesFigures::Input& input = now_.inputs[i];
    const uint64_t before = i < before_.inputs.size() ? before_.inputs[i].messages : 0;
    const double rate = interval_s_ > 0.0 ? static_cast<double>(input.messages - before) / interval_s_ : 0.0;
    status.add(input.topic + " [Hz]", format("%.1f", rate));
  }
  status.add("pairs dropped for newer ones", now_.dropped);
  status.add("pairs left out for max_rate_hz", now_.left_out);
  status.add("pictures without partner", now_.single);
  pi_node::addWarnings(warnings, &status);
}

void ObstaclesDiagnostics::reportMotion(Status& status) const
{
  if (now_.motion_problem.empty())
  {
    status.summary(DiagnosticStatus::OK, now_.motion_known ? "velocities are over the ground" : "not needed yet");
  }
  else
  {
    status.summary(DiagnosticStatus::WARN,
                   now_.motion_problem + (now_.motion_known ? "" : "; velocities are relative to the vehicle"));
  }
  status.add("velocities over the ground", now_.motion_known ? "yes" : "no");
}

}  // namespace pi_detect
