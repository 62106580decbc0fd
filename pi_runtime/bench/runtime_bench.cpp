#include "runtime_bench.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace pi_runtime_bench
{
namespace
{

constexpr char SCRATCH_VARIABLE[] = "PI_RUNTIME_BENCH_SCRATCH";

/// Never returns.
[[noreturn]] void becomeChild(int output, const std::vector<std::string>& words,
                              const std::map<std::string, std::string>& environment)
{
  for (const auto& [name, value] : environment)
  {
    setenv(name.c_str(), value.c_str(), 1);
  }
  dup2(output, STDOUT_FILENO);
  std::vector<std::string> texts{"bench_runtime", "--child"};
  texts.insert(texts.end(), words.begin(), words.end());
  std::vector<char*> arguments;
  for (std::string& text : texts)
  {
    arguments.push_back(text.data());
  }
  arguments.push_back(nullptr);
  execv("/proc/self/exe", arguments.data());
  _exit(127);
}

/// All that comes from a pipe until its writers are gone. @return false if that takes until the time is over.
bool readAll(int input, Clock::time_point end, std::string* text)
{
  for (;;)
  {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now()).count();
    pollfd waiting{input, POLLIN, 0};
    if (left <= 0 || poll(&waiting, 1, static_cast<int>(left)) == 0)
    {
      return false;
    }
    char piece[65536];
    const ssize_t bytes = read(input, piece, sizeof piece);
    if (bytes <= 0)
    {
      return true;
    }
    text->append(piece, static_cast<size_t>(bytes));
  }
}

Lines splitLines(const std::string& text)
{
  Lines lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);)
  {
    std::istringstream fields(line);
    std::vector<std::string> words;
    for (std::string word; fields >> word;)
    {
      words.push_back(word);
    }
    if (!words.empty())
    {
      lines.push_back(std::move(words));
    }
  }
  return lines;
}

/// Value of "<name>: <n> kB" in a file of /proc/self.
double kilobytes(const std::string& text, const std::string& name)
{
  const size_t at = text.find("\n" + name + ":");
  return at == std::string::npos ? 0.0 : std::strtod(text.c_str() + at + name.size() + 2, nullptr);
}

}  // namespace

int64_t nowNs()
{
  return Clock::now().time_since_epoch() / std::chrono::nanoseconds(1);
}

double secondsSince(Clock::time_point start)
{
  return std::chrono::duration<double>(Clock::now() - start).count();
}

double quantile(std::vector<double> values, double q)
{
  if (values.empty())
  {
    return 0.0;
  }
  const auto rank = static_cast<size_t>(std::lround(q * static_cast<double>(values.size() - 1)));
  std::nth_element(values.begin(), values.begin() + static_cast<long>(rank), values.end());
  return values[rank];
}

double median(const std::vector<double>& values)
{
  return quantile(values, 0.5);
}

std::string spread(const std::vector<double>& values, const char* format)
{
  if (values.empty())
  {
    return "-";
  }
  const auto text = [format](double value)
  {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, format, value);
    return std::string(buffer);
  };
  return text(median(values)) + " (" + text(quantile(values, 0.0)) + "-" + text(quantile(values, 1.0)) + ")";
}

void printBar(Settings* settings, const std::string& what, double value, double limit, const char* unit, bool contract)
{
  const bool met = value <= limit;
  settings->contract_met = settings->contract_met && (met || !contract);
  std::printf("  => %s: %.3g%s, bar %.3g%s%s: %s\n", what.c_str(), value, unit, limit, unit,
              contract ? " (contract)" : "", met ? "met" : "MISSED");
  std::fflush(stdout);
}

std::string machineLine()
{
  std::string name = "unknown processor";
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
  {
    if (line.rfind("model name", 0) == 0)
    {
      name = line.substr(line.find(':') + 2);
      break;
    }
  }
  std::ifstream load_file("/proc/loadavg");
  double load = 0.0;
  load_file >> load;
  char text[64];
  std::snprintf(text, sizeof text, ", %u cores, load at the start %.2f", std::thread::hardware_concurrency(), load);
  return name + text;
}

double processCpu()
{
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time)
  { return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_usec) * 1e-6; };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

Memory processMemory()
{
  std::ifstream file("/proc/self/smaps_rollup");
  std::ostringstream text;
  text << file.rdbuf();
  return Memory{kilobytes(text.str(), "Rss"), kilobytes(text.str(), "Private_Dirty")};
}

pi_runtime::RuntimeOptions benchOptions()
{
  pi_runtime::RuntimeOptions options;
  const char* const scratch = std::getenv(SCRATCH_VARIABLE);
  if (scratch == nullptr)
  {
    throw std::runtime_error(std::string(SCRATCH_VARIABLE) + " is not set: children are started by the program itself");
  }
  options.arbitration_folder = scratch;
  options.cache_folder = std::string(scratch) + "/programs";
  options.opencl_gpu = false;  // the comparisons are about CPU cores
  return options;
}

Lines runChild(const std::vector<std::string>& words, double limit_s,
               const std::map<std::string, std::string>& environment)
{
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0)
  {
    throw std::runtime_error("no pipe to a child process can be made");
  }
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0)
  {
    becomeChild(ends[1], words, environment);
  }
  close(ends[1]);
  std::string text;
  const bool ended =
      child > 0 &&
      readAll(ends[0], Clock::now() + std::chrono::milliseconds(static_cast<int64_t>(limit_s * 1e3)), &text);
  close(ends[0]);
  int status = 0;
  if (child > 0)
  {
    if (!ended)
    {
      kill(child, SIGKILL);
    }
    waitpid(child, &status, 0);
  }
  if (!ended || !WIFEXITED(status) || WEXITSTATUS(status) != 0)
  {
    throw std::runtime_error("the child process for \"" + (words.empty() ? "" : words.front()) + "\" " +
                             (ended ? "failed" : "did not end in time"));
  }
  return splitLines(text);
}

std::vector<double> valuesOf(const Lines& lines, const std::string& name)
{
  std::vector<double> values;
  for (const std::vector<std::string>& words : lines)
  {
    if (words.front() == name && words.size() > 1)
    {
      values.push_back(std::stod(words[1]));
    }
  }
  return values;
}

std::map<std::string, std::string> starpuEnvironment(const Settings& settings, const std::string& policy, int workers)
{
  return {{"STARPU_HOME", settings.scratch},
          {"STARPU_PERF_MODEL_DIR", settings.scratch + "/starpu"},
          {"STARPU_SCHED", policy},
          {"STARPU_NCPU", std::to_string(workers)},
          {"STARPU_NCUDA", "0"},
          {"STARPU_NOPENCL", "0"},
          {"STARPU_SILENT", "1"}};
}

}  // namespace pi_runtime_bench
