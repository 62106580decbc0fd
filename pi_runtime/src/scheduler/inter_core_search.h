#pragma once

#include "scheduler/dual_bound.h"
#include "scheduler/inter_core_heuristics.h"
#include "scheduler/inter_core_problem.h"

#include <chrono>
#include <cstdint>
#include <vector>

namespace pi_runtime
{

/// Improves mappings by iterated local search. It starts from the given ones and from the one that minimises the dual
/// bound. A first pass moves tasks off the critical unit (the one with the largest load), cheapest first by the prices
/// of the bound. Then it descends by the best move off that unit or exchange with it. Kicks of 2 to 8 random moves try
/// to leave the local optimum; a kick is undone if the descent ends above it. Pairs of task and unit that the bound
/// excludes, and for each task all but the six of the smallest reduced costs, are skipped. Keeps its memory.
class InterCoreSearch
{
public:
  struct Limits
  {
    int kicks = 0;  ///< so many in a row without a gain end the search
    uint64_t seed = 0;
    /// Overrun by at most a few passes over the matrix of times, and the balancing of the start by the bound.
    std::chrono::steady_clock::time_point deadline;
    bool all_starts = false;  ///< take them also when the deadline has passed
  };
  struct Outcome
  {
    double lower_bound = 0.0;  ///< of the objective of the problem
    bool proven = false;       ///< the mapping is optimal
  };

  /// @param heuristics for the starts by Min-Min and Sufferage.
  /// @param mapping    complete. Becomes the best mapping found, with the order of the best of the three starts.
  Outcome improve(const InterCoreProblem& problem, const Limits& limits, InterCoreHeuristics* heuristics,
                  InterCoreMapping* mapping);

private:
  /// Moves task `first` from the critical unit to `unit` and, if there is one, task `second` from there to it.
  struct Step
  {
    static constexpr uint32_t NO_TASK = UINT32_MAX;
    uint32_t first = NO_TASK;
    uint32_t second = NO_TASK;
    uint32_t unit = 0;
    double score = 0.0;  ///< larger load of the two units afterwards plus the price
  };
  /// A task that may move to another unit.
  struct Candidate
  {
    uint32_t task;
    double old_time;
    double new_time;
    double cost_change;
    double price;  ///< change of costs and of times weighted by the prices of the bound: what balanced units would lose
  };
  /// A move off the unit that has the task.
  struct Offer
  {
    double price;  ///< rise of the bound per time relieved
    uint32_t task;
    uint32_t unit;
  };
  struct Placement
  {
    uint32_t task;
    uint32_t unit;
  };

  /// In up to half of the time.
  void tightenBound();
  void takeIfBetter(InterCoreMapping* mapping);
  void load(const std::vector<uint32_t>& units);
  double objective() const;
  bool expired();
  /// No better mapping than one of this objective can be found any more.
  bool isProven(double objective) const;
  /// Sets open_ and loose_ to what a mapping better than this objective can use, up to six units per task.
  void restrictPairs(double objective);
  void place(uint32_t task, uint32_t unit);
  /// Does nothing if a better mapping is hardly to be found or the time is over.
  void descendFrom(const std::vector<uint32_t>& start);
  bool keepIfBetter();
  /// Lists where `task` could move in the offers of its unit.
  void offer(uint32_t task);
  /// Takes the cheapest moves off the critical unit that lower the larger load of the two units, while there are any.
  /// For thousands of tasks this replaces thousands of passes of descend().
  void balance();
  /// To a local optimum, unless the deadline comes first.
  void descend();
  bool relieveCriticalUnit();
  /// Lists the tasks of unit `from` that may move to `to`: of `count` members from a random one on, or of all.
  /// @return their number.
  size_t collect(uint32_t from, uint32_t to, size_t count, std::vector<Candidate>* candidates);
  /// Keeps the better one of `best` and the steps between the critical unit and `unit`.
  void considerUnit(uint32_t critical, uint32_t unit, Step* best);
  /// Moves tasks to where they cost less than they add to the makespan.
  bool reduceCosts();
  void kick();
  void takeBack();
  void iterate(int kicks);

  const InterCoreProblem* problem_ = nullptr;
  std::chrono::steady_clock::time_point deadline_;
  bool expired_ = false;
  size_t pairs_since_clock_ = 0;
  SplitMix64 random_;
  DualBound bound_;
  std::vector<double> open_;     ///< tasks x units: time, infinite if the pair is not to be tried
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
  std::vector<std::vector<Offer>> offers_;  ///< per unit, a heap
  std::vector<bool> offered_;               ///< the unit's offers are listed
  std::vector<uint32_t> dual_start_;
  InterCoreMapping start_;
  std::vector<uint32_t> best_;
  double best_objective_ = 0.0;
  double restricted_gap_ = 0.0;  ///< distance to the bound for which open_ is
};

}  // namespace pi_runtime
