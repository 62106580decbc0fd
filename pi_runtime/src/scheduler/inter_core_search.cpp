#include "scheduler/inter_core_search.h"

#include <algorithm>

namespace pi_runtime
{
namespace
{

/// A step must gain more than this share of the makespan, so that rounding cannot make it go in circles.
constexpr double LEAST_GAIN = 1e-9;

/// Exchanges looked at per step, some 0.03 ms of work. Metatasks of up to some 400 tasks are looked at completely,
/// larger ones from a random task on, which keeps a step short where thousands of exchanges would do.
constexpr size_t MAX_PAIRS_PER_STEP = 32768;

/// Exchanges between two looks at the clock, which takes as long as 30 of them.
constexpr size_t PAIRS_PER_CLOCK = 2048;

/// The second start is left out if the first one came this close to the bound. That happens with thousands of tasks, of
/// which the way down from Diff-Min takes seconds.
constexpr double WORTH_ANOTHER_START = 0.002;

/// Updates of the prices of the dual bound; see DualBound::improve().
constexpr int BOUND_STEPS = 40;

}  // namespace

InterCoreSearch::Outcome InterCoreSearch::improve(const InterCoreProblem& problem, const Limits& limits,
                                                  InterCoreMapping* mapping)
{
  problem_ = &problem;
  deadline_ = limits.deadline;
  expired_ = false;
  pairs_since_clock_ = PAIRS_PER_CLOCK;
  random_ = SplitMix64(limits.seed);
  leaving_.resize(problem.tasks);
  entering_.resize(problem.tasks);
  bound_.start(problem);
  for (int step = 0; step == 0 || (step < BOUND_STEPS && !expired()); ++step)
  {
    bound_.improve(problem);
    pairs_since_clock_ += problem.tasks * problem.units;
  }
  load(mapping->unit);
  const double given_objective = objective();
  restrictPairs(given_objective);
  bound_.minimisingMapping(problem, &dual_start_);
  load(dual_start_);
  const bool dual_first = objective() < given_objective;  // the better one first, as time may be short
  descendFrom(dual_first ? dual_start_ : mapping->unit);
  double best = objective();
  if (!isProven(best) && !expired())
  {
    if (best > bound_.value() * (1.0 + WORTH_ANOTHER_START))
    {
      best_ = unit_;
      restrictPairs(best);
      descendFrom(dual_first ? mapping->unit : dual_start_);
      if (objective() >= best)
      {
        load(best_);
      }
      best = objective();
    }
    iterate(limits.kicks, best);
  }
  best = objective();
  if (best <= problem.nextBetter(given_objective))
  {
    mapping->unit = unit_;
    mapping->load = load_;
  }
  return {std::min(bound_.value(), best), isProven(best)};
}

void InterCoreSearch::load(const std::vector<uint32_t>& units)
{
  const size_t tasks = problem_->tasks;
  unit_ = units;
  own_time_.resize(tasks);
  place_.resize(tasks);
  members_.resize(std::max(members_.size(), problem_->units));
  for (std::vector<uint32_t>& members : members_)
  {
    members.clear();
    members.reserve(tasks);
  }
  load_ = problem_->available;
  cost_ = 0.0;
  for (uint32_t i = 0; i < tasks; ++i)
  {
    const uint32_t unit = unit_[i];
    const double* cost = problem_->costRow(i);
    own_time_[i] = problem_->timeRow(i)[unit];
    place_[i] = static_cast<uint32_t>(members_[unit].size());
    members_[unit].push_back(i);
    load_[unit] += own_time_[i];
    cost_ += cost != nullptr ? cost[unit] : 0.0;
  }
  log_.clear();
}

double InterCoreSearch::objective() const
{
  return *std::max_element(load_.begin(), load_.end()) + cost_;
}

bool InterCoreSearch::expired()
{
  if (deadline_ && !expired_ && pairs_since_clock_ >= PAIRS_PER_CLOCK)
  {
    pairs_since_clock_ = 0;
    expired_ = std::chrono::steady_clock::now() >= *deadline_;
  }
  return expired_;
}

bool InterCoreSearch::isProven(double objective) const
{
  return bound_.value() > problem_->nextBetter(objective);
}

void InterCoreSearch::restrictPairs(double objective)
{
  const double target = problem_->nextBetter(objective) + LEAST_GAIN * objective;
  const size_t units = problem_->units;
  open_.resize(problem_->tasks * units);
  loose_.clear();
  for (uint32_t i = 0; i < problem_->tasks; ++i)
  {
    size_t open_units = 0;
    for (size_t j = 0; j < units; ++j)
    {
      const double time = problem_->timeRow(i)[j];
      const bool open = problem_->available[j] + time <= target &&
                        bound_.relaxedValue() + bound_.reducedCost(*problem_, i, j) <= target;
      open_[i * units + j] = open ? time : INF;
      open_units += open ? 1 : 0;
    }
    if (open_units > 1)
    {
      loose_.push_back(i);
    }
  }
}

void InterCoreSearch::place(uint32_t task, uint32_t unit)
{
  const uint32_t from = unit_[task];
  std::vector<uint32_t>& old_members = members_[from];
  const uint32_t last = old_members.back();
  old_members[place_[task]] = last;
  place_[last] = place_[task];
  old_members.pop_back();
  place_[task] = static_cast<uint32_t>(members_[unit].size());
  members_[unit].push_back(task);
  load_[from] -= own_time_[task];
  own_time_[task] = problem_->timeRow(task)[unit];
  load_[unit] += own_time_[task];
  if (const double* cost = problem_->costRow(task))
  {
    cost_ += cost[unit] - cost[from];
  }
  unit_[task] = unit;
  log_.push_back({task, from});
}

void InterCoreSearch::descendFrom(const std::vector<uint32_t>& start)
{
  load(start);
  descend();
}

void InterCoreSearch::descend()
{
  while (!expired() && (relieveCriticalUnit() || reduceCosts()))
  {
  }
}

bool InterCoreSearch::relieveCriticalUnit()
{
  const auto critical = static_cast<uint32_t>(std::max_element(load_.begin(), load_.end()) - load_.begin());
  const std::vector<uint32_t>& members = members_[critical];
  const size_t pairs_per_member = problem_->tasks - members.size() + problem_->units;
  const size_t scanned = std::min(members.size(), MAX_PAIRS_PER_STEP / pairs_per_member + 1);
  const size_t first = scanned < members.size() ? random_.below(static_cast<uint32_t>(members.size())) : 0;
  pairs_since_clock_ += scanned * pairs_per_member;

  Step best;
  best.peak = load_[critical] * (1.0 - LEAST_GAIN);
  best.sum = INF;
  for (uint32_t unit = 0; unit < problem_->units; ++unit)
  {
    if (unit != critical)
    {
      considerUnit(critical, unit, first, scanned, &best);
    }
  }
  if (best.first == Step::NO_TASK)
  {
    return false;
  }
  place(best.first, best.unit);
  if (best.second != Step::NO_TASK)
  {
    place(best.second, critical);
  }
  return true;
}

size_t InterCoreSearch::collect(uint32_t from, uint32_t to, size_t first, size_t count,
                                std::vector<Candidate>* candidates) const
{
  const std::vector<uint32_t>& members = members_[from];
  const size_t units = problem_->units;
  const double* cost = problem_->cost.empty() ? nullptr : problem_->cost.data();
  const double* open = open_.data() + to;
  const double* own_time = own_time_.data();
  const uint32_t* next = members.data() + first;
  const uint32_t* end = members.data() + members.size();
  Candidate* slot = candidates->data();
  for (; count > 0; --count)
  {
    const uint32_t task = *next;
    next = next + 1 == end ? members.data() : next + 1;
    const double new_time = open[task * units];
    slot->task = task;
    slot->old_time = own_time[task];
    slot->new_time = new_time;
    slot->cost_change = cost != nullptr ? cost[task * units + to] - cost[task * units + from] : 0.0;
    slot += new_time < INF ? 1 : 0;  // written first and counted then: no branch that cannot be foreseen
  }
  return static_cast<size_t>(slot - candidates->data());
}

void InterCoreSearch::considerUnit(uint32_t critical, uint32_t unit, size_t first, size_t count, Step* best)
{
  const double makespan = load_[critical];
  double peak_elsewhere = 0.0;
  for (uint32_t other = 0; other < problem_->units; ++other)
  {
    peak_elsewhere = other == unit || other == critical ? peak_elsewhere : std::max(peak_elsewhere, load_[other]);
  }
  const auto consider = [&](uint32_t task, uint32_t second, double critical_load, double unit_load, double cost_change)
  {
    const double peak = std::max(critical_load, unit_load);
    const double key = peak + cost_change;
    const double sum = critical_load + unit_load;
    if (key > best->peak || (key == best->peak && sum >= best->sum))
    {
      return;
    }
    // Where costs rise, a lower peak of the two units is no gain if a third one keeps the makespan up.
    if (cost_change <= 0.0 || std::max(peak, peak_elsewhere) + cost_change < makespan * (1.0 - LEAST_GAIN))
    {
      *best = {task, second, unit, key, sum};
    }
  };
  const size_t leaving = collect(critical, unit, first, count, &leaving_);
  const size_t entering = leaving == 0 ? 0 : collect(unit, critical, 0, members_[unit].size(), &entering_);
  for (size_t i = 0; i < leaving; ++i)
  {
    const Candidate& out = leaving_[i];
    const double remaining = makespan - out.old_time;
    const double filled = load_[unit] + out.new_time;
    consider(out.task, Step::NO_TASK, remaining, filled, out.cost_change);
    for (size_t x = 0; x < entering; ++x)
    {
      const Candidate& in = entering_[x];
      consider(out.task, in.task, remaining + in.new_time, filled - in.old_time, out.cost_change + in.cost_change);
    }
  }
}

bool InterCoreSearch::reduceCosts()
{
  if (problem_->cost.empty())
  {
    return false;
  }
  const size_t units = problem_->units;
  double makespan = *std::max_element(load_.begin(), load_.end());
  const double least_gain = LEAST_GAIN * (makespan + cost_);
  bool moved = false;
  for (uint32_t i : loose_)
  {
    const double* cost = problem_->costRow(i);
    for (uint32_t j = 0; j < units; ++j)
    {
      const double raised = std::max(makespan, load_[j] + open_[i * units + j]);
      if (j != unit_[i] && raised - makespan + cost[j] - cost[unit_[i]] < -least_gain)
      {
        place(i, j);
        makespan = raised;
        moved = true;
      }
    }
  }
  pairs_since_clock_ += problem_->tasks * units;
  return moved;
}

void InterCoreSearch::kick()
{
  constexpr uint32_t LEAST_MOVES = 2;
  constexpr uint32_t MOST_MOVES = 8;  // measured: up to 4 or 12 moves come less close to the optimum in equal time
  log_.clear();
  load_before_ = load_;
  cost_before_ = cost_;
  const auto units = static_cast<uint32_t>(problem_->units);
  for (uint32_t moves = LEAST_MOVES + random_.below(MOST_MOVES - LEAST_MOVES + 1); moves > 0; --moves)
  {
    const uint32_t task = loose_[random_.below(static_cast<uint32_t>(loose_.size()))];
    uint32_t unit = random_.below(units);
    while (unit == unit_[task] || open_[task * units + unit] == INF)  // ends: a loose task has two open units
    {
      unit = unit + 1 == units ? 0 : unit + 1;
    }
    place(task, unit);
  }
}

void InterCoreSearch::takeBack()
{
  for (size_t i = log_.size(); i > 0; --i)
  {
    place(log_[i - 1].task, log_[i - 1].unit);
  }
  log_.clear();
  load_ = load_before_;  // exact, unlike the sums
  cost_ = cost_before_;
}

void InterCoreSearch::iterate(int kicks, double objective)
{
  restrictPairs(objective);
  for (int count = 0; count < kicks && !loose_.empty() && !isProven(objective) && !expired(); ++count)
  {
    kick();
    descend();
    const double reached = this->objective();
    if (reached > objective)
    {
      takeBack();
    }
    else if (reached <= problem_->nextBetter(objective))
    {
      objective = reached;
      restrictPairs(objective);
    }
  }
}

}  // namespace pi_runtime
