// simulate --scenario S.yaml --policy P[,P2...]: energy, missed deadlines and handovers of policies in a simulated
// world, beside those of an oracle. Needs no ROS master.

#include <pi_node/command_line.h>
#include <pi_node/progress.h>
#include <pi_node/stop_signal.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "simulation/simulation.h"
#include "simulation/simulation_report.h"

namespace
{

namespace fs = std::filesystem;
namespace po = boost::program_options;
using namespace pi_offload;

constexpr std::chrono::milliseconds PROGRESS_PERIOD(100);

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
  known.emplace_back("informed");
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

/// Runs job(0) to job(count - 1) on threads, until a StopSignal comes. @throws what a job threw.
void runParallel(int threads, size_t count, bool quiet, const std::function<void(size_t)>& job)
{
  std::atomic<size_t> next{0};
  std::atomic<size_t> done{0};
  const auto work = [&]
  {
    for (size_t i = next++; i < count && !pi_node::StopSignal::came(); i = next++)
    {
      try
      {
        job(i);
      }
      catch (...)
      {
        next = count;
        throw;
      }
      ++done;
    }
  };
  std::vector<std::future<void>> workers;
  for (int i = 0; i < threads; ++i)
  {
    workers.push_back(std::async(std::launch::async, work));
  }
  pi_node::Progress progress("runs", quiet);
  for (std::future<void>& worker : workers)
  {
    while (worker.wait_for(PROGRESS_PERIOD) != std::future_status::ready)
    {
      progress.show(done, count);
    }
  }
  progress.show(done, count);
  for (std::future<void>& worker : workers)
  {
    worker.get();
  }
}

/// Writes a file that appears only when it is complete.
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

/// Runs each policy, and the oracle, in the same worlds. @return false if a StopSignal came.
bool simulateAll(const CommandLine& line, const Scenario& scenario, std::vector<Case>* cases)
{
  Case oracle{"oracle", scenario.engine.policy.miss_cost_j, {}};
  std::vector<Case*> all{&oracle};
  for (Case& one : *cases)
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
  runParallel(line.threads, seeds * all.size(), line.quiet,
              [&](size_t i)
              {
                Case& one = *all[i / seeds];
                Scenario own = scenario;
                own.engine.policy.miss_cost_j = one.lambda;
                one.results[i % seeds] = simulate(own, one.policy, line.seed + static_cast<uint32_t>(i % seeds));
              });
  for (Case& one : *cases)
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
  return !pi_node::StopSignal::came();
}

/// @return exit status.
int run(const CommandLine& line)
{
  pi_node::StopSignal::install();
  Scenario scenario = Scenario::load_file(line.scenario);
  if (line.duration_s > 0.0)
  {
    scenario.duration_s = line.duration_s;
    scenario.validate();
  }
  std::vector<Case> cases =
      makeCases(parsePolicies(line.policies), parseLambdas(line.lambdas), scenario.engine.policy.miss_cost_j);
  if (!simulateAll(line, scenario, &cases))
  {
    std::cerr << "stopped; nothing was written\n";
    return pi_node::StopSignal::exitStatus();
  }
  std::cout << scenario.name << ": " << scenario.vehicles << (scenario.vehicles == 1 ? " vehicle, " : " vehicles, ")
            << scenario.nodes.size() << " nodes, " << line.seeds << (line.seeds == 1 ? " seed" : " seeds") << " of "
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

void requireRange(const char* option, int value, int most)
{
  if (value < 1 || value > most)
  {
    throw po::error(std::string(option) + " " + std::to_string(value) + ", must be in [1, " + std::to_string(most) +
                    "]");
  }
}

bool parse(int argc, char** argv, CommandLine* line)
{
  pi_node::CommandLine options("simulate --scenario S.yaml [--policy P[,P2...]] [options]");
  options.add("scenario", po::value(&line->scenario)->required(), "the world, YAML");
  options.addValue("policy", &line->policies,
                   "names with commas between them: local, nearest, nearest_anywhere, paper_literal, paper, deadline, "
                   "expected_cost, informed, oracle; or all");
  options.addValue("seed", &line->seed, "of the first run");
  options.addValue("seeds", &line->seeds, "runs, each with the next seed, in [1, 10000]");
  options.add("lambda", po::value(&line->lambdas),
              "prices of a missed deadline [J], with commas between them: expected_cost is run with each");
  options.add("duration", po::value(&line->duration_s), "of a run [s]; default: the scenario's");
  options.add("csv", po::value(&line->csv), "writes a line per policy, price and seed, for plot_offload");
  options.add("json", po::value(&line->json), "writes means and standard deviations over the seeds");
  options.addValue("threads", &line->threads, "runs at once, in [1, 64]");
  options.addFlag("quiet", &line->quiet, "no progress");
  if (!options.parse(argc, argv))
  {
    return false;
  }
  requireRange("--seeds", line->seeds, 10000);
  requireRange("--threads", line->threads, 64);
  if (options.given("duration") && !(line->duration_s > 0.0))
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
  return pi_node::runTool(
      "simulate", [&] { return parse(argc, argv, &line); }, [&] { return run(line); });
}
