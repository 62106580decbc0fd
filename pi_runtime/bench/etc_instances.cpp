#include "etc_instances.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "scheduler/inter_core_problem.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::EtcMatrix;
using pi_runtime::INF;

constexpr size_t TASKS = 30;
constexpr size_t UNITS = 4;

enum class Consistency
{
  NONE,  ///< a unit may be faster for one task and slower for another
  SEMI,  ///< the units with even numbers are ordered by speed for all tasks
  FULL,  ///< all units are
};

double uniform(double low, double high, std::mt19937_64* random)
{
  return std::uniform_real_distribution<double>(low, high)(*random);
}

EtcMatrix rangeBased(size_t tasks, size_t units, double task_range, double unit_range, Consistency consistency,
                     std::mt19937_64* random)
{
  EtcMatrix etc(tasks, units);
  const size_t stride = consistency == Consistency::SEMI ? 2 : 1;
  for (size_t i = 0; i < tasks; ++i)
  {
    const double size = uniform(1.0, task_range, random);
    std::vector<double> ordered;
    for (size_t j = 0; j < units; ++j)
    {
      etc.at(i, j) = size * uniform(1.0, unit_range, random);
      if (j % stride == 0)
      {
        ordered.push_back(etc.at(i, j));
      }
    }
    if (consistency == Consistency::NONE)
    {
      continue;
    }
    std::sort(ordered.begin(), ordered.end());
    for (size_t k = 0; k < ordered.size(); ++k)
    {
      etc.at(i, k * stride) = ordered[k];
    }
  }
  return etc;
}

/// Equal cores, the last of which is a GPU that runs tasks 0.5 to 20 times as fast; speed-ups are log-uniform.
EtcMatrix coresAndGpu(size_t tasks, size_t cores, std::mt19937_64* random)
{
  EtcMatrix etc(tasks, cores + 1);
  for (size_t i = 0; i < tasks; ++i)
  {
    const double time = uniform(1.0, 30.0, random);
    std::fill_n(&etc.at(i, 0), cores, time);
    etc.at(i, cores) = time / std::exp(uniform(std::log(0.5), std::log(20.0), random));
  }
  return etc;
}

EtcMatrix partlyInfeasible(double share, std::mt19937_64* random)
{
  EtcMatrix etc = paperEtc(TASKS, UNITS, true, random);
  for (size_t i = 0; i < TASKS; ++i)
  {
    const size_t sure = (*random)() % UNITS;
    for (size_t j = 0; j < UNITS; ++j)
    {
      if (j != sure && uniform(0.0, 1.0, random) < share)
      {
        etc.at(i, j) = INF;
      }
    }
  }
  return etc;
}

EtcMatrix equalCores(std::mt19937_64* random)
{
  EtcMatrix etc(TASKS, UNITS);
  for (size_t i = 0; i < TASKS; ++i)
  {
    std::fill_n(&etc.at(i, 0), UNITS, uniform(1.0, 30.0, random));
  }
  return etc;
}

}  // namespace

EtcMatrix paperEtc(size_t tasks, size_t units, bool whole, std::mt19937_64* random)
{
  EtcMatrix etc(tasks, units);
  std::uniform_int_distribution<int> whole_time(1, 30);
  for (size_t i = 0; i < tasks; ++i)
  {
    for (size_t j = 0; j < units; ++j)
    {
      etc.at(i, j) = whole ? whole_time(*random) : uniform(1.0, 30.0, random);
    }
  }
  return etc;
}

std::vector<EtcClass> braunClasses(size_t tasks, size_t units)
{
  std::vector<EtcClass> classes;
  for (const auto& [consistency, prefix] :
       {std::pair(Consistency::NONE, "inconsistent"), {Consistency::SEMI, "semi"}, {Consistency::FULL, "consistent"}})
  {
    for (const auto& [task_range, unit_range, suffix] : {std::tuple(3000.0, 1000.0, " hi-hi"),
                                                         {3000.0, 10.0, " hi-lo"},
                                                         {100.0, 1000.0, " lo-hi"},
                                                         {100.0, 10.0, " lo-lo"}})
    {
      const auto draw =
          [tasks, units, consistency = consistency, task_range = task_range, unit_range = unit_range](auto* random)
      { return rangeBased(tasks, units, task_range, unit_range, consistency, random); };
      classes.push_back({std::string(prefix) + suffix, tasks, units, draw});
    }
  }
  return classes;
}

std::vector<EtcClass> etcClasses()
{
  std::vector<EtcClass> classes;
  for (EtcClass& range_based : braunClasses(TASKS, UNITS))
  {
    const std::string kind = range_based.name.substr(range_based.name.size() - 5);
    if (kind == "hi-hi" || kind == "lo-lo")
    {
      classes.push_back(std::move(range_based));
    }
  }
  classes.push_back({"3 cores + GPU", 20, 4, [](auto* random) { return coresAndGpu(20, 3, random); }});
  classes.push_back({"core + GPU", 12, 2, [](auto* random) { return coresAndGpu(12, 1, random); }});
  classes.push_back({"25 % infinite", TASKS, UNITS, [](auto* random) { return partlyInfeasible(0.25, random); }});
  classes.push_back({"equal cores", TASKS, UNITS, equalCores});
  return classes;
}

EtcMatrix withNoise(const EtcMatrix& etc, double sigma, std::mt19937_64* random)
{
  EtcMatrix actual = etc;
  std::normal_distribution<double> normal;
  for (size_t i = 0; i < etc.tasks(); ++i)
  {
    for (size_t j = 0; j < etc.units(); ++j)
    {
      actual.at(i, j) *= std::exp(sigma * normal(*random));
    }
  }
  return actual;
}

}  // namespace pi_runtime_bench
