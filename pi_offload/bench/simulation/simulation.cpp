#include "simulation/simulation.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "simulation/run.h"

namespace pi_offload
{
namespace
{

double quantile(std::vector<double>* values, double part)
{
  if (values->empty())
  {
    return 0.0;
  }
  const auto at = values->begin() + std::llround(part * static_cast<double>(values->size() - 1));
  std::nth_element(values->begin(), at, values->end());
  return *at;
}

}  // namespace

namespace simulation
{

SimulationResult Run::result()
{
  SimulationResult& result = result_;
  double local_j = 0.0;
  double fallback_j = 0.0;
  double radio_j = 0.0;
  for (Vehicle& vehicle : vehicles_)
  {
    local_j += vehicle.local_j;
    fallback_j += vehicle.fallback_j;
    radio_j += vehicle.radio_j;
    result.served += vehicle.served;
    result.tasks_of_vehicle.push_back(static_cast<double>(vehicle.served));
    for (const auto& open : vehicle.open)  // without a result
    {
      const auto kind = static_cast<size_t>(open.second.task->kind);
      ++result.of_kind[kind].missed;
      times_s_[kind].push_back(HUGE_VAL);
    }
    if (vehicle.engine != nullptr)
    {
      for (const auto& of : vehicle.engine->statistics().of_kind)
      {
        result.handovers += of.handovers;
      }
    }
  }
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    result.of_kind[kind].p50_s = quantile(&times_s_[kind], 0.5);
    result.of_kind[kind].p99_s = quantile(&times_s_[kind], 0.99);
  }
  result.task_seconds = scenario_.duration_s * static_cast<double>(vehicles_.size());
  result.local_w = local_j / result.task_seconds;
  result.fallback_w = fallback_j / result.task_seconds;
  result.radio_w = radio_j / result.task_seconds;
  result.power_w = result.local_w + result.fallback_w + result.radio_w;
  double busy_s = 0.0;
  int workers = 0;
  for (size_t n = 0; n < nodes_.size(); ++n)
  {
    busy_s += nodes_[n].busy_s();
    workers += scenario_.nodes[n].workers;
  }
  result.busy_share = workers > 0 ? busy_s / (scenario_.duration_s * workers) : 0.0;
  return std::move(result_);
}

}  // namespace simulation

uint64_t SimulationResult::missed() const
{
  uint64_t sum = 0;
  for (const OfKind& of : of_kind)
  {
    sum += of.missed;
  }
  return sum;
}

double SimulationResult::regret(double miss_cost_j) const
{
  if (oracle_power_w <= 0.0 || task_seconds <= 0.0)
  {
    return 0.0;
  }
  const double cost_w = power_w + miss_cost_j * static_cast<double>(missed()) / task_seconds;
  const double oracle_w = oracle_power_w + miss_cost_j * static_cast<double>(oracle_missed) / task_seconds;
  return cost_w / oracle_w - 1.0;
}

double SimulationResult::fairness() const
{
  double sum = 0.0;
  double squares = 0.0;
  for (const double tasks : tasks_of_vehicle)
  {
    sum += tasks;
    squares += tasks * tasks;
  }
  return squares > 0.0 ? sum * sum / (static_cast<double>(tasks_of_vehicle.size()) * squares) : 1.0;
}

SimulationResult simulate(const Scenario& scenario, const std::string& policy, uint32_t seed)
{
  scenario.validate();
  if (policy != "oracle" && policy != "informed")
  {
    makePolicy(policy, scenario.engine.policy);  // throws for a name that is not known
  }
  const simulation::World world(scenario, seed);
  return simulation::Run(world, policy).run();
}

void compareWithOracle(const SimulationResult& oracle, SimulationResult* result)
{
  result->oracle_power_w = oracle.power_w;
  result->oracle_missed = oracle.missed();
}

}  // namespace pi_offload
