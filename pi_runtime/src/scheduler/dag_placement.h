#pragma once

#include <cstdint>
#include <vector>

#include <pi_runtime/dag_plan.h>
#include "units/unit_timeline.h"

namespace pi_runtime
{

/// A plan under construction: what is placed so far, and where a further node would go. Shared by the policies of the
/// inner-core scheduler. Nodes are placed predecessors first.
class DagPlacement
{
public:
  /// Where a node would run, or runs.
  struct Place
  {
    uint32_t unit;
    UnitTimeline::Slot slot;  // finish = +infinity: the unit cannot run the node
    double finish() const { return slot.finish; }
  };

  /// Begins an empty plan. All arguments must outlive the construction.
  /// @param plan  with one entry per node in unit, start, finish.
  void begin(const TaskGraph& graph, const EtcMatrix& etc, const TransferModel& transfers,
             const StartTimes& start_times, bool insertion, DagPlan* plan);

  /// No node placed from now on starts before this time.
  void setBarrier(double time) { barrier_ = time; }

  const TaskGraph& graph() const { return *graph_; }
  const EtcMatrix& etc() const { return *etc_; }
  uint32_t units() const { return static_cast<uint32_t>(etc_->units()); }

  /// When `node` would finish earliest on `unit`, given the predecessors placed so far.
  Place earliest(uint32_t node, uint32_t unit) const;

  /// The unit where `node` finishes first; of equal ones the first.
  Place earliest(uint32_t node) const;

  /// @throws std::invalid_argument  the node would not finish in finite time: the times given add up to too much.
  void commit(uint32_t node, const Place& place);
  /// Undoes the commit() of `node`; only the latest one not yet undone can be.
  void undo(uint32_t node, const Place& place);

private:
  double ready(uint32_t node, uint32_t unit) const;

  const TaskGraph* graph_ = nullptr;
  const EtcMatrix* etc_ = nullptr;
  const TransferModel* transfers_ = nullptr;
  const StartTimes* start_times_ = nullptr;
  bool insertion_ = true;
  double barrier_ = 0.0;
  DagPlan* plan_ = nullptr;
  std::vector<UnitTimeline> timelines_;
};

}  // namespace pi_runtime
