#include "vehicle/fault_schedule.h"

namespace pi_simulation
{

FaultSchedule::FaultSchedule(const std::vector<PlannedFault>& faults)
{
  for (const PlannedFault& fault : faults)
  {
    entries_.push_back({fault});
  }
}

std::vector<DueCommand> FaultSchedule::due(double time, const Eigen::Vector2d& vehicle)
{
  const auto there = [&vehicle](const PlannedFault& fault)
  { return !fault.near || (vehicle - *fault.near).norm() <= fault.within; };
  std::vector<DueCommand> commands;
  for (Entry& entry : entries_)
  {
    const PlannedFault& fault = entry.fault;
    const bool over = fault.duration > 0.0 ? time >= entry.began + fault.duration : !there(fault);
    if (entry.phase == Phase::ACTIVE && !fault.end.empty() && over)
    {
      entry.phase = Phase::OVER;
      commands.push_back({fault.end, true});
    }
  }
  for (Entry& entry : entries_)
  {
    if (entry.phase == Phase::WAITING && time >= entry.fault.time && there(entry.fault))
    {
      entry.phase = Phase::ACTIVE;
      entry.began = time;
      commands.push_back({entry.fault.begin, false});
    }
  }
  return commands;
}

}  // namespace pi_simulation
