#pragma once

#include "vehicle/scenario.h"

#include <Eigen/Core>
#include <string>
#include <vector>

namespace pi_simulation
{

struct DueCommand
{
  std::string line;
  bool restores = false;  ///< the end of a fault
};

/// Which commands of a scenario's faults are due. Deterministic; not thread safe.
class FaultSchedule
{
public:
  explicit FaultSchedule(const std::vector<PlannedFault>& faults);

  /// @param time  since the start, not before that of the last call [s]. @param vehicle  its reference point [m].
  /// @return what is due since the last call, ends before begins.
  std::vector<DueCommand> due(double time, const Eigen::Vector2d& vehicle);

private:
  enum class Phase
  {
    WAITING,
    ACTIVE,
    OVER,
  };
  struct Entry
  {
    PlannedFault fault;
    Phase phase = Phase::WAITING;
    double began = 0.0;  ///< [s]
  };

  std::vector<Entry> entries_;
};

}  // namespace pi_simulation
