#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/power_monitor.h>
#include "ros/remote_tasks.h"
#include <pi_runtime/runtime.h>
#include <ros/node_handle.h>

#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace pi_runtime
{

/// What /diagnostics says of the runtime: one status per unit (ERROR: failed; WARN: deadlines missed since the last
/// time), one of the scheduler, one of power and temperatures. One thread at a time.
class RuntimeDiagnostics
{
public:
  /// @param private_node  with the parameter diagnostic_period.
  /// @param tasks  outlives it.
  RuntimeDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node, std::shared_ptr<Runtime> runtime,
                     const RemoteTasks* tasks);

  /// Looks at everything and publishes.
  void update();

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;
  struct UnitView
  {
    UnitStatus now;
    double busy_s = 0.0;  ///< at the previous update
    uint64_t missed = 0;  ///< likewise
  };

  void reportUnit(const UnitView& unit, Status& status) const;
  void reportScheduler(Status& status) const;
  void reportPower(Status& status);

  const std::shared_ptr<Runtime> runtime_;
  const RemoteTasks* const tasks_;
  diagnostic_updater::Updater updater_;
  pi_node::PowerMonitor power_;
  std::map<std::string, UnitView> units_;  ///< the units of a runtime never change
  RuntimeStatistics statistics_{};
  uint64_t missed_ = 0;  ///< at the previous update
  std::chrono::steady_clock::time_point updated_at_;
  double interval_s_ = 0.0;  ///< between the last two updates
};

}  // namespace pi_runtime
