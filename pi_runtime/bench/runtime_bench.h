#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <pi_runtime/runtime_options.h>

namespace pi_runtime_bench
{

/// What the parts of bench_runtime are called with.
struct Settings
{
  int rounds = 5;            ///< alternations between the contenders
  double seconds = 60.0;     ///< of each variant of `drive`, over all rounds; a tenth of it for each idle contender
  bool inertial = false;     ///< `drive` with a third stream of 200 Hz
  double overrun = 1.0;      ///< of `drive`: work of a detection in parts of what it was admitted with
  std::string executors;     ///< of `drive`: "native", "opencl" or "any"
  std::string csv_path;      ///< for the response times of `drive`; empty: none
  std::string scratch;       ///< folder that is removed at the end
  bool contract_met = true;  ///< set to false by a bar that is a contract and is missed
};

void benchLatency(Settings* settings);
void benchIdle(Settings* settings);
void benchDrive(Settings* settings);
void benchTransfer(Settings* settings);
void benchMixture(Settings* settings);

/// What a child process of this program does, by the words behind "--child". Its figures go to standard output, one
/// line each: a name and values.
void childIdle(const std::vector<std::string>& words);
void childDrive(const std::vector<std::string>& words);
void childStarpu(const std::vector<std::string>& words);

/// False if the program was built without StarPU.
bool starpuAvailable();

using Clock = std::chrono::steady_clock;

/// Nanoseconds of Clock, which is CLOCK_MONOTONIC.
int64_t nowNs();
double secondsSince(Clock::time_point start);

/// q-th quantile, 0 <= q <= 1, by the nearest rank; 0 without values.
double quantile(std::vector<double> values, double q);
double median(const std::vector<double>& values);
/// "1.23 (1.10-1.41)": median with least and largest.
std::string spread(const std::vector<double>& values, const char* format = "%.2f");

/// One line on a measured figure and its limit. A missed contract is noted in the settings.
void printBar(Settings* settings, const std::string& what, double value, double limit, const char* unit, bool contract);

std::string machineLine();

/// CPU time of this process so far, all threads [s].
double processCpu();

/// Memory of this process [kB].
struct Memory
{
  double rss_kb;      ///< resident, pages shared with others included
  double private_kb;  ///< resident pages that it has written itself: nobody can share them
};
Memory processMemory();

/// Options of a Runtime that shares its units with nobody outside this run of the benchmark and leaves no files.
pi_runtime::RuntimeOptions benchOptions();

using Lines = std::vector<std::vector<std::string>>;

/// Runs this program as another process with "--child" and the words, and returns the words of its output's lines.
/// @param environment  variables to set there.
/// @throws std::runtime_error if it fails, or takes longer than limit_s; it is killed then.
Lines runChild(const std::vector<std::string>& words, double limit_s,
               const std::map<std::string, std::string>& environment = {});
/// The values of the lines that begin with `name`.
std::vector<double> valuesOf(const Lines& lines, const std::string& name);

/// The environment in which a child uses StarPU on this number of CPU workers: calibrated in a folder of this run.
std::map<std::string, std::string> starpuEnvironment(const Settings& settings, const std::string& policy, int workers);

}  // namespace pi_runtime_bench
