// simulate --scenario S.yaml --policy P[,P2...]: energy, missed deadlines and handovers of policies in a simulated
// world, beside those of an oracle. Needs no ROS master.

#include "simulation/simulation.h"
#include <pi_node/progress.h>
#include <pi_node/stop_signal.h>

#include <algorithm>
#include <atomic>
#include <boost/program_options.hpp>
#include <condition_variable>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "tools/simulation_report.h"

namespace
{

namespace fs = std::filesystem;
namespace po = boost::program_options;
using namespace pi_offload;

struct CommandLine
{
  std::string scenario;
  std::string policies = "expected_cost";
  uint32_t seed = 1;
  int seeds = 30;
  std::string lambdas;
  std::string csv;
  std::string json;
  int threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1U, 64U));
  double duration_s = 0.0;  ///< 0: the scenario's
  bool quiet = false;
};

std::vector<std::string> split(const std::string& text)
{
  std::vector<std::string> cells;
  std::istringstream stream(text);
  for (std::string cell; std::getline(stream, cell, ',');)
  {
    cells.push_back(cell);
  }
  return cells;
}

std::vector<std::string> parsePolicies(const std::string& text)
{
  std::vector<std::string> known = policyNames();
  known.emplace_back("oracle");
  if (text == "all")
  {
    return known;
  }
  const std::vector<std::string> policies = split(text);
  for (const std::string& policy : policies)
  {
    if (std::find(known.begin(), known.end(), policy) == known.end())
    {
      std::string allowed;
      for (const std::string& name : known)
      {
        allowed += name + ", ";
      }
      throw po::error("--policy \"" + policy + "\", must be of " + allowed + "with commas between them, or all");
    }
  }
  if (policies.empty())
  {
    throw po::error("--policy is empty, must name one");
  }
  return policies;
}

std::vector<double> parseLambdas(const std::string& text)
{
  std::vector<double> lambdas;
  for (const std::string& cell : split(text))
  {
    char* end = nullptr;
    const double value = std::strtod(cell.c_str(), &end);
    if (cell.empty() || *end != '\0' || !(value >= 0.0 && value <= 1e6))
    {
      throw po::error("--lambda \"" + cell + "\", must be numbers in [0, 1e6] with commas between them [J]");
    }
    lambdas.push_back(value);
  }
  return lambdas;
}

std::vector<Case> makeCases(const std::vector<std::string>& policies, const std::vector<double>& lambdas, double usual)
{
  std::vector<Case> cases;
  for (const std::string& policy : policies)
  {
    if (!usesLambda(policy) || lambdas.empty())
    {
      cases.push_back({policy, usual, {}});
      continue;
    }
    for (const double lambda : lambdas)
    {
      cases.push_back({policy, lambda, {}});
    }
  }
  return cases;
}

/// Runs jobs 0 .. count-1 in threads; the first exception ends it and is thrown again.
void runParallel(int threads, size_t count, const std::string& unit, bool quiet, const std::function<void(size_t)>& job)
{
  std::atomic<size_t> next{0};
  std::mutex mutex;
  std::condition_variable changed;
  size_t done = 0;
  int running = threads;
  std::exception_ptr error;
  const auto work = [&]
  {
    while (!pi_node::StopSignal::came())
    {
      const size_t i = next++;
      if (i >= count)
      {
        break;
      }
      std::exception_ptr failure;
      try
      {
        job(i);
      }
      catch (...)
      {
        failure = std::current_exception();
      }
      const std::lock_guard<std::mutex> lock(mutex);
      ++done;
      if (failure)
      {
        error = failure;
        next = count;
      }
      changed.notify_one();
    }
    const std::lock_guard<std::mutex> lock(mutex);
    --running;
    changed.notify_one();
  };
  std::vector<std::thread> workers;
  for (int i = 0; i < threads; ++i)
  {
    workers.emplace_back(work);
  }
  {
    pi_node::Progress progress(unit, quiet);
    std::unique_lock<std::mutex> lock(mutex);
    while (running > 0)
    {
      changed.wait(lock);
      progress.show(done, count);
    }
  }
  for (std::thread& worker : workers)
  {
    worker.join();
  }
  if (error)
  {
    std::rethrow_exception(error);
  }
}

/// A file that appears when it is complete.
void writeFile(const std::string& path, const std::string& text)
{
  const bool special = fs::exists(path) && !fs::is_regular_file(path);
  const std::string partial = special ? path : path + ".partial";
  std::ofstream stream(partial);
  if (!stream)
  {
    throw std::runtime_error(partial + ": cannot be written: does the folder exist, and is it yours?");
  }
  stream << text;
  stream.close();
  if (!stream)
  {
    throw std::runtime_error(partial + ": could not be written to its end: is the disk full?");
  }
  if (!special)
  {
    fs::rename(partial, path);
  }
}

/// @return exit status.
int run(const CommandLine& line)
{
  Scenario scenario = Scenario::load_file(line.scenario);
  if (line.duration_s > 0.0)
  {
    scenario.duration_s = line.duration_s;
    scenario.validate();
  }
  std::vector<Case> cases =
      makeCases(parsePolicies(line.policies), parseLambdas(line.lambdas), scenario.engine.policy.miss_cost_j);
  Case oracle{"oracle", scenario.engine.policy.miss_cost_j, {}};
  std::vector<Case*> all{&oracle};
  for (Case& one : cases)
  {
    if (one.policy != "oracle")
    {
      all.push_back(&one);
    }
  }
  const auto seeds = static_cast<size_t>(line.seeds);
  for (Case* one : all)
  {
    one->results.resize(seeds);
  }
  runParallel(line.threads, seeds * all.size(), "runs", line.quiet,
              [&](size_t i)
              {
                Case& one = *all[i / seeds];
                Scenario own = scenario;
                own.engine.policy.miss_cost_j = one.lambda;
                one.results[i % seeds] = simulate(own, one.policy, line.seed + static_cast<uint32_t>(i % seeds));
              });
  if (pi_node::StopSignal::came())
  {
    std::cerr << "stopped; nothing was written\n";
    return pi_node::StopSignal::exitStatus();
  }
  for (Case& one : cases)
  {
    if (one.policy == "oracle")
    {
      one.results = oracle.results;
    }
    for (size_t i = 0; i < seeds; ++i)
    {
      compareWithOracle(oracle.results[i], &one.results[i]);
    }
  }
  std::cout << scenario.name << ": " << scenario.vehicles << (scenario.vehicles == 1 ? " vehicle, " : " vehicles, ")
            << scenario.nodes.size() << " nodes, " << seeds << (seeds == 1 ? " seed" : " seeds") << " of "
            << plain(scenario.duration_s) << " s; +- is the standard deviation over seeds; cost is energy + lambda per "
            << "miss, over the oracle's\n\n";
  printTable(cases);
  printCauses(cases);
  if (!line.csv.empty())
  {
    writeFile(line.csv, csvText(scenario.name, line.seed, cases));
  }
  if (!line.json.empty())
  {
    writeFile(line.json, jsonText(scenario.name, line.seed, cases));
  }
  return EXIT_SUCCESS;
}

bool parse(int argc, char** argv, CommandLine* line)
{
  po::options_description visible("simulate --scenario S.yaml [--policy P[,P2...]] [options]");
  auto add = visible.add_options();
  add("help", "prints this");
  add("scenario", po::value(&line->scenario)->required(), "the world, YAML");
  add("policy", po::value(&line->policies)->default_value(line->policies),
      "names with commas between them: local, nearest, nearest_anywhere, paper_literal, paper, deadline, "
      "expected_cost, oracle; or all");
  add("seed", po::value(&line->seed)->default_value(line->seed), "of the first run");
  add("seeds", po::value(&line->seeds)->default_value(line->seeds), "runs, each with the next seed, in [1, 10000]");
  add("lambda", po::value(&line->lambdas),
      "prices of a missed deadline [J], with commas between them: expected_cost is run with each");
  add("duration", po::value(&line->duration_s), "of a run [s]; default: the scenario's");
  add("csv", po::value(&line->csv), "writes a line per policy, price and seed, for plot_offload");
  add("json", po::value(&line->json), "writes means and standard deviations over the seeds");
  add("threads", po::value(&line->threads)->default_value(line->threads), "runs at once, in [1, 64]");
  add("quiet", po::bool_switch(&line->quiet), "no progress");
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv).options(visible).positional({}).run(), values);
  if (values.count("help") != 0)
  {
    std::cout << visible;
    return false;
  }
  po::notify(values);
  if (line->seeds < 1 || line->seeds > 10000)
  {
    throw po::error("--seeds " + std::to_string(line->seeds) + ", must be in [1, 10000]");
  }
  if (line->threads < 1 || line->threads > 64)
  {
    throw po::error("--threads " + std::to_string(line->threads) + ", must be in [1, 64]");
  }
  if (values.count("duration") != 0 && !(line->duration_s > 0.0))
  {
    throw po::error("--duration " + plain(line->duration_s) + ", must be positive");
  }
  parsePolicies(line->policies);
  parseLambdas(line->lambdas);
  return true;
}

}  // namespace

int main(int argc, char** argv)
{
  CommandLine line;
  try
  {
    if (!parse(argc, argv, &line))
    {
      return EXIT_SUCCESS;
    }
  }
  catch (const std::exception& error)
  {
    std::cerr << "simulate: " << error.what() << "; see --help\n";
    return 2;
  }
  try
  {
    pi_node::StopSignal::install();
    return run(line);
  }
  catch (const std::exception& error)
  {
    std::cerr << "simulate: " << error.what() << "\n";
    return EXIT_FAILURE;
  }
}
