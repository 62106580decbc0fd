/// Measures the engine of pi_runtime beside its rivals on this machine: plain OpenCL, a condition variable, StarPU (if
/// it was there at build time), and the static map of the paper (π-Edge, section VII.B).
///   bench_runtime [--only latency|idle|drive|transfer|mixture]... [--rounds N] [--seconds S] [--check]
///   bench_runtime --only drive [--inertial] [--overrun F] [--executors native|opencl|any] [--output-csv FILE]
/// Contenders take turns within one run; figures are medians with the range over the rounds. plot_drive.py draws the
/// CSV file. With --check the exit code is 1 if a bar that is a contract is missed.
///
/// StarPU uses its CPU workers only: its OpenCL driver takes a whole PoCL device, that is the cores of those workers.

#include "runtime_bench.h"

#include <boost/program_options.hpp>

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <stdexcept>

namespace pi_runtime_bench
{
namespace
{

struct Part
{
  const char* name;
  void (*run)(Settings*);
};
constexpr Part PARTS[] = {
    {"latency", benchLatency},   {"idle", benchIdle},       {"drive", benchDrive},
    {"transfer", benchTransfer}, {"mixture", benchMixture},
};

/// A folder for this run, known to its children, removed at the end.
class Scratch
{
public:
  Scratch()
  {
    std::string pattern = (std::filesystem::temp_directory_path() / "bench_runtime.XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr)
    {
      throw std::runtime_error("no folder " + pattern + " can be made");
    }
    path_ = pattern;
    setenv("PI_RUNTIME_BENCH_SCRATCH", path_.c_str(), 1);
  }
  ~Scratch()
  {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  const std::string& path() const { return path_; }

private:
  std::string path_;
};

void child(const std::vector<std::string>& words)
{
  const std::string part = words.empty() ? "" : words.front();
  if (part == "idle")
  {
    childIdle(words);
  }
  else if (part == "drive")
  {
    childDrive(words);
  }
  else if (part == "starpu")
  {
    childStarpu(words);
  }
  else
  {
    throw std::invalid_argument("--child is for the program itself");
  }
}

void validate(const Settings& settings, const std::vector<std::string>& only)
{
  if (settings.rounds < 1)
  {
    throw std::invalid_argument("rounds = " + std::to_string(settings.rounds) + ", must be >= 1");
  }
  if (!(settings.seconds / settings.rounds >= 1.0))
  {
    throw std::invalid_argument("seconds = " + std::to_string(settings.seconds) + ", must be >= rounds");
  }
  if (!(settings.overrun > 0.0 && settings.overrun <= 100.0))
  {
    throw std::invalid_argument("overrun = " + std::to_string(settings.overrun) + ", must be in (0, 100]");
  }
  if (settings.executors != "any" && settings.executors != "native" && settings.executors != "opencl")
  {
    throw std::invalid_argument("executors = " + settings.executors + ", must be any, native or opencl");
  }
  for (const std::string& name : only)
  {
    if (std::none_of(std::begin(PARTS), std::end(PARTS), [&](const Part& part) { return name == part.name; }))
    {
      throw std::invalid_argument("only = " + name + ", must be latency, idle, drive, transfer or mixture");
    }
  }
}

int run(int argc, char** argv)
{
  namespace po = boost::program_options;
  Settings settings;
  std::vector<std::string> only;
  po::options_description options("Options");
  options.add_options()("help,h", "this text");
  options.add_options()("only", po::value(&only), "latency, idle, drive, transfer or mixture; may be repeated");
  options.add_options()("rounds", po::value(&settings.rounds)->default_value(5), "in which contenders take turns");
  options.add_options()("seconds", po::value(&settings.seconds)->default_value(60.0),
                        "of each contender of drive in all rounds together; idle takes a tenth");
  options.add_options()("inertial", "drive with a third stream: 200 Hz, tiny");
  options.add_options()("overrun", po::value(&settings.overrun)->default_value(1.0),
                        "drive: detections do this much of the work that they were admitted with");
  options.add_options()("executors", po::value(&settings.executors)->default_value("any"),
                        "implementations of the detection: native, opencl or any");
  options.add_options()("output-csv", po::value(&settings.csv_path), "file for the response times of drive");
  options.add_options()("check", "exit code 1 if a contract is missed");
  po::variables_map values;
  po::store(po::parse_command_line(argc, argv, options), values);
  if (values.count("help") != 0)
  {
    std::cout << options;
    return EXIT_SUCCESS;
  }
  po::notify(values);
  settings.inertial = values.count("inertial") != 0;
  validate(settings, only);
  const Scratch scratch;
  settings.scratch = scratch.path();
  std::printf("%s%s\n", machineLine().c_str(), starpuAvailable() ? "" : "; built without StarPU");
  for (const Part& part : PARTS)
  {
    if (only.empty() || std::find(only.begin(), only.end(), part.name) != only.end())
    {
      part.run(&settings);
    }
  }
  return values.count("check") != 0 && !settings.contract_met ? EXIT_FAILURE : EXIT_SUCCESS;
}

}  // namespace
}  // namespace pi_runtime_bench

int main(int argc, char** argv)
{
  try
  {
    if (argc > 1 && std::string(argv[1]) == "--child")
    {
      pi_runtime_bench::child(std::vector<std::string>(argv + 2, argv + argc));
      return EXIT_SUCCESS;
    }
    return pi_runtime_bench::run(argc, argv);
  }
  catch (const std::exception& error)
  {
    std::cerr << "bench_runtime: " << error.what() << '\n';
    return 2;
  }
}
