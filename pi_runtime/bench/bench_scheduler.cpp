/// Measures the policies of the inter-core scheduler as the paper does (π-Edge, section IV.B and figure 9) and against
/// the proven optimum, and says which of the paper's claims hold.
///   bench_scheduler [--sets N] [--seed S] [--real] [--output-csv FILE]   the paper's grid (default 100 sets a cell)
///   bench_scheduler --classes | --noise | --large                       other ETC classes, run-time errors, large sets
///   bench_scheduler --braun | --sizes                 512 x 16 at several budgets; 10 to 10,000 tasks against the
///   starts
/// Baseline: Min-Min with ct = mat + ETC. plot_scheduler.py draws the CSV file.

#include <pi_runtime/inter_core_scheduler.h>
#include "etc_instances.h"
#include "execution_model.h"
#include "grid_report.h"
#include "makespan_oracle.h"
#include "scheduler/dual_bound.h"

#include <boost/program_options.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <limits>
#include <map>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::Assignment;
using pi_runtime::DiffMinOrder;
using pi_runtime::EtcMatrix;
using pi_runtime::InterCoreOptions;
using pi_runtime::InterCorePolicy;
using pi_runtime::InterCoreScheduler;

constexpr uint64_t ORACLE_NODES = 2000000;
constexpr int TIMINGS = 3;  ///< of each call, the shortest counts: other programs interrupt the longer ones

struct Contender
{
  std::string name;
  InterCoreOptions options;
};

/// The baseline is the first.
const std::vector<Contender>& contenders()
{
  static const std::vector<Contender> all = []
  {
    std::vector<Contender> result;
    const auto add = [&result](const std::string& name, InterCorePolicy policy)
    {
      result.push_back({name, {}});
      result.back().options.policy = policy;
    };
    add("min_min", InterCorePolicy::MIN_MIN);
    add("diff_min", InterCorePolicy::DIFF_MIN);
    add("dm_min_div", InterCorePolicy::DIFF_MIN);
    result.back().options.diff_min_order = DiffMinOrder::MIN_DIV;
    for (InterCorePolicy policy :
         {InterCorePolicy::SUFFERAGE, InterCorePolicy::MAX_MIN, InterCorePolicy::MCT, InterCorePolicy::MET,
          InterCorePolicy::OLB, InterCorePolicy::HEFT_RANK, InterCorePolicy::SEARCH})
    {
      add(toString(policy), policy);
    }
    result.back().options.budget = std::chrono::hours(1);  // the kicks bound it, so that results repeat
    return result;
  }();
  return all;
}

std::vector<std::string> contenderNames()
{
  std::vector<std::string> names;
  for (const Contender& contender : contenders())
  {
    names.push_back(contender.name);
  }
  return names;
}

double timedSchedule(InterCoreScheduler* scheduler, const EtcMatrix& etc, const InterCoreOptions& options,
                     Assignment* result)
{
  const auto start = std::chrono::steady_clock::now();
  scheduler->schedule(etc, {}, options, nullptr, result);
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count();
}

Cell measureCell(size_t tasks, size_t units, int sets, bool whole, std::mt19937_64* random)
{
  Cell cell;
  cell.tasks = tasks;
  cell.units = units;
  cell.names = contenderNames();
  InterCoreScheduler scheduler;
  MakespanOracle oracle;
  Assignment assignment;
  for (int set = 0; set < sets; ++set)
  {
    const EtcMatrix etc = paperEtc(tasks, units, whole, random);
    std::map<std::string, double> makespans;
    for (const Contender& contender : contenders())
    {
      double time_us = timedSchedule(&scheduler, etc, contender.options, &assignment);
      for (int repetition = 1; repetition < TIMINGS; ++repetition)
      {
        time_us = std::min(time_us, timedSchedule(&scheduler, etc, contender.options, &assignment));
      }
      cell.series[contender.name].time_us.push_back(time_us);
      makespans[contender.name] = assignment.makespan;
    }
    // The last contender is the search, its mapping the best start.
    const OracleResult optimum =
        oracle.solve(etc, std::vector<uint32_t>(assignment.unit.begin(), assignment.unit.end()), ORACLE_NODES);
    cell.proven += optimum.proven ? 1 : 0;
    makespans["optimum"] = optimum.makespan;
    for (const auto& [name, makespan] : makespans)
    {
      Series& series = cell.series[name];
      series.ratio.push_back(makespan / makespans["min_min"]);
      series.met_ratio.push_back(makespan / makespans["met"]);
      series.gap.push_back(makespan / optimum.makespan - 1.0);
    }
  }
  return cell;
}

std::string cpuModel()
{
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown processor";
}

void runGrid(int sets, uint64_t seed, bool whole, const std::string& csv_path)
{
  std::printf("ETC %s, %d sets per cell, seed %llu\n", whole ? "uniform in {1..30}" : "uniform in [1, 30)", sets,
              static_cast<unsigned long long>(seed));
  std::mt19937_64 random(seed);
  std::vector<Cell> cells;
  for (size_t units = 3; units <= 6; ++units)
  {
    for (size_t tasks = 10; tasks <= 50; tasks += 10)
    {
      cells.push_back(measureCell(tasks, units, sets, whole, &random));
    }
  }
  printReport(cells);
  if (!csv_path.empty())
  {
    writeCsv(csv_path, cells);
  }
}

void runClasses(int sets, uint64_t seed)
{
  std::printf("Other ETC classes, %d sets each, seed %llu: makespan normalised to Min-Min\n", sets,
              static_cast<unsigned long long>(seed));
  printHeader("class", contenderNames());
  std::mt19937_64 random(seed);
  InterCoreScheduler scheduler;
  Assignment assignment;
  for (const EtcClass& etc_class : etcClasses())
  {
    std::map<std::string, double> ratios;
    for (int set = 0; set < sets; ++set)
    {
      const EtcMatrix etc = etc_class.draw(&random);
      double baseline = 0.0;
      for (const Contender& contender : contenders())
      {
        scheduler.schedule(etc, {}, contender.options, nullptr, &assignment);
        baseline = contender.name == contenders().front().name ? assignment.makespan : baseline;
        ratios[contender.name] += assignment.makespan / baseline / sets;
      }
    }
    std::printf("%-18s", etc_class.name.c_str());
    for (const Contender& contender : contenders())
    {
      std::printf(" %11.3f", ratios[contender.name]);
    }
    std::printf("\n");
  }
}

void runNoise(int sets, uint64_t seed)
{
  constexpr size_t TASKS = 30;
  constexpr size_t UNITS = 4;
  std::printf(
      "Run times = ETC * log-normal(sigma), %zu tasks on %zu units, %d sets, seed %llu: real makespan normalised\n"
      "to that of Min-Min without stealing; \"+ steal\": idle units take waiting tasks of others\n",
      TASKS, UNITS, sets, static_cast<unsigned long long>(seed));
  const std::vector<std::string> names{"min_min", "diff_min", "dm_min_div", "sufferage", "search"};
  std::vector<std::string> columns;
  for (const std::string& name : names)
  {
    columns.push_back(name);
    columns.emplace_back("+ steal");
  }
  printHeader("sigma", columns);
  InterCoreScheduler scheduler;
  Assignment assignment;
  for (double sigma : {0.0, 0.1, 0.3, 0.5})
  {
    std::mt19937_64 random(seed);
    std::vector<double> ratios(columns.size(), 0.0);
    for (int set = 0; set < sets; ++set)
    {
      const EtcMatrix etc = paperEtc(TASKS, UNITS, true, &random);
      const EtcMatrix actual = withNoise(etc, sigma, &random);
      double baseline = 0.0;
      for (size_t k = 0; k < columns.size(); ++k)
      {
        const auto contender = std::find_if(contenders().begin(), contenders().end(),
                                            [&](const Contender& other) { return other.name == names[k / 2]; });
        scheduler.schedule(etc, {}, contender->options, nullptr, &assignment);
        const double makespan = actualMakespan(etc, actual, assignment, k % 2 == 1);
        baseline = k == 0 ? makespan : baseline;
        ratios[k] += makespan / baseline / sets;
      }
    }
    std::printf("%-18.1f", sigma);
    for (double ratio : ratios)
    {
      std::printf(" %11.3f", ratio);
    }
    std::printf("\n");
  }
}

void runLarge(uint64_t seed)
{
  constexpr size_t UNITS = 8;
  std::printf(
      "Large metatasks on %zu units, real-valued ETC, seed %llu: time [ms] and makespan over the dual bound [%%]\n",
      UNITS, static_cast<unsigned long long>(seed));
  std::vector<Contender> all = contenders();
  Contender unlimited = all.back();
  all.pop_back();
  all.push_back({"search, default", {}});
  for (int budget_ms : {1, 10, 100})
  {
    all.push_back({"search " + std::to_string(budget_ms) + " ms", unlimited.options});
    all.back().options.budget = std::chrono::milliseconds(budget_ms);
  }
  unlimited.name = "search, no limit";
  all.push_back(unlimited);
  std::mt19937_64 random(seed);
  InterCoreScheduler scheduler;
  for (size_t tasks : {1000U, 10000U, 100000U})
  {
    const EtcMatrix etc = paperEtc(tasks, UNITS, false, &random);
    std::vector<double> times_ms;
    std::vector<double> makespans;
    Assignment assignment;
    for (const Contender& contender : all)
    {
      times_ms.push_back(timedSchedule(&scheduler, etc, contender.options, &assignment) / 1000.0);
      makespans.push_back(assignment.makespan);
    }
    for (size_t k = 0; k < all.size(); ++k)  // the last assignment is that of the search without limit
    {
      std::printf("%7zu tasks  %-16s %10.2f ms %9.3f %%\n", tasks, all[k].name.c_str(), times_ms[k],
                  100.0 * (makespans[k] / assignment.lower_bound - 1.0));
    }
  }
}

/// Near that of the linear relaxation and never above it: the bound of the search with fifty times its price updates.
double lowerBound(const EtcMatrix& etc)
{
  constexpr int STEPS = 2000;
  pi_runtime::InterCoreProblem problem;
  problem.tasks = etc.tasks();
  problem.units = etc.units();
  problem.time.assign(etc.row(0), etc.row(0) + etc.tasks() * etc.units());
  problem.available.assign(etc.units(), 0.0);
  pi_runtime::DualBound bound;
  bound.start(problem);
  for (int step = 0; step < STEPS; ++step)
  {
    bound.improve(problem);
  }
  return bound.value();
}

/// The rules that the search starts from, and the search at each of these budgets [ms], 0 the default.
std::vector<Contender> startsAndSearches(const std::vector<int>& budgets_ms)
{
  std::vector<Contender> result(3);
  result[0].options.policy = InterCorePolicy::DIFF_MIN;
  result[1].options.policy = InterCorePolicy::MIN_MIN;
  result[2].options.policy = InterCorePolicy::SUFFERAGE;
  for (Contender& contender : result)
  {
    contender.name = toString(contender.options.policy);
  }
  for (int budget_ms : budgets_ms)
  {
    result.push_back({budget_ms == 0 ? "search" : std::to_string(budget_ms) + " ms", {}});
    result.back().options.budget = std::chrono::milliseconds(budget_ms);
    result.back().options.kicks = budget_ms == 0 ? result.back().options.kicks : std::numeric_limits<int>::max();
  }
  return result;
}

void runBraun(int sets, uint64_t seed, size_t tasks, size_t units)
{
  std::printf("Braun's classes, %zu tasks on %zu units, %d sets each, seed %llu: makespan over the lower bound [%%]\n",
              tasks, units, sets, static_cast<unsigned long long>(seed));
  const std::vector<Contender> all = startsAndSearches({0, 1, 5, 20, 100});
  std::vector<std::string> columns;
  for (const Contender& contender : all)
  {
    columns.push_back(contender.name);
  }
  columns.emplace_back("search [ms]");
  printHeader("class", columns);
  std::vector<double> means(columns.size(), 0.0);
  std::mt19937_64 random(seed);
  InterCoreScheduler scheduler;
  Assignment assignment;
  const std::vector<EtcClass> classes = braunClasses(tasks, units);
  const auto print = [](const std::string& name, const std::vector<double>& figures)
  {
    std::printf("%-18s", name.c_str());
    for (double figure : figures)
    {
      std::printf(" %11.3f", figure);
    }
    std::printf("\n");
  };
  for (const EtcClass& etc_class : classes)
  {
    std::vector<double> figures(columns.size(), 0.0);
    for (int set = 0; set < sets; ++set)
    {
      const EtcMatrix etc = etc_class.draw(&random);
      const double bound = lowerBound(etc);
      for (size_t k = 0; k < all.size(); ++k)
      {
        const double time_us = timedSchedule(&scheduler, etc, all[k].options, &assignment);
        figures[k] += 100.0 * (assignment.makespan / bound - 1.0) / sets;
        figures.back() += all[k].name == "search" ? time_us / 1000.0 / sets : 0.0;
      }
    }
    print(etc_class.name, figures);
    for (size_t k = 0; k < figures.size(); ++k)
    {
      means[k] += figures[k] / static_cast<double>(classes.size());
    }
  }
  print("mean", means);
}

/// Instances of every size and kind: is the search ever worse than one of the rules that it starts from?
void runSizes(int sets, uint64_t seed)
{
  constexpr size_t MOST_UNITS = 16;
  const double decades[] = {1.0, 2.0, 3.0, 4.0};
  std::printf("%d instances of 10 to 10,000 tasks on 2 to %zu units, uniform and Braun's classes, seed %llu\n", sets,
              MOST_UNITS, static_cast<unsigned long long>(seed));
  std::printf(
      "%-18s %9s | mean makespan over the lower bound [%%]                       | search [ms]         | worse "
      "than one\n%-18s %9s | %11s %11s %11s %11s | %9s %9s | of the three\n",
      "tasks", "instances", "", "", "diff_min", "min_min", "sufferage", "search", "mean", "max");
  const std::vector<Contender> all = startsAndSearches({0});
  std::mt19937_64 random(seed);
  InterCoreScheduler scheduler;
  Assignment assignment;
  struct Row
  {
    int instances = 0;
    int worse = 0;
    std::vector<double> gaps = std::vector<double>(4, 0.0);
    double time_ms = 0.0;
    double longest_ms = 0.0;
  };
  std::vector<Row> rows(3);
  for (int set = 0; set < sets; ++set)
  {
    const double exponent = std::uniform_real_distribution<double>(decades[0], decades[3])(random);
    const auto tasks = static_cast<size_t>(std::pow(10.0, exponent));
    const size_t units = 2 + random() % (MOST_UNITS - 1);
    const size_t kind = random() % 14;
    const EtcMatrix etc =
        kind < 12 ? braunClasses(tasks, units)[kind].draw(&random) : paperEtc(tasks, units, kind == 12, &random);
    Row& row = rows[static_cast<size_t>(exponent) - 1];
    ++row.instances;
    double best_start = pi_runtime::INF;
    double time_ms = 0.0;
    std::vector<double> makespans;
    for (const Contender& contender : all)
    {
      time_ms = timedSchedule(&scheduler, etc, contender.options, &assignment) / 1000.0;
      makespans.push_back(assignment.makespan);
    }
    for (size_t k = 0; k < all.size(); ++k)  // the last assignment is that of the search
    {
      row.gaps[k] += 100.0 * (makespans[k] / assignment.lower_bound - 1.0);
      best_start = k + 1 < all.size() ? std::min(best_start, makespans[k]) : best_start;
    }
    row.worse += makespans.back() > best_start ? 1 : 0;
    row.time_ms += time_ms;
    row.longest_ms = std::max(row.longest_ms, time_ms);
  }
  for (size_t k = 0; k < rows.size(); ++k)
  {
    const Row& row = rows[k];
    std::printf("%6.0f to %6.0f   %9d | %11.3f %11.3f %11.3f %11.3f | %9.2f %9.2f | %d\n", std::pow(10.0, decades[k]),
                std::pow(10.0, decades[k + 1]), row.instances, row.gaps[0] / row.instances, row.gaps[1] / row.instances,
                row.gaps[2] / row.instances, row.gaps[3] / row.instances, row.time_ms / row.instances, row.longest_ms,
                row.worse);
  }
}

int run(int argc, char** argv)
{
  namespace po = boost::program_options;
  int sets = 0;
  uint64_t seed = 0;
  size_t tasks = 0;
  size_t units = 0;
  std::string csv_path;
  po::options_description options("bench_scheduler: the inter-core policies on the paper's simulation");
  options.add_options()("help,h", "this text")("sets", po::value(&sets)->default_value(100), "sets per cell or class");
  options.add_options()("seed", po::value(&seed)->default_value(1), "of the random ETC matrices");
  options.add_options()("output-csv", po::value(&csv_path), "file for the figures of the grid");
  options.add_options()("real", "real-valued ETC instead of whole numbers");
  options.add_options()("classes", "other ETC classes instead of the paper's grid");
  options.add_options()("noise", "errors of the ETC at run time, with and without stealing");
  options.add_options()("braun", "512 tasks on 16 units, at several budgets");
  options.add_options()("sizes", "instances of 10 to 10,000 tasks against the rules that the search starts from");
  options.add_options()("tasks", po::value(&tasks)->default_value(512), "with --braun");
  options.add_options()("units", po::value(&units)->default_value(16), "with --braun");
  options.add_options()("large", "times for 10^3 to 10^5 tasks");
  po::variables_map values;
  po::store(po::parse_command_line(argc, argv, options), values);
  if (values.count("help") != 0)
  {
    std::cout << options;
    return EXIT_SUCCESS;
  }
  po::notify(values);
  if (sets < 2)
  {
    throw std::invalid_argument("sets = " + std::to_string(sets) + ", must be >= 2");
  }
  std::printf("%s, %u cores\n", cpuModel().c_str(), std::thread::hardware_concurrency());
  if (values.count("classes") != 0)
  {
    runClasses(sets, seed);
  }
  else if (values.count("noise") != 0)
  {
    runNoise(sets, seed);
  }
  else if (values.count("braun") != 0)
  {
    runBraun(sets, seed, tasks, units);
  }
  else if (values.count("sizes") != 0)
  {
    runSizes(sets, seed);
  }
  else if (values.count("large") != 0)
  {
    runLarge(seed);
  }
  else
  {
    runGrid(sets, seed, values.count("real") == 0, csv_path);
  }
  return EXIT_SUCCESS;
}

}  // namespace
}  // namespace pi_runtime_bench

int main(int argc, char** argv)
{
  try
  {
    return pi_runtime_bench::run(argc, argv);
  }
  catch (const std::exception& error)
  {
    std::cerr << "bench_scheduler: " << error.what() << '\n';
    return 2;
  }
}
