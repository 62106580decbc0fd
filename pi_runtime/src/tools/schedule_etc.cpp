/// Maps the tasks of an ETC matrix in a CSV file to units and prints when each runs where.
///   schedule_etc FILE.csv [--policy P] [options]     (- reads standard input; --help lists the options)
/// Output: lines `task,unit,start,finish` by start time, figures as comment lines that begin with #.
/// Exit status: 0; 2 after a bad option or file; 3 if no unit can run some task, which is then printed as refused.

#include <pi_node/command_line.h>
#include <pi_runtime/etc_matrix.h>
#include <pi_runtime/inter_core_scheduler.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

namespace pi_runtime
{
namespace
{

namespace po = boost::program_options;

constexpr int EXIT_REFUSED = 3;

struct Arguments
{
  std::string etc_path;
  std::string energy_path;
  std::string available;
  std::string output_path;
  InterCoreOptions options;
};

/// @return false if only help was asked for.
bool parse(int argc, char** argv, Arguments* arguments)
{
  InterCoreOptions* options = &arguments->options;
  std::string policy = toString(options->policy);
  std::string diff_min_order = toString(options->diff_min_order);
  int64_t budget_us = options->budget.count();
  pi_node::CommandLine line("schedule_etc FILE.csv [options]: maps tasks (rows) to units (columns)");
  line.addPositional("file", &arguments->etc_path,
                     "no file given, expected a CSV file of execution times or - for standard input");
  line.addValue("policy", &policy, "diff_min, min_min, max_min, sufferage, mct, met, olb, heft_rank or search");
  line.addValue("budget-us", &budget_us, "time for the search [us], 0: 2 us per task and unit, at least 1 ms");
  line.addValue("kicks", &options->kicks,
                "the search ends after so many attempts in a row to leave a local optimum in vain");
  line.addValue("seed", &options->seed, "of all random choices");
  line.addValue("diff-min-order", &diff_min_order, "max or min: which Div diff_min maps first");
  line.add("energy", po::value(&arguments->energy_path), "CSV file of energies [J], same shape");
  line.addValue("alpha", &options->alpha, "weight of the makespan");
  line.addValue("gamma", &options->gamma, "weight of the energy [1/J]");
  line.add("available", po::value(&arguments->available), "when each unit is free, e.g. 0,2.5,1");
  line.add("output", po::value(&arguments->output_path), "file to write to instead of standard output");
  if (!line.parse(argc, argv))
  {
    return false;
  }
  options->policy = parseInterCorePolicy(policy);
  options->diff_min_order = parseDiffMinOrder(diff_min_order);
  options->budget = std::chrono::microseconds(budget_us);
  return true;
}

EtcMatrix readMatrix(const std::string& path)
{
  EtcMatrix matrix = path == "-" ? readEtcCsv(std::cin) : readEtcCsv(path);
  if (matrix.tasks() == 0)
  {
    throw std::runtime_error(path + ": no tasks, expected a line of numbers for each");
  }
  return matrix;
}

std::vector<double> parseAvailable(const std::string& text)
{
  if (text.empty())
  {
    return {};
  }
  std::istringstream stream(text);
  const EtcMatrix row = readEtcCsv(stream);
  if (row.tasks() != 1)
  {
    throw std::runtime_error("available = \"" + text + "\", expected one number per unit, separated by commas");
  }
  return std::vector<double>(row.row(0), row.row(0) + row.units());
}

void print(const EtcMatrix& etc, const std::vector<double>& available, const Assignment& assignment,
           std::ostream* output)
{
  std::vector<double> free_at = available;
  free_at.resize(etc.units(), 0.0);
  std::vector<std::tuple<double, int32_t, uint32_t, double>> rows;  // start, unit, task, finish
  for (uint32_t task : assignment.order)
  {
    const int32_t unit = assignment.unit[task];
    double* free = &free_at[static_cast<size_t>(unit)];
    const double start = *free;
    *free += etc.at(task, static_cast<size_t>(unit));
    rows.emplace_back(start, unit, task, *free);
  }
  std::sort(rows.begin(), rows.end());
  *output << std::setprecision(10) << "task,unit,start,finish\n";
  for (const auto& [start, unit, task, finish] : rows)
  {
    *output << task << ',' << unit << ',' << start << ',' << finish << '\n';
  }
  for (size_t task = 0; task < assignment.unit.size(); ++task)
  {
    if (assignment.unit[task] == Assignment::REFUSED)
    {
      *output << task << ",refused,,\n";
    }
  }
  *output << "# makespan " << assignment.makespan << '\n';
  for (size_t unit = 0; unit < assignment.load.size(); ++unit)
  {
    *output << "# load " << unit << ' ' << assignment.load[unit] << '\n';
  }
  *output << "# energy " << assignment.energy << '\n' << "# objective " << assignment.objective << '\n';
  if (assignment.lower_bound > 0.0)
  {
    *output << "# lower_bound " << assignment.lower_bound << (assignment.proven ? " (optimal)" : "") << '\n';
  }
}

int run(const Arguments& arguments)
{
  const EtcMatrix etc = readMatrix(arguments.etc_path);
  const std::vector<double> available = parseAvailable(arguments.available);
  std::optional<EtcMatrix> energy;
  if (!arguments.energy_path.empty())
  {
    energy = readMatrix(arguments.energy_path);
  }
  const Assignment assignment = schedule(etc, available, arguments.options, energy ? &*energy : nullptr);
  std::ofstream file;
  if (!arguments.output_path.empty())
  {
    file.open(arguments.output_path);
  }
  std::ostream& output = arguments.output_path.empty() ? std::cout : file;
  print(etc, available, assignment, &output);
  output.flush();
  if (!output)
  {
    throw std::runtime_error("output = \"" + arguments.output_path + "\" cannot be written, expected a writable file");
  }
  const bool refused = assignment.order.size() < assignment.unit.size();
  return refused ? EXIT_REFUSED : EXIT_SUCCESS;
}

}  // namespace
}  // namespace pi_runtime

int main(int argc, char** argv)
{
  pi_runtime::Arguments arguments;
  return pi_node::runTool(
      "schedule_etc", [&] { return pi_runtime::parse(argc, argv, &arguments); },
      [&] { return pi_runtime::run(arguments); }, pi_node::CommandLine::BAD_USAGE);
}
