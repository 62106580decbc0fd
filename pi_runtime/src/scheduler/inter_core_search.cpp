#include "scheduler/inter_core_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace pi_runtime
{
namespace
{

/// A step must gain more than this share of the makespan, so that rounding cannot make it go in circles.
constexpr double LEAST_GAIN = 1e-9;

/// Exchanges looked at per step, some 0.03 ms of work. Where there are more, a random part of them is looked at.
constexpr size_t MAX_PAIRS_PER_STEP = 32768;

/// Exchanges between two looks at the clock, which takes as long as 30 of them.
constexpr size_t PAIRS_PER_CLOCK = 2048;

/// Another start is left out if the best mapping came this close to the bound. That happens with thousands of tasks, of
/// which the way down takes long.
constexpr double WORTH_ANOTHER_START = 0.002;

/// Kicks end this close to the bound: execution times are not known better than that.
constexpr double WORTH_KICKS = 1e-4;

/// Updates of the prices of the dual bound (see DualBound::improve()): as many as raise it.
constexpr int LEAST_BOUND_STEPS = 40;
constexpr int MOST_BOUND_STEPS = 300;
constexpr int BOUND_STEPS_BETWEEN_LOOKS = 20;
constexpr double WORTH_MORE_STEPS = 1e-4;

/// Units that a task may move to, those of the smallest reduced costs. More of them make steps longer, not better.
constexpr size_t MAX_OPEN_UNITS = 6;

/// Pairs are excluded anew once this share is left of the distance to the bound.
constexpr double WORTH_RESTRICTING = 0.75;

}  // namespace

InterCoreSearch::Outcome InterCoreSearch::improve(const InterCoreProblem& problem, const Limits& limits,
                                                  InterCoreHeuristics* heuristics, InterCoreMapping* mapping)
{
  problem_ = &problem;
  deadline_ = limits.deadline;
  expired_ = false;
  pairs_since_clock_ = PAIRS_PER_CLOCK;
  random_ = SplitMix64(limits.seed);
  leaving_.resize(problem.tasks);
  entering_.resize(problem.tasks);
  tightenBound();
  best_ = mapping->unit;
  best_objective_ = problem.objective(*mapping);
  restrictPairs(best_objective_);
  bound_.minimisingMapping(problem, &dual_start_);
  load(dual_start_);
  balance();  // however short the time: it takes about as long as Diff-Min
  descend();
  keepIfBetter();
  descendFrom(mapping->unit);
  if (limits.all_starts || !expired())
  {
    heuristics->minMin(problem, &start_);
    takeIfBetter(mapping);
    pairs_since_clock_ += PAIRS_PER_CLOCK;
    descendFrom(start_.unit);
  }
  if ((limits.all_starts || !expired()) && !isProven(best_objective_) &&
      heuristics->sufferageBelow(problem, bound_, best_objective_, &start_))
  {
    takeIfBetter(mapping);
    descendFrom(start_.unit);
  }
  pairs_since_clock_ += PAIRS_PER_CLOCK;
  iterate(limits.kicks);
  if (best_objective_ <= problem.nextBetter(problem.objective(*mapping)))
  {
    mapping->unit = best_;
    mapping->load = problem.available;
    for (size_t i = 0; i < problem.tasks; ++i)
    {
      mapping->load[best_[i]] += problem.timeRow(i)[best_[i]];
    }
  }
  return {std::min(bound_.value(), best_objective_), isProven(best_objective_)};
}

void InterCoreSearch::tightenBound()
{
  const auto now = std::chrono::steady_clock::now();
  const auto deadline = std::exchange(deadline_, now + (deadline_ - now) / 2);
  bound_.start(*problem_);
  double before = 0.0;
  for (int step = 0; step == 0 || (step < MOST_BOUND_STEPS && !expired()); ++step)
  {
    if (step >= LEAST_BOUND_STEPS && step % BOUND_STEPS_BETWEEN_LOOKS == 0)
    {
      if (bound_.relaxedValue() <= before * (1.0 + WORTH_MORE_STEPS))
      {
        break;
      }
      before = bound_.relaxedValue();
    }
    bound_.improve(*problem_);
    pairs_since_clock_ += problem_->tasks * problem_->units;
  }
  deadline_ = deadline;
  expired_ = false;
}

void InterCoreSearch::takeIfBetter(InterCoreMapping* mapping)
{
  const double objective = problem_->objective(start_);
  if (objective < problem_->objective(*mapping))
  {
    *mapping = start_;
  }
  if (objective < best_objective_)
  {
    best_objective_ = objective;
    best_ = start_.unit;
  }
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
  if (!expired_ && pairs_since_clock_ >= PAIRS_PER_CLOCK)
  {
    pairs_since_clock_ = 0;
    expired_ = std::chrono::steady_clock::now() >= deadline_;
  }
  return expired_;
}

bool InterCoreSearch::isProven(double objective) const
{
  return bound_.value() > problem_->nextBetter(objective);
}

void InterCoreSearch::restrictPairs(double objective)
{
  const double relaxed = bound_.relaxedValue();
  restricted_gap_ = objective - relaxed;
  const double target = problem_->nextBetter(objective) + LEAST_GAIN * objective;
  const size_t units = problem_->units;
  open_.resize(problem_->tasks * units);
  loose_.clear();
  for (uint32_t i = 0; i < problem_->tasks; ++i)
  {
    const double* time = problem_->timeRow(i);
    double* open = open_.data() + i * units;
    std::array<double, MAX_OPEN_UNITS> least;  // reduced costs, rising
    least.fill(INF);
    for (size_t j = 0; j < units; ++j)
    {
      const double reduced = bound_.reducedCost(*problem_, i, j);
      const bool possible = problem_->available[j] + time[j] <= target && relaxed + reduced <= target;
      open[j] = possible ? reduced : INF;
      for (size_t k = MAX_OPEN_UNITS; possible && k > 0 && reduced < least[k - 1]; --k)
      {
        least[k - 1] = k > 1 && reduced < least[k - 2] ? least[k - 2] : reduced;
      }
    }
    size_t open_units = 0;
    for (size_t j = 0; j < units; ++j)
    {
      const bool is_open = open[j] < INF && open[j] <= least.back();
      open[j] = is_open ? time[j] : INF;
      open_units += is_open ? 1 : 0;
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
  if (expired() || isProven(best_objective_) || best_objective_ <= bound_.value() * (1.0 + WORTH_ANOTHER_START))
  {
    return;
  }
  load(start);
  balance();
  descend();
  keepIfBetter();
}

bool InterCoreSearch::keepIfBetter()
{
  const double reached = objective();
  if (reached > problem_->nextBetter(best_objective_))
  {
    return false;
  }
  best_objective_ = reached;
  best_ = unit_;
  if (reached - bound_.relaxedValue() < WORTH_RESTRICTING * restricted_gap_)
  {
    restrictPairs(reached);
  }
  return true;
}

void InterCoreSearch::offer(uint32_t task)
{
  const uint32_t from = unit_[task];
  const double held = bound_.reducedCost(*problem_, task, from);
  for (uint32_t unit = 0; unit < problem_->units; ++unit)
  {
    if (unit != from && open_[task * problem_->units + unit] < INF)
    {
      const double price = (bound_.reducedCost(*problem_, task, unit) - held) / own_time_[task];
      offers_[from].push_back({price, task, unit});
    }
  }
}

void InterCoreSearch::balance()
{
  if (!problem_->cost.empty())
  {
    return;
  }
  const auto dearer = [](const Offer& a, const Offer& b) { return a.price > b.price; };
  offers_.resize(std::max(offers_.size(), problem_->units));
  offered_.assign(problem_->units, false);
  for (;;)
  {
    const auto critical = static_cast<uint32_t>(std::max_element(load_.begin(), load_.end()) - load_.begin());
    std::vector<Offer>& offers = offers_[critical];
    if (!offered_[critical])
    {
      offered_[critical] = true;
      offers.clear();
      for (uint32_t task : members_[critical])
      {
        offer(task);
      }
      std::make_heap(offers.begin(), offers.end(), dearer);
      pairs_since_clock_ += offers.size();
    }
    const double limit = load_[critical] * (1.0 - LEAST_GAIN);
    bool moved = false;
    while (!moved && !offers.empty())
    {
      std::pop_heap(offers.begin(), offers.end(), dearer);
      const Offer next = offers.back();
      offers.pop_back();
      // What does not fit now fits neither when this unit has less.
      moved = unit_[next.task] == critical && load_[next.unit] + open_[next.task * problem_->units + next.unit] < limit;
      if (moved)
      {
        place(next.task, next.unit);
        if (offered_[next.unit])
        {
          std::vector<Offer>& onward = offers_[next.unit];
          const size_t before = onward.size();
          offer(next.task);
          for (size_t end = before + 1; end <= onward.size(); ++end)
          {
            std::push_heap(onward.begin(), onward.begin() + static_cast<std::ptrdiff_t>(end), dearer);
          }
        }
      }
      ++pairs_since_clock_;
    }
    if (!moved)
    {
      break;
    }
  }
  log_.clear();
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
  Step best;
  best.score = INF;
  for (uint32_t unit = 0; unit < problem_->units; ++unit)
  {
    if (unit != critical)
    {
      considerUnit(critical, unit, &best);
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

size_t InterCoreSearch::collect(uint32_t from, uint32_t to, size_t count, std::vector<Candidate>* candidates)
{
  const std::vector<uint32_t>& members = members_[from];
  const size_t first = count < members.size() ? random_.below(static_cast<uint32_t>(members.size())) : 0;
  const size_t units = problem_->units;
  const double* cost = problem_->cost.empty() ? nullptr : problem_->cost.data();
  const double* open = open_.data() + to;
  const double* own_time = own_time_.data();
  const double old_price = bound_.price(from);
  const double new_price = bound_.price(to);
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
    slot->price = slot->cost_change + new_price * new_time - old_price * slot->old_time;
    slot += new_time < INF ? 1 : 0;  // written first and counted then: no branch that cannot be foreseen
  }
  return static_cast<size_t>(slot - candidates->data());
}

void InterCoreSearch::considerUnit(uint32_t critical, uint32_t unit, Step* best)
{
  const double makespan = load_[critical];
  const double limit = makespan * (1.0 - LEAST_GAIN);
  double peak_elsewhere = 0.0;
  for (uint32_t other = 0; other < problem_->units && !problem_->cost.empty(); ++other)
  {
    peak_elsewhere = other == unit || other == critical ? peak_elsewhere : std::max(peak_elsewhere, load_[other]);
  }
  const auto consider = [&](const Candidate& out, uint32_t second, double critical_load, double unit_load,
                            double cost_change, double price)
  {
    const double peak = std::max(critical_load, unit_load);
    const double score = peak + price;
    if (peak + cost_change > limit || score >= best->score)
    {
      return;
    }
    // Where costs rise, a lower peak of the two units is no gain if a third one keeps the makespan up.
    if (cost_change <= 0.0 || std::max(peak, peak_elsewhere) + cost_change < limit)
    {
      *best = {out.task, second, unit, score};
    }
  };
  const size_t pairs = std::max<size_t>(1, MAX_PAIRS_PER_STEP / problem_->units);
  const size_t side = 1 + static_cast<size_t>(std::sqrt(static_cast<double>(pairs)));
  const size_t own = members_[critical].size();
  const size_t others = members_[unit].size();
  const size_t scanned =
      own * others <= pairs ? own : std::min(own, std::max(side, pairs / std::max<size_t>(1, others)));
  const size_t leaving = collect(critical, unit, scanned, &leaving_);
  const size_t entering = leaving == 0 ? 0 : collect(unit, critical, std::min(others, 1 + pairs / leaving), &entering_);
  pairs_since_clock_ += scanned + others + leaving * entering;
  for (size_t i = 0; i < leaving; ++i)
  {
    const Candidate& out = leaving_[i];
    const double remaining = makespan - out.old_time;
    const double filled = load_[unit] + out.new_time;
    consider(out, Step::NO_TASK, remaining, filled, out.cost_change, out.price);
    for (size_t x = 0; x < entering; ++x)
    {
      const Candidate& in = entering_[x];
      consider(out, in.task, remaining + in.new_time, filled - in.old_time, out.cost_change + in.cost_change,
               out.price + in.price);
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

void InterCoreSearch::iterate(int kicks)
{
  if (expired() || isProven(best_objective_))
  {
    return;
  }
  load(best_);
  restrictPairs(best_objective_);
  double objective = best_objective_;
  for (int failures = 0; failures < kicks && !loose_.empty() && !isProven(objective) &&
                         objective > bound_.value() * (1.0 + WORTH_KICKS) && !expired();
       ++failures)
  {
    kick();
    descend();
    const double reached = this->objective();
    if (reached > objective)
    {
      takeBack();
      continue;
    }
    objective = reached;
    failures = keepIfBetter() ? -1 : failures;
  }
}

}  // namespace pi_runtime
