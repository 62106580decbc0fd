#include "ros/runtime_diagnostics.h"
#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace pi_runtime
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

std::string hostName()
{
  char name[256] = "";
  gethostname(name, sizeof name - 1);
  return name;
}

std::string missedText(uint64_t missed)
{
  return std::to_string(missed) + (missed == 1 ? " deadline missed" : " deadlines missed");
}

}  // namespace

RuntimeDiagnostics::RuntimeDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                                       std::shared_ptr<Runtime> runtime, const RemoteTasks* tasks)
  : runtime_(std::move(runtime))
  , tasks_(tasks)
  , updater_(node, private_node)
  , updated_at_(std::chrono::steady_clock::now())
{
  updater_.setHardwareID(hostName());
  for (const UnitStatus& unit : runtime_->units())
  {
    UnitView& view = units_[unit.name];
    view = {unit, unit.busy_s, unit.missed_deadlines};
    updater_.add("unit " + unit.name, [this, &view](Status& status) { reportUnit(view, status); });
  }
  missed_ = runtime_->statistics().missed_deadlines;
  updater_.add("scheduler", [this](Status& status) { reportScheduler(status); });
  updater_.add("power", [this](Status& status) { reportPower(status); });
}

void RuntimeDiagnostics::update()
{
  const auto now = std::chrono::steady_clock::now();
  interval_s_ = std::chrono::duration<double>(now - updated_at_).count();
  updated_at_ = now;
  for (UnitStatus& unit : runtime_->units())
  {
    units_[unit.name].now = std::move(unit);
  }
  statistics_ = runtime_->statistics();
  updater_.force_update();
  for (auto& [name, unit] : units_)
  {
    unit.busy_s = unit.now.busy_s;
    unit.missed = unit.now.missed_deadlines;
  }
  missed_ = statistics_.missed_deadlines;
}

void RuntimeDiagnostics::reportUnit(const UnitView& unit, Status& status) const
{
  const UnitStatus& now = unit.now;
  // Not UnitStatus::utilisation: each caller of units() starts a new interval.
  const double utilisation = interval_s_ > 0.0 ? std::clamp((now.busy_s - unit.busy_s) / interval_s_, 0.0, 1.0) : 0.0;
  const uint64_t missed = now.missed_deadlines - unit.missed;
  if (now.failed)
  {
    status.summary(DiagnosticStatus::ERROR, now.failure);
  }
  else if (missed > 0)
  {
    status.summary(DiagnosticStatus::WARN, missedText(missed));
  }
  else
  {
    status.summary(DiagnosticStatus::OK, format("%.0f %% busy", 100.0 * utilisation));
  }
  status.add("type", toString(now.type));
  status.add("device", now.device);
  status.add("scheduling", now.scheduling);
  status.add("utilisation", format("%.3f", utilisation));
  status.add("queued", now.queued);
  status.add("running", now.running);
  status.add("load [s]", now.load_s);
  status.add("tasks", now.tasks);
  status.add("failures", now.failures);
  status.add("stolen", now.stolen);
  status.add("deadline tasks", now.deadline_tasks);
  status.add("missed deadlines", now.missed_deadlines);
  status.add("missed deadlines since last", missed);
  status.add("blocking budget [s]", now.blocking_budget_s);
}

void RuntimeDiagnostics::reportScheduler(Status& status) const
{
  const uint64_t missed = statistics_.missed_deadlines - missed_;
  const std::string policy = toString(runtime_->interCoreOptions().policy);
  status.summary(missed > 0 ? DiagnosticStatus::WARN : DiagnosticStatus::OK,
                 missed > 0 ? missedText(missed) : "policy " + policy);
  status.add("inter-core policy", policy);
  status.add("inner-core policy", toString(runtime_->innerCoreOptions().policy));
  status.add("submitted", statistics_.submitted);
  status.add("ended well", statistics_.ended_ok);
  status.add("cancelled", statistics_.cancelled);
  status.add("refused", statistics_.refused);
  status.add("failed", statistics_.failed);
  status.add("missed deadlines", statistics_.missed_deadlines);
  status.add("missed deadlines since last", missed);
  status.add("predictions", statistics_.prediction_error.count);
  status.add("prediction error p50", statistics_.prediction_error.p50);
  status.add("prediction error p95", statistics_.prediction_error.p95);
  status.add("streams", runtime_->streams().size());
  status.add("open tasks from messages", tasks_->openTasks());
  status.add("kept reports", tasks_->keptReports());
}

void RuntimeDiagnostics::reportPower(Status& status)
{
  const pi_node::PowerReading reading = power_.read();
  std::string summary;
  const auto mention = [&summary](const std::string& text) { summary += (summary.empty() ? "" : ", ") + text; };
  for (const pi_node::PowerReading::Power& power : reading.powers)
  {
    status.add("power " + power.name + " [W]", power.watts);
    status.add("energy " + power.name + " [J]", power.joules);
    mention(power.name + format(" %.1f W", power.watts));
  }
  for (const pi_node::PowerReading::Battery& battery : reading.batteries)
  {
    status.add("battery " + battery.name + " [W]", battery.watts);
    status.add("battery " + battery.name + " charge", battery.charge);
    mention(battery.name + format(" %.0f %%", 100.0 * battery.charge));
  }
  double hottest = -INFINITY;
  for (const pi_node::PowerReading::Temperature& temperature : reading.temperatures)
  {
    status.add("temperature " + temperature.name + " [degC]", temperature.celsius);
    hottest = std::max(hottest, temperature.celsius);
  }
  if (std::isfinite(hottest))
  {
    mention(format("%.0f degC", hottest));
  }
  for (const pi_node::PowerReading::Frequency& frequency : reading.frequencies)
  {
    status.add("frequency of core " + std::to_string(frequency.core) + " [Hz]", frequency.hertz);
  }
  for (const pi_node::PowerMonitor::Unreadable& sensor : power_.unreadable())
  {
    status.add("unreadable " + sensor.path, sensor.reason);
  }
  status.summary(DiagnosticStatus::OK, summary.empty() ? "this machine has no sensors that can be read" : summary);
}

}  // namespace pi_runtime
