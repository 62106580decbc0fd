#pragma once

#include "scheduler/dual_bound.h"
#include "scheduler/inter_core_problem.h"

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

namespace pi_runtime
{

/// Improves a mapping by iterated local search. It starts from the given mapping and from the one that minimises the
/// dual bound. It descends by moving tasks off the critical unit (the one with the largest load) and by exchanges with
/// it. Then kicks of 2 to 8 random moves try to leave the local optimum; a kick is undone if the descent ends above it.
/// Pairs of task and unit that the dual bound excludes are skipped. Keeps its memory between calls.
class InterCoreSearch
{
public:
  struct Limits
  {
    int kicks = 0;
    uint64_t seed = 0;
    /// Overrun by at most a few passes over the matrix of times.
    std::optional<std::chrono::steady_clock::time_point> deadline;
  };
  struct Outcome
  {
    double lower_bound = 0.0;  ///< of the objective of the problem
    bool proven = false;       ///< the mapping is optimal
  };

  /// @param mapping complete; `unit` changes if a better one was found, `load` then too, `order` never.
  Outcome improve(const InterCoreProblem& problem, const Limits& limits, InterCoreMapping* mapping);

private:
  /// Moves task `first` from the critical unit to `unit` and, if there is one, task `second` from there to it.
  struct Step
  {
    static constexpr uint32_t NO_TASK = UINT32_MAX;
    uint32_t first = NO_TASK;
    uint32_t second = NO_TASK;
    uint32_t unit = 0;
    double peak = 0.0;  ///< larger load of the two units afterwards, plus the change of the costs
    double sum = 0.0;   ///< of the two loads afterwards, decides between equal peaks
  };
  /// A task that may move to another unit.
  struct Candidate
  {
    uint32_t task;
    double old_time;
    double new_time;
    double cost_change;
  };
  struct Placement
  {
    uint32_t task;
    uint32_t unit;
  };

  void load(const std::vector<uint32_t>& units);
  double objective() const;
  bool expired();
  /// No better mapping than one of this objective can be found any more.
  bool isProven(double objective) const;
  /// Sets open_ and loose_ to what a mapping better than this objective can use.
  void restrictPairs(double objective);
  void place(uint32_t task, uint32_t unit);
  void descendFrom(const std::vector<uint32_t>& start);
  /// To a local optimum, unless the deadline comes first.
  void descend();
  bool relieveCriticalUnit();
  /// Lists the tasks of `count` places of unit `from`, starting at `first` and wrapping round, that may move to `to`.
  /// @return their number.
  size_t collect(uint32_t from, uint32_t to, size_t first, size_t count, std::vector<Candidate>* candidates) const;
  /// Keeps the better one of `best` and the steps between the critical unit and `unit`.
  void considerUnit(uint32_t critical, uint32_t unit, size_t first, size_t count, Step* best);
  /// Moves tasks to where they cost less than they add to the makespan.
  bool reduceCosts();
  void kick();
  void takeBack();
  void iterate(int kicks, double objective);

  const InterCoreProblem* problem_ = nullptr;
  std::optional<std::chrono::steady_clock::time_point> deadline_;
  bool expired_ = false;
  size_t pairs_since_clock_ = 0;
  SplitMix64 random_;
  DualBound bound_;
  std::vector<double> open_;     ///< tasks x units: time, infinite if the pair is in no better mapping
  std::vector<uint32_t> loose_;  ///< tasks with more than one open unit

  // The current mapping.
  std::vector<uint32_t> unit_;                  ///< per task
  std::vector<double> own_time_;                ///< per task: on its unit
  std::vector<uint32_t> place_;                 ///< per task: its index in members_ of its unit
  std::vector<std::vector<uint32_t>> members_;  ///< per unit: its tasks
  std::vector<double> load_;                    ///< per unit
  double cost_ = 0.0;

  // What it was before the kick.
  std::vector<Placement> log_;
  std::vector<double> load_before_;
  double cost_before_ = 0.0;

  std::vector<Candidate> leaving_;   ///< from the critical unit to the one under consideration; sized for all tasks
  std::vector<Candidate> entering_;  ///< the other way
  std::vector<uint32_t> dual_start_;
  std::vector<uint32_t> best_;
};

}  // namespace pi_runtime
