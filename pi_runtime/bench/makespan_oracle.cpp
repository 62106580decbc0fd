#include "makespan_oracle.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "scheduler/inter_core_problem.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::INF;

constexpr double TOLERANCE = 1e-9;

/// Price updates per node; more of them cost more than the nodes they save.
constexpr int ROOT_ROUNDS = 200;
constexpr int NODE_ROUNDS = 6;
constexpr double ROOT_RATE = 0.3;  // falling with 1 / (1 + ROOT_DECAY * round)
constexpr double ROOT_DECAY = 0.06;
constexpr double NODE_RATE = 0.1;

}  // namespace

OracleResult MakespanOracle::solve(const pi_runtime::EtcMatrix& etc, const std::vector<uint32_t>& incumbent,
                                   uint64_t max_nodes)
{
  etc_ = &etc;
  max_nodes_ = max_nodes;
  result_ = OracleResult{};
  whole_ = true;
  std::vector<uint32_t> fastest(etc.tasks(), 0);
  Node root;
  for (uint32_t i = 0; i < etc.tasks(); ++i)
  {
    uint32_t allowed = 0;
    for (uint32_t j = 0; j < etc.units(); ++j)
    {
      const double time = etc.at(i, j);
      allowed |= time < INF ? 1U << j : 0U;
      whole_ = whole_ && (time == INF || std::floor(time) == time);
      fastest[i] = time < etc.at(i, fastest[i]) ? j : fastest[i];
    }
    root.free.push_back(i);
    root.allowed.push_back(allowed);
  }
  root.load.assign(etc.units(), 0.0);
  root.price.assign(etc.units(), 1.0 / static_cast<double>(etc.units()));
  result_.makespan = INF;
  accept(incumbent.empty() ? fastest : incumbent);
  unit_ = result_.unit;
  nodes_.assign(etc.tasks() + 1, Node{});
  nodes_[0] = std::move(root);
  explore(0);
  result_.proven = result_.nodes < max_nodes_;
  return result_;
}

void MakespanOracle::accept(const std::vector<uint32_t>& unit)
{
  std::vector<double> load(etc_->units(), 0.0);
  for (size_t i = 0; i < unit.size(); ++i)
  {
    load[unit[i]] += etc_->at(i, unit[i]);
  }
  const double makespan = load.empty() ? 0.0 : *std::max_element(load.begin(), load.end());
  if (makespan < result_.makespan)
  {
    result_.makespan = makespan;
    result_.unit = unit;
    target_ = whole_ ? makespan - 1.0 : makespan * (1.0 - TOLERANCE);
  }
}

MakespanOracle::Verdict MakespanOracle::decideForced(Node* node)
{
  bool changed = false;
  for (size_t f = 0; f < node->free.size();)
  {
    const uint32_t task = node->free[f];
    uint32_t* allowed = &node->allowed[f];
    for (uint32_t j = 0; j < etc_->units(); ++j)
    {
      if (node->load[j] + etc_->at(task, j) > target_ + TOLERANCE)
      {
        *allowed &= ~(1U << j);
      }
    }
    if (*allowed == 0)
    {
      return Verdict::PRUNED;
    }
    if ((*allowed & (*allowed - 1)) != 0)
    {
      ++f;
      continue;
    }
    uint32_t unit = 0;
    while ((*allowed >> unit) != 1U)
    {
      ++unit;
    }
    unit_[task] = unit;
    node->load[unit] += etc_->at(task, unit);
    *allowed = node->allowed.back();
    node->allowed.pop_back();
    node->free[f] = node->free.back();
    node->free.pop_back();
    changed = true;
  }
  return changed ? Verdict::CHANGED : Verdict::STABLE;
}

MakespanOracle::Verdict MakespanOracle::tighten(Node* node)
{
  relaxed_load_ = node->load;
  smallest_.resize(node->free.size());
  double bound = 0.0;
  for (size_t j = 0; j < etc_->units(); ++j)
  {
    bound += node->price[j] * node->load[j];
  }
  for (size_t f = 0; f < node->free.size(); ++f)
  {
    const uint32_t task = node->free[f];
    uint32_t unit = 0;
    smallest_[f] = INF;
    for (uint32_t j = 0; j < etc_->units(); ++j)
    {
      const double entry = node->price[j] * etc_->at(task, j);
      if (allows(*node, f, j) && entry < smallest_[f])
      {
        smallest_[f] = entry;
        unit = j;
      }
    }
    bound += smallest_[f];
    unit_[task] = unit;
    relaxed_load_[unit] += etc_->at(task, unit);
  }
  accept(unit_);
  const double slack = target_ + TOLERANCE * (1.0 + target_) - bound;
  if (slack < 0.0)
  {
    return Verdict::PRUNED;
  }
  bool changed = false;
  for (size_t f = 0; f < node->free.size(); ++f)
  {
    for (uint32_t j = 0; j < etc_->units(); ++j)
    {
      if (allows(*node, f, j) && node->price[j] * etc_->at(node->free[f], j) - smallest_[f] > slack)
      {
        node->allowed[f] &= ~(1U << j);
        changed = true;
      }
    }
  }
  return changed ? Verdict::CHANGED : Verdict::STABLE;
}

void MakespanOracle::updatePrices(Node* node, double rate)
{
  constexpr double LEAST_PRICE = 1e-9;
  double mean = 0.0;
  for (size_t j = 0; j < etc_->units(); ++j)
  {
    mean += node->price[j] * relaxed_load_[j];
  }
  double sum = 0.0;
  for (size_t j = 0; j < etc_->units(); ++j)
  {
    const double overload = std::clamp(relaxed_load_[j] / mean - 1.0, -1.0, 1.0);
    node->price[j] = std::max(node->price[j] * std::exp(rate * overload), LEAST_PRICE);
    sum += node->price[j];
  }
  for (double& price : node->price)
  {
    price /= sum;
  }
}

void MakespanOracle::explore(size_t depth)
{
  if (result_.nodes >= max_nodes_)
  {
    return;
  }
  ++result_.nodes;
  Node* node = &nodes_[depth];
  const int rounds = depth == 0 ? ROOT_ROUNDS : NODE_ROUNDS;
  for (int round = 0; round < rounds; ++round)
  {
    Verdict verdict = Verdict::CHANGED;
    while (verdict == Verdict::CHANGED)
    {
      verdict = decideForced(node);
    }
    if (verdict == Verdict::PRUNED || tighten(node) == Verdict::PRUNED)
    {
      return;
    }
    if (node->free.empty())
    {
      return;  // tighten() has accepted it if it is better
    }
    if (round + 1 < rounds)
    {
      updatePrices(node, depth == 0 ? ROOT_RATE / (1.0 + ROOT_DECAY * round) : NODE_RATE);
    }
  }
  // The task with the largest entry of the bound decides most, for itself and by what it leaves to the others.
  const auto f = static_cast<size_t>(std::max_element(smallest_.begin(), smallest_.end()) - smallest_.begin());
  std::vector<std::pair<double, uint32_t>> choices;
  for (uint32_t j = 0; j < etc_->units(); ++j)
  {
    if (allows(*node, f, j))
    {
      choices.emplace_back(node->price[j] * etc_->at(node->free[f], j), j);
    }
  }
  std::sort(choices.begin(), choices.end());
  for (const auto& choice : choices)
  {
    nodes_[depth + 1] = *node;
    nodes_[depth + 1].allowed[f] = 1U << choice.second;
    explore(depth + 1);
  }
}

}  // namespace pi_runtime_bench
