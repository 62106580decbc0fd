/// How good and how fast the policies of the inner-core scheduler plan graphs of five families, against a textbook
/// HEFT.
///
/// bench_dag [--graphs N] [--seed S] [--output-csv FILE]
///
/// One line per setting and family, each the mean over N graphs; every plan is checked with validatePlan(). Change of
/// the makespan in % of the textbook HEFT's, so negative is better. Homogeneous settings have 2 and 4 units in turn,
/// heterogeneous ones draw 3 to 8.

#include <algorithm>
#include <boost/program_options.hpp>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <pi_runtime/inner_core_scheduler.h>
#include "dag_families.h"
#include "plan_check.h"
#include "textbook_heft.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::DagPlan;
using pi_runtime::InnerCoreOptions;
using pi_runtime::InnerCorePolicy;
using pi_runtime::InnerCoreScheduler;
using pi_runtime::LevelMapping;
using pi_runtime::StartTimes;

struct Variant
{
  std::string name;  // of its column
  InnerCoreOptions options;
};

std::vector<Variant> allVariants()
{
  std::vector<Variant> variants = {{"heft", {}}, {"heft-ni", {}}, {"look", {}}, {"look-ni", {}}};
  variants[1].options.insertion = false;
  variants[2].options.policy = InnerCorePolicy::LOOKAHEAD;
  variants[3].options.policy = InnerCorePolicy::LOOKAHEAD;
  variants[3].options.insertion = false;
  for (const bool barrier : {true, false})
  {
    for (const auto& [mapping, name] : {std::pair(LevelMapping::MIN_MIN, "mm"), std::pair(LevelMapping::DIFF_MIN, "dm"),
                                        std::pair(LevelMapping::RANK, "rank")})
    {
      InnerCoreOptions options;
      options.policy = InnerCorePolicy::LEVELS;
      options.level_mapping = mapping;
      options.level_barrier = barrier;
      variants.push_back({(barrier ? "B-" : "L-") + std::string(name), options});
    }
  }
  return variants;
}

/// What one variant did on the graphs of one cell.
struct Score
{
  double relative = 0.0;  // sum of makespan over the textbook HEFT's
  double slr = 0.0;       // sum
  std::vector<double> microseconds;
};

struct Cell
{
  std::string setting;
  DagFamily family;
  double nodes = 0.0;       // sum
  double over_bound = 0.0;  // sum of the textbook HEFT's makespan over the lower bound
  std::vector<Score> scores;
};

double median(std::vector<double> values)
{
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// No plan is shorter than the critical path, nor than the work spread evenly.
double lowerBound(const DagProblem& problem, const DagPlan& plan)
{
  double work = 0.0;
  for (std::size_t node = 0; node < problem.etc.tasks(); ++node)
  {
    const double* row = problem.etc.row(node);
    work += *std::min_element(row, row + problem.etc.units());
  }
  return std::max(plan.critical_path, work / static_cast<double>(problem.etc.units()));
}

void measure(const DagProblem& problem, const std::vector<Variant>& variants,
             std::vector<InnerCoreScheduler>* schedulers, Cell* cell)
{
  const double textbook = textbookHeft(problem.graph, problem.etc, problem.transfers);
  DagPlan plan;
  for (std::size_t i = 0; i < variants.size(); ++i)
  {
    const auto begin = std::chrono::steady_clock::now();
    (*schedulers)[i].schedule(problem.graph, problem.etc, problem.transfers, StartTimes(), &plan);
    const std::chrono::duration<double, std::micro> duration = std::chrono::steady_clock::now() - begin;
    const InnerCoreOptions& options = variants[i].options;
    const auto wrong = validatePlan(problem.graph, problem.etc, problem.transfers, plan, StartTimes(),
                                    options.policy == InnerCorePolicy::LEVELS && options.level_barrier);
    if (wrong)
    {
      throw std::runtime_error(variants[i].name + " made a broken plan: " + *wrong);
    }
    cell->scores[i].relative += plan.makespan / textbook;
    cell->scores[i].slr += plan.slr();
    cell->scores[i].microseconds.push_back(duration.count());
  }
  cell->nodes += problem.graph.nodes();
  cell->over_bound += textbook / lowerBound(problem, plan);
}

std::vector<Cell> measureAll(int graphs, uint64_t seed, const std::vector<Variant>& variants)
{
  std::vector<InnerCoreScheduler> schedulers;
  for (const Variant& variant : variants)
  {
    schedulers.emplace_back(variant.options);
  }
  std::mt19937_64 random(seed);
  std::vector<Cell> cells;
  for (const bool heterogeneous : {false, true})
  {
    for (const double ccr : {0.0, 1.0, 5.0})
    {
      for (const DagFamily family : DAG_FAMILIES)
      {
        const std::string setting =
            (heterogeneous ? "heter. CCR " : "homog. CCR ") + std::to_string(static_cast<int>(ccr));
        cells.push_back({setting, family, 0.0, 0.0, std::vector<Score>(variants.size())});
        for (int i = 0; i < graphs; ++i)
        {
          const uint32_t units =
              heterogeneous ? std::uniform_int_distribution<uint32_t>(3, 8)(random) : (i % 2 == 0 ? 2 : 4);
          measure(makeDagProblem(family, {units, heterogeneous, ccr}, &random), variants, &schedulers, &cells.back());
        }
      }
    }
  }
  return cells;
}

/// One line per cell, one column per variant.
template <typename Value>
void printTable(const std::string& title, const std::vector<Variant>& variants, const std::vector<Cell>& cells,
                const Value& value)
{
  std::cout << '\n' << title << '\n' << std::left << std::setw(13) << "setting" << std::setw(9) << "family";
  std::cout << std::right;
  for (const Variant& variant : variants)
  {
    std::cout << std::setw(9) << variant.name;
  }
  std::cout << '\n';
  for (const Cell& cell : cells)
  {
    std::cout << std::left << std::setw(13) << cell.setting << std::setw(9) << toString(cell.family) << std::right;
    for (const Score& score : cell.scores)
    {
      std::cout << std::setw(9) << value(score);
    }
    std::cout << '\n';
  }
}

void printBarrier(const std::vector<Variant>& variants, const std::vector<Cell>& cells, int graphs)
{
  std::cout << "\nBarrier penalty: makespan with barrier over the same mapping without it, less 1 [%]; and how far the "
               "textbook HEFT is above max(critical path, work / units) [%]\n"
            << std::left << std::setw(13) << "setting" << std::setw(9) << "family" << std::right << std::setw(9)
            << "nodes" << std::setw(9) << "mm" << std::setw(9) << "dm" << std::setw(9) << "rank" << std::setw(13)
            << "HEFT/bound" << '\n';
  const std::size_t barrier = variants.size() - 6;
  for (const Cell& cell : cells)
  {
    std::cout << std::left << std::setw(13) << cell.setting << std::setw(9) << toString(cell.family) << std::right
              << std::setw(9) << cell.nodes / graphs;
    for (std::size_t i = barrier; i < barrier + 3; ++i)
    {
      std::cout << std::setw(9) << 100.0 * (cell.scores[i].relative / cell.scores[i + 3].relative - 1.0);
    }
    std::cout << std::setw(13) << 100.0 * (cell.over_bound / graphs - 1.0) << '\n';
  }
}

void writeCsv(const std::string& path, const std::vector<Variant>& variants, const std::vector<Cell>& cells, int graphs)
{
  std::ofstream file(path);
  file << "setting,family,variant,change_percent,slr,microseconds\n";
  for (const Cell& cell : cells)
  {
    for (std::size_t i = 0; i < variants.size(); ++i)
    {
      const Score& score = cell.scores[i];
      file << cell.setting << ',' << toString(cell.family) << ',' << variants[i].name << ','
           << 100.0 * (score.relative / graphs - 1.0) << ',' << score.slr / graphs << ',' << median(score.microseconds)
           << '\n';
    }
  }
  file.close();
  if (!file)
  {
    throw std::runtime_error("cannot write " + path);
  }
}

struct Arguments
{
  int graphs = 400;
  uint64_t seed = 1;
  std::string output_csv;
};

/// @return nothing if only the help was asked for.
std::optional<Arguments> parseArguments(int argc, char** argv)
{
  namespace po = boost::program_options;
  Arguments arguments;
  po::options_description description("Compares the policies of the inner-core scheduler on random graphs");
  auto add = description.add_options();
  add("help", "print this");
  add("graphs", po::value(&arguments.graphs)->default_value(arguments.graphs), "graphs per setting and family, >= 1");
  add("seed", po::value(&arguments.seed)->default_value(arguments.seed), "of the random numbers");
  add("output-csv", po::value(&arguments.output_csv), "file to write all figures to");
  po::variables_map values;
  po::store(po::parse_command_line(argc, argv, description), values);
  po::notify(values);
  if (values.count("help") > 0)
  {
    std::cout << description;
    return std::nullopt;
  }
  if (arguments.graphs < 1)
  {
    throw std::runtime_error("--graphs = " + std::to_string(arguments.graphs) + ", must be >= 1");
  }
  return arguments;
}

void run(const Arguments& arguments)
{
  const std::vector<Variant> variants = allVariants();
  const std::vector<Cell> cells = measureAll(arguments.graphs, arguments.seed, variants);
  const double graphs = arguments.graphs;
  std::cout << "bench_dag: " << arguments.graphs << " graphs per line, seed " << arguments.seed << ", "
            << std::thread::hardware_concurrency() << " cores; all plans valid\n"
            << "heft, look(ahead), -ni without insertion; levels with barrier B- or without L-, mapped by Min-Min mm, "
               "Diff-Min dm, upward rank\n"
            << std::fixed << std::setprecision(1);
  printTable("Change of the makespan against the textbook HEFT [%]", variants, cells,
             [&](const Score& score) { return 100.0 * (score.relative / graphs - 1.0); });
  printBarrier(variants, cells, arguments.graphs);
  std::cout << std::setprecision(2);
  printTable("Schedule length ratio (makespan over critical path without transfers)", variants, cells,
             [&](const Score& score) { return score.slr / graphs; });
  std::cout << std::setprecision(1);
  printTable("Median time of a plan [us]", variants, cells,
             [](const Score& score) { return median(score.microseconds); });
  if (!arguments.output_csv.empty())
  {
    writeCsv(arguments.output_csv, variants, cells, arguments.graphs);
  }
}

}  // namespace
}  // namespace pi_runtime_bench

int main(int argc, char** argv)
{
  try
  {
    if (const auto arguments = pi_runtime_bench::parseArguments(argc, argv))
    {
      pi_runtime_bench::run(*arguments);
    }
    return EXIT_SUCCESS;
  }
  catch (const std::exception& error)
  {
    std::cerr << "bench_dag: " << error.what() << '\n';
    return EXIT_FAILURE;
  }
}
