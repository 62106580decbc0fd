#pragma once

#include <pi_runtime/etc_matrix.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace pi_runtime
{

/// How independent tasks are mapped to computing units. All heuristics map task by task. The "completion" of task i on
/// unit j is ct(t_i, c_j) = M(c_j) + ETC(t_i, c_j) (π-Edge, section IV.A), plus gamma / alpha * energy if energy
/// counts.
enum class InterCorePolicy
{
  DIFF_MIN,   ///< π-Edge, steps (1)-(9): tasks by Div (eq. 1), then Sub (eq. 2); each to its smallest completion
  MIN_MIN,    ///< repeatedly the pair with the smallest completion (Ibarra and Kim 1977)
  MAX_MIN,    ///< repeatedly the task whose smallest completion is largest
  SUFFERAGE,  ///< repeatedly the task that loses most without its best unit (Maheswaran et al. 1999)
  MCT,        ///< tasks in the order given, each to its smallest completion
  MET,        ///< each to the unit with the smallest ETC, whatever its load
  OLB,        ///< tasks in the order given, each to the unit that is available first, whatever its ETC
  HEFT_RANK,  ///< tasks by falling mean ETC (the upward rank of independent tasks), each to its smallest completion
  SEARCH,     ///< DIFF_MIN, MIN_MIN, SUFFERAGE and a dual bound's mapping, improved by local search; worse than none
};

/// Lower-case name, e.g. "diff_min".
const char* toString(InterCorePolicy policy);
/// @throws std::invalid_argument listing the valid names.
InterCorePolicy parseInterCorePolicy(const std::string& name);
/// All of them, in the order of the enumeration.
const std::vector<InterCorePolicy>& allInterCorePolicies();

/// Which task Diff-Min maps first. The paper's formal steps (5)-(6) say the largest Div, its prose the smallest.
enum class DiffMinOrder
{
  MAX_DIV,
  MIN_DIV,
};

/// "max" or "min".
const char* toString(DiffMinOrder order);
/// @throws std::invalid_argument listing the valid names.
DiffMinOrder parseDiffMinOrder(const std::string& name);

struct InterCoreOptions
{
  InterCorePolicy policy = InterCorePolicy::SEARCH;
  DiffMinOrder diff_min_order = DiffMinOrder::MAX_DIV;
  uint64_t seed = 1;  ///< of Diff-Min's random choice among equal tasks and of the search
  /// SEARCH only: time after which it returns the best it has. Only its starts by Diff-Min and by the bound are never
  /// cut short. 0: searchBudget(), and Min-Min and Sufferage are starts as well, however long they take.
  std::chrono::microseconds budget{0};
  int kicks = 150;     ///< SEARCH only: ends after so many attempts in a row to leave a local optimum in vain, >= 0
  double alpha = 1.0;  ///< weight of the makespan in the objective alpha * makespan + gamma * energy, > 0
  double gamma = 0.0;  ///< weight of the energy [1/J], >= 0; without an energy matrix it has no effect

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Time that SEARCH takes at most unless told otherwise: 2 us per entry of the matrix, at least 1 ms. For example 16 ms
/// for 512 tasks on 16 units, 160 ms for 10,000 on 8. With small problems the kicks end it earlier.
std::chrono::microseconds searchBudget(size_t tasks, size_t units);

/// A mapping of tasks to units.
struct Assignment
{
  static constexpr int32_t REFUSED = -1;

  std::vector<int32_t> unit;    ///< per task; REFUSED if no unit can run it
  std::vector<uint32_t> order;  ///< tasks that are not refused; every unit runs its own in this order
  std::vector<double> load;     ///< per unit: availability time plus the ETC of its tasks
  double makespan = 0.0;        ///< largest load
  double energy = 0.0;          ///< sum over the tasks, 0 without an energy matrix [J]
  double objective = 0.0;       ///< alpha * makespan + gamma * energy
  /// SEARCH only: a lower bound of the objective of all mappings (src/scheduler/dual_bound.h); else 0.
  double lower_bound = 0.0;
  bool proven = false;  ///< SEARCH only: the mapping is known to be optimal
};

/// Maps metatasks to units. Keeps its memory between calls and then allocates nothing. Not thread safe.
///
/// Deterministic for equal input, options and seed, except if the budget ends SEARCH. Ties go to the task with the
/// lowest number, then to the unit with the lowest number; Diff-Min draws the task by seed. With more than 1024 tasks
/// MAX_MIN and SUFFERAGE choose among the 1024 that rank first on idle units, since their exact form takes quadratic
/// time.
class InterCoreScheduler
{
public:
  InterCoreScheduler();
  ~InterCoreScheduler();
  InterCoreScheduler(const InterCoreScheduler&) = delete;
  InterCoreScheduler& operator=(const InterCoreScheduler&) = delete;

  /// @param etc       tasks x units; tasks without a finite entry are refused.
  /// @param available per unit the paper's mat(c_j): end of its earlier tasks, in the time unit of `etc`;
  ///                  finite, >= 0. Empty: all zero.
  /// @param energy    energy of each task on each unit, same size as `etc` [J]; finite and >= 0 where `etc` is finite.
  ///                  nullptr: energy is not considered.
  /// @param result    overwritten; reuse the object to save allocations.
  /// @throws std::invalid_argument naming object, value and bound; `result` is then untouched.
  void schedule(const EtcMatrix& etc, const std::vector<double>& available, const InterCoreOptions& options,
                const EtcMatrix* energy, Assignment* result);

private:
  struct Workspace;
  std::unique_ptr<Workspace> workspace_;
};

/// As InterCoreScheduler::schedule() with a new workspace.
Assignment schedule(const EtcMatrix& etc, const std::vector<double>& available, const InterCoreOptions& options,
                    const EtcMatrix* energy = nullptr);

}  // namespace pi_runtime
