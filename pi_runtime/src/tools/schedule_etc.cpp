/// Maps the tasks of an ETC matrix in a CSV file to units and prints when each runs where.
///   schedule_etc FILE.csv [--policy P] [options]     (- reads standard input; --help lists the options)
/// Output: lines `task,unit,start,finish` by start time, figures as comment lines that begin with #.
/// Exit status: 0; 2 after a bad option or file; 3 if no unit can run some task, which is then printed as refused.

#include <pi_runtime/etc_matrix.h>
#include <pi_runtime/inter_core_scheduler.h>

#include <boost/program_options.hpp>

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

constexpr int EXIT_BAD_INPUT = 2;
constexpr int EXIT_REFUSED = 3;

struct Arguments
{
  std::string etc_path;
  std::string energy_path;
  std::string available;
  std::string output_path;
  std::string policy;
  std::string diff_min_order;
  int64_t budget_us = 0;
  InterCoreOptions options;
};

/// @return nullopt if only help was asked for.
std::optional<Arguments> parseArguments(int argc, char** argv)
{
  const InterCoreOptions defaults;
  Arguments arguments;
  po::options_description visible("schedule_etc FILE.csv [options]: maps tasks (rows) to units (columns)");
  visible.add_options()("help,h", "this text");
  const auto add = [&visible](const char* name, const po::value_semantic* value, const char* description)
  { visible.add_options()(name, value, description); };
  add("policy", po::value(&arguments.policy)->default_value(toString(defaults.policy)),
      "diff_min, min_min, max_min, sufferage, mct, met, olb, heft_rank or search");
  add("budget-us", po::value(&arguments.budget_us)->default_value(defaults.budget.count()),
      "time for the search [us], 0: no limit");
  add("kicks", po::value(&arguments.options.kicks)->default_value(defaults.kicks),
      "how often the search leaves a local optimum");
  add("seed", po::value(&arguments.options.seed)->default_value(defaults.seed), "of all random choices");
  add("diff-min-order", po::value(&arguments.diff_min_order)->default_value(toString(defaults.diff_min_order)),
      "max or min: which Div diff_min maps first");
  add("energy", po::value(&arguments.energy_path), "CSV file of energies [J], same shape");
  add("alpha", po::value(&arguments.options.alpha)->default_value(defaults.alpha), "weight of the makespan");
  add("gamma", po::value(&arguments.options.gamma)->default_value(defaults.gamma), "weight of the energy [1/J]");
  add("available", po::value(&arguments.available), "when each unit is free, e.g. 0,2.5,1");
  add("output", po::value(&arguments.output_path), "file to write to instead of standard output");
  po::options_description all;
  all.add(visible).add_options()("file", po::value(&arguments.etc_path));
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv)
                .options(all)
                .positional(po::positional_options_description().add("file", 1))
                .run(),
            values);
  if (values.count("help") != 0)
  {
    std::cout << visible;
    return std::nullopt;
  }
  po::notify(values);
  if (arguments.etc_path.empty())
  {
    throw std::invalid_argument("no file given, expected a CSV file of execution times or - for standard input");
  }
  arguments.options.policy = parseInterCorePolicy(arguments.policy);
  arguments.options.diff_min_order = parseDiffMinOrder(arguments.diff_min_order);
  arguments.options.budget = std::chrono::microseconds(arguments.budget_us);
  return arguments;
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
  try
  {
    const std::optional<pi_runtime::Arguments> arguments = pi_runtime::parseArguments(argc, argv);
    return arguments ? pi_runtime::run(*arguments) : EXIT_SUCCESS;
  }
  catch (const std::exception& error)
  {
    std::cerr << "schedule_etc: " << error.what() << '\n';
    return pi_runtime::EXIT_BAD_INPUT;
  }
}
