#include <pi_runtime/inter_core_scheduler.h>

#include "scheduler/inter_core_heuristics.h"
#include "scheduler/inter_core_problem.h"
#include "scheduler/inter_core_search.h"

#include <algorithm>
#include <array>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace pi_runtime
{
namespace
{

constexpr std::array<const char*, 9> POLICY_NAMES{"diff_min", "min_min", "max_min",   "sufferage", "mct",
                                                  "met",      "olb",     "heft_rank", "search"};
constexpr std::array<const char*, 2> ORDER_NAMES{"max", "min"};

template <typename Enum, size_t N>
Enum parseName(const std::array<const char*, N>& names, const std::string& subject, const std::string& name)
{
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end())
  {
    std::string text = subject + " = \"" + name + "\", must be one of";
    for (const char* valid : names)
    {
      text += std::string(" ") + valid;
    }
    throw std::invalid_argument(text);
  }
  return static_cast<Enum>(found - names.begin());
}

template <typename Value>
[[noreturn]] void refuse(const std::string& object, Value value, const std::string& bound)
{
  std::ostringstream text;
  text << object << " = " << value << ", must be " << bound;
  throw std::invalid_argument(text.str());
}

void validateInput(const EtcMatrix& etc, const std::vector<double>& available, const EtcMatrix* energy)
{
  if (etc.units() == 0 && etc.tasks() > 0)
  {
    refuse("ETC matrix: number of units", 0, "at least 1");
  }
  etc.validate();
  if (!available.empty() && available.size() != etc.units())
  {
    refuse("available: number of entries", available.size(), "that of the units, " + std::to_string(etc.units()));
  }
  for (size_t j = 0; j < available.size(); ++j)
  {
    if (!(available[j] >= 0.0 && available[j] < INF))
    {
      refuse("available: unit " + std::to_string(j), available[j], "finite and >= 0");
    }
  }
  if (energy == nullptr)
  {
    return;
  }
  if (energy->tasks() != etc.tasks() || energy->units() != etc.units())
  {
    refuse("energy matrix: size", std::to_string(energy->tasks()) + " x " + std::to_string(energy->units()),
           "that of the ETC matrix, " + std::to_string(etc.tasks()) + " x " + std::to_string(etc.units()));
  }
  for (size_t i = 0; i < etc.tasks(); ++i)
  {
    for (size_t j = 0; j < etc.units(); ++j)
    {
      if (etc.at(i, j) < INF && !(energy->at(i, j) >= 0.0 && energy->at(i, j) < INF))
      {
        refuse("energy matrix: task " + std::to_string(i) + " on unit " + std::to_string(j), energy->at(i, j),
               "finite and >= 0 where the ETC is finite");
      }
    }
  }
}

bool isWhole(double value)
{
  constexpr double LIMIT = 1e12;  // sums of some thousand of these are still exact
  return value < LIMIT && static_cast<double>(static_cast<int64_t>(value)) == value;
}

}  // namespace

const char* toString(InterCorePolicy policy)
{
  return POLICY_NAMES.at(static_cast<size_t>(policy));
}

InterCorePolicy parseInterCorePolicy(const std::string& name)
{
  return parseName<InterCorePolicy>(POLICY_NAMES, "policy", name);
}

const std::vector<InterCorePolicy>& allInterCorePolicies()
{
  static const std::vector<InterCorePolicy> policies = []
  {
    std::vector<InterCorePolicy> all;
    for (const char* name : POLICY_NAMES)
    {
      all.push_back(parseInterCorePolicy(name));
    }
    return all;
  }();
  return policies;
}

const char* toString(DiffMinOrder order)
{
  return ORDER_NAMES.at(static_cast<size_t>(order));
}

DiffMinOrder parseDiffMinOrder(const std::string& name)
{
  return parseName<DiffMinOrder>(ORDER_NAMES, "diff_min_order", name);
}

void InterCoreOptions::validate() const
{
  if (budget.count() < 0)
  {
    refuse("budget", std::to_string(budget.count()) + " us", ">= 0 (0: by the size of the problem)");
  }
  if (kicks < 0)
  {
    refuse("kicks", kicks, ">= 0");
  }
  if (!(alpha > 0.0 && alpha < INF))
  {
    refuse("alpha", alpha, "finite and > 0");
  }
  if (!(gamma >= 0.0 && gamma < INF))
  {
    refuse("gamma", gamma, "finite and >= 0");
  }
}

std::chrono::microseconds searchBudget(size_t tasks, size_t units)
{
  constexpr uint64_t LEAST_US = 1000;
  constexpr uint64_t US_PER_ENTRY = 2;
  return std::chrono::microseconds(std::max(LEAST_US, US_PER_ENTRY * tasks * units));
}

struct InterCoreScheduler::Workspace
{
  InterCoreProblem problem;
  std::vector<uint32_t> tasks;  ///< task of the caller for each task of the problem
  InterCoreMapping mapping;
  InterCoreHeuristics heuristics;
  InterCoreSearch search;

  void collect(const EtcMatrix& etc, const std::vector<double>& available, const InterCoreOptions& options,
               const EtcMatrix* energy);
  InterCoreSearch::Outcome map(const InterCoreOptions& options, std::chrono::steady_clock::time_point deadline);
  uint32_t unitForSingleTask(InterCorePolicy policy) const;
};

void InterCoreScheduler::Workspace::collect(const EtcMatrix& etc, const std::vector<double>& available,
                                            const InterCoreOptions& options, const EtcMatrix* energy)
{
  const bool has_cost = energy != nullptr && options.gamma > 0.0;
  problem.units = etc.units();
  problem.available = available;
  problem.available.resize(etc.units(), 0.0);
  problem.integral = !has_cost && std::all_of(available.begin(), available.end(), isWhole);
  problem.time.clear();
  problem.cost.clear();
  tasks.clear();
  for (uint32_t i = 0; i < etc.tasks(); ++i)
  {
    const double* row = etc.row(i);
    const double* row_end = row + etc.units();
    if (std::all_of(row, row_end, [](double time) { return time == INF; }))
    {
      continue;
    }
    tasks.push_back(i);
    problem.time.insert(problem.time.end(), row, row_end);
    problem.integral =
        problem.integral && std::all_of(row, row_end, [](double time) { return time == INF || isWhole(time); });
    for (size_t j = 0; has_cost && j < etc.units(); ++j)
    {
      problem.cost.push_back(row[j] < INF ? options.gamma / options.alpha * energy->at(i, j) : 0.0);
    }
  }
  problem.tasks = tasks.size();
}

uint32_t InterCoreScheduler::Workspace::unitForSingleTask(InterCorePolicy policy) const
{
  const double* time = problem.timeRow(0);
  const double earlier = *std::max_element(problem.available.begin(), problem.available.end());
  std::pair<double, double> best(INF, INF);
  uint32_t unit = 0;
  for (uint32_t j = 0; j < problem.units; ++j)
  {
    if (time[j] == INF)
    {
      continue;
    }
    const double cost = problem.cost.empty() ? 0.0 : problem.cost[j];
    const double completion = problem.available[j] + problem.weight(0, j);
    std::pair<double, double> key(completion, 0.0);
    if (policy == InterCorePolicy::MET)
    {
      key.first = problem.weight(0, j);
    }
    else if (policy == InterCorePolicy::OLB)
    {
      key.first = problem.available[j] + cost;
    }
    else if (policy == InterCorePolicy::SEARCH)  // the objective, then the completion
    {
      key = {std::max(earlier, problem.available[j] + time[j]) + cost, completion};
    }
    if (key < best)
    {
      best = key;
      unit = j;
    }
  }
  return unit;
}

InterCoreSearch::Outcome InterCoreScheduler::Workspace::map(const InterCoreOptions& options,
                                                            std::chrono::steady_clock::time_point deadline)
{
  switch (options.policy)
  {
    case InterCorePolicy::DIFF_MIN:
      heuristics.diffMin(problem, options.diff_min_order, options.seed, &mapping);
      break;
    case InterCorePolicy::MIN_MIN:
      heuristics.minMin(problem, &mapping);
      break;
    case InterCorePolicy::MAX_MIN:
      heuristics.maxMin(problem, &mapping);
      break;
    case InterCorePolicy::SUFFERAGE:
      heuristics.sufferage(problem, &mapping);
      break;
    case InterCorePolicy::MCT:
      heuristics.mct(problem, &mapping);
      break;
    case InterCorePolicy::MET:
      heuristics.met(problem, &mapping);
      break;
    case InterCorePolicy::OLB:
      heuristics.olb(problem, &mapping);
      break;
    case InterCorePolicy::HEFT_RANK:
      heuristics.heftRank(problem, &mapping);
      break;
    case InterCorePolicy::SEARCH:
      heuristics.diffMin(problem, options.diff_min_order, options.seed, &mapping);
      return search.improve(problem, {options.kicks, options.seed, deadline, options.budget.count() == 0}, &heuristics,
                            &mapping);
  }
  return {};
}

InterCoreScheduler::InterCoreScheduler() : workspace_(std::make_unique<Workspace>()) {}

InterCoreScheduler::~InterCoreScheduler() = default;

void InterCoreScheduler::schedule(const EtcMatrix& etc, const std::vector<double>& available,
                                  const InterCoreOptions& options, const EtcMatrix* energy, Assignment* result)
{
  options.validate();
  constexpr std::chrono::microseconds MOST = std::chrono::hours(24);  // more would overflow the clock
  const std::chrono::microseconds budget =
      options.budget.count() == 0 ? searchBudget(etc.tasks(), etc.units()) : std::min(options.budget, MOST);
  const std::chrono::steady_clock::time_point deadline = std::chrono::steady_clock::now() + budget;
  validateInput(etc, available, energy);
  Workspace& work = *workspace_;
  work.collect(etc, available, options, energy);
  InterCoreSearch::Outcome outcome;
  if (work.problem.tasks == 0)
  {
    work.mapping.start(work.problem);
    outcome.proven = options.policy == InterCorePolicy::SEARCH;
  }
  else if (work.problem.tasks == 1)
  {
    work.mapping.start(work.problem);
    work.mapping.map(work.problem, 0, work.unitForSingleTask(options.policy));
    outcome.proven = options.policy == InterCorePolicy::SEARCH;
  }
  else
  {
    outcome = work.map(options, deadline);
  }

  result->unit.assign(etc.tasks(), Assignment::REFUSED);
  result->order.clear();
  result->load = work.problem.available;
  result->energy = 0.0;
  for (uint32_t index : work.mapping.order)
  {
    const uint32_t task = work.tasks[index];
    const uint32_t unit = work.mapping.unit[index];
    result->unit[task] = static_cast<int32_t>(unit);
    result->order.push_back(task);
    result->load[unit] += etc.at(task, unit);
    result->energy += energy != nullptr ? energy->at(task, unit) : 0.0;
  }
  result->makespan = result->load.empty() ? 0.0 : *std::max_element(result->load.begin(), result->load.end());
  result->objective = options.alpha * result->makespan + options.gamma * result->energy;
  result->proven = outcome.proven;
  result->lower_bound =
      outcome.proven ? result->objective : std::min(options.alpha * outcome.lower_bound, result->objective);
}

Assignment schedule(const EtcMatrix& etc, const std::vector<double>& available, const InterCoreOptions& options,
                    const EtcMatrix* energy)
{
  Assignment result;
  InterCoreScheduler().schedule(etc, available, options, energy, &result);
  return result;
}

}  // namespace pi_runtime
