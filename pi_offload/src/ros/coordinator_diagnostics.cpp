#include "ros/coordinator_diagnostics.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace pi_offload
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

}  // namespace

CoordinatorDiagnostics::CoordinatorDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                                               const pi_node::WarningBoard* warnings, double input_timeout_s)
  : warnings_(warnings)
  , input_timeout_s_(input_timeout_s)
  , updater_(node, private_node, private_node.getNamespace())
  , updated_at_(Clock::now())
{
  updater_.setHardwareID("none");
  updater_.add("offloading", [this](Status& status) { reportOffloading(status); });
  updater_.add("nodes", [this](Status& status) { reportNodes(status); });
  updater_.add("input", [this](Status& status) { reportInput(status); });
}

void CoordinatorDiagnostics::update(const CoordinatorFigures& figures)
{
  const Clock::time_point now = Clock::now();
  interval_s_ = std::chrono::duration<double>(now - updated_at_).count();
  updated_at_ = now;
  now_ = figures;
  updater_.setHardwareID(now_.vehicle);
  updater_.force_update();
  before_ = std::move(now_);
}

void CoordinatorDiagnostics::reportOffloading(Status& status) const
{
  uint64_t tasks = 0;
  uint64_t missed = 0;
  uint64_t remote = 0;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    const auto& now = now_.statistics.of_kind[kind];
    const auto& before = before_.statistics.of_kind[kind];
    tasks += now.tasks - before.tasks;
    missed += now.missed - before.missed;
    remote += now.remote - before.remote;
  }
  if (!now_.enabled)
  {
    status.summary(DiagnosticStatus::WARN, "switched off: the vehicle does everything; enable switches it on");
  }
  else if (missed > 0)
  {
    status.summary(DiagnosticStatus::WARN, std::to_string(missed) + " deadlines missed since the last report");
  }
  else if (tasks == 0)
  {
    status.summary(DiagnosticStatus::OK, "no tasks");
  }
  else
  {
    status.summary(DiagnosticStatus::OK, std::to_string(remote) + " of " + std::to_string(tasks) +
                                             " tasks done by nodes since the last report");
  }
  status.add("enabled", now_.enabled);
  status.add("policy", now_.policy);
  status.add("eta", format("%.2f", now_.eta));
  status.add("vehicle", now_.vehicle);
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    const auto& of_kind = now_.statistics.of_kind[kind];
    const std::string name = toString(static_cast<TaskKind>(kind));
    status.add(name + ": last", now_.last_node[kind].empty() ? "the vehicle" : now_.last_node[kind]);
    status.add(name + ": tasks", of_kind.tasks);
    status.add(name + ": local", of_kind.local);
    status.add(name + ": remote", of_kind.remote);
    status.add(name + ": fallback", of_kind.fallback);
    status.add(name + ": abandoned", of_kind.abandoned);
    status.add(name + ": missed", of_kind.missed);
    status.add(name + ": handovers", of_kind.handovers);
    status.add(name + ": energy [J]", format("%.1f", of_kind.energy_j));
    status.add(name + ": response, p50 [ms]", format("%.1f", 1e3 * now_.p50_s[kind]));
    status.add(name + ": response, p99 [ms]", format("%.1f", 1e3 * now_.p99_s[kind]));
  }
  status.add("JPEG [ms per 10^6 pixels]", format("%.1f", now_.jpeg_ms_per_mpixel));
  status.add("JPEG [bytes per pixel]", format("%.3f", now_.jpeg_bytes_per_pixel));
  status.add("stage offload_encode", now_.encoding);
}

void CoordinatorDiagnostics::reportNodes(Status& status) const
{
  const auto connected = std::count_if(now_.nodes.begin(), now_.nodes.end(),
                                       [](const OffloadEngine::NodeStatus& node) { return node.connected; });
  const bool needs_position = std::any_of(now_.nodes.begin(), now_.nodes.end(),
                                          [](const auto& node) { return std::isfinite(node.description.range_m); });
  const auto untrusted = std::find_if(now_.checks.begin(), now_.checks.end(),
                                      [](const auto& check) { return !check.second.reason.empty(); });
  if (untrusted != now_.checks.end())
  {
    status.summary(DiagnosticStatus::ERROR, "node " + untrusted->first + ": " + untrusted->second.reason);
  }
  else if (needs_position && !now_.position_known)
  {
    status.summary(DiagnosticStatus::WARN, "position " + now_.position + ": nodes of finite range are not used");
  }
  else
  {
    status.summary(DiagnosticStatus::OK,
                   std::to_string(connected) + " of " + std::to_string(now_.nodes.size()) + " nodes connected");
  }
  status.add("position", now_.position);
  for (const OffloadEngine::NodeStatus& node : now_.nodes)
  {
    const std::string& id = node.description.id;
    const auto link = now_.links.find(id);
    std::string text = node.description.address + ", ";
    if (link != now_.links.end() && !link->second.up)
    {
      text += "not connected" + (link->second.problem.empty() ? "" : ": " + link->second.problem);
    }
    else
    {
      text += std::string(node.connected ? "connected" : "does not answer") + (node.in_range ? "" : ", out of range") +
              format(", round trip %.1f ms", 1e3 * node.round_trip_s) + format(", %.1f Mbit/s", node.uplink_mbps);
      text += link != now_.links.end() && !link->second.model.empty() ? ", network " + link->second.model : "";
    }
    status.add(id, text + ", sent " + std::to_string(node.sent) + ", answered " + std::to_string(node.answered) +
                       ", late " + std::to_string(node.late) + ", refused " + std::to_string(node.refused) + ", lost " +
                       std::to_string(node.lost) + checksOf(id));
  }
}

/// Answers that were checked or came unasked.
std::string CoordinatorDiagnostics::checksOf(const std::string& id) const
{
  std::string text;
  const auto check = now_.checks.find(id);
  if (check != now_.checks.end() && check->second.checked > 0)
  {
    text += ", checked on board " + std::to_string(check->second.checked) + ", disagreed " +
            std::to_string(check->second.disagreed);
  }
  const auto link = now_.links.find(id);
  text += link != now_.links.end() && link->second.unasked > 0
              ? ", unasked answers ignored " + std::to_string(link->second.unasked)
              : "";
  return text + (check != now_.checks.end() && !check->second.reason.empty() ? "; " + check->second.reason : "");
}

void CoordinatorDiagnostics::reportInput(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_->recent();
  if (!warnings.empty())
  {
    status.summary(warnings.front().error ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, warnings.front().text);
  }
  else if (!now_.subscribed)
  {
    status.summary(DiagnosticStatus::OK, "nobody listens, " + now_.topic + " is not subscribed");
  }
  else if (now_.silent_s > input_timeout_s_)
  {
    status.summary(DiagnosticStatus::WARN, "nothing on " + now_.topic + format(" for %.1f s", now_.silent_s) +
                                               "; check that the camera runs and that the topic is its");
  }
  else if (now_.model.empty() || !now_.detector_listens)
  {
    status.summary(DiagnosticStatus::WARN, now_.model.empty()
                                               ? "the vehicle's detector has not said its network on local/labels"
                                               : "the vehicle's detector does not listen to local/image");
  }
  else
  {
    status.summary(DiagnosticStatus::OK, now_.topic + " comes");
  }
  const double rate = interval_s_ > 0.0 ? static_cast<double>(now_.pictures - before_.pictures) / interval_s_ : 0.0;
  status.add("pictures in [Hz]", format("%.1f", rate));
  status.add("pictures that came", now_.pictures);
  status.add("pictures dropped as too many came at once", now_.crowded);
  status.add("results dropped: after their deadline and a later one", now_.late);
  status.add("results that wait for older ones", now_.held);
  status.add("pictures that wait for the vehicle's detector", now_.waiting);
  status.add("network of the vehicle's detector", now_.model.empty() ? "not known" : now_.model);
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_offload
