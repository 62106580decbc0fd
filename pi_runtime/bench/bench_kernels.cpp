// Times every kernel of pi_runtime three ways on one core each: its native implementation, its OpenCL kernel on one
// compute unit of PoCL, and what OpenCV does single-threaded. The three take turns, so that what else the machine does
// hits all of them; the table shows medians with the span from the lower to the upper quartile.
//
//   bench_kernels [--filter TEXT] [--rounds N] [--clock wall|cpu]
//
// On a busy machine take --clock cpu: the processor time of this process, PoCL's threads included. It leaves out the
// time that others take away, but also what it costs to wait for another thread to wake up.

#include <sched.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernel_cases.h"

namespace pi_runtime
{
namespace
{

struct Options
{
  std::string filter;
  int rounds = 60;
  clockid_t clock = CLOCK_MONOTONIC;
};

struct Sample
{
  double median = 0.0;  ///< [us]
  double lower = 0.0;   ///< quartile [us]
  double upper = 0.0;   ///< quartile [us]
};

const char USAGE[] = "usage: bench_kernels [--filter TEXT] [--rounds N] [--clock wall|cpu]";

void setOption(const std::string& name, const std::string& value, Options* options)
{
  if (name == "--filter")
  {
    options->filter = value;
  }
  else if (name == "--rounds" && std::atoi(value.c_str()) >= 3)
  {
    options->rounds = std::atoi(value.c_str());
  }
  else if (name == "--clock" && (value == "wall" || value == "cpu"))
  {
    options->clock = value == "cpu" ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC;
  }
  else
  {
    throw std::invalid_argument("cannot take " + name + " " + value + " (rounds: at least 3); " + USAGE);
  }
}

Options parse(int argc, char** argv)
{
  Options options;
  for (int i = 1; i < argc; i += 2)
  {
    if (i + 1 == argc)
    {
      throw std::invalid_argument(std::string("no value for ") + argv[i] + "; " + USAGE);
    }
    setOption(argv[i], argv[i + 1], &options);
  }
  return options;
}

std::string processorName()
{
  std::ifstream info("/proc/cpuinfo");
  std::string line;
  while (std::getline(info, line))
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown processor";
}

/// Keeps this thread off the core of PoCL's first worker, which POCL_AFFINITY ties to core 0: what runs on one core
/// then does not disturb the other, and threads do not wander.
void pinToLastCore()
{
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  sched_getaffinity(0, sizeof allowed, &allowed);
  for (int core = CPU_SETSIZE - 1; core >= 0; --core)
  {
    if (CPU_ISSET(core, &allowed))
    {
      CPU_ZERO(&allowed);
      CPU_SET(core, &allowed);
      sched_setaffinity(0, sizeof allowed, &allowed);
      return;
    }
  }
}

double now(clockid_t clock)
{
  timespec time;
  clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) * 1e6 + static_cast<double>(time.tv_nsec) * 1e-3;
}

double microseconds(clockid_t clock, const std::function<void()>& function)
{
  const double begin = now(clock);
  function();
  return now(clock) - begin;
}

Sample summarise(std::vector<double> times)
{
  Sample sample;
  if (times.empty())
  {
    return sample;
  }
  std::sort(times.begin(), times.end());
  sample.median = times[times.size() / 2];
  sample.lower = times[times.size() / 4];
  sample.upper = times[times.size() * 3 / 4];
  return sample;
}

void printSample(const Sample& sample)
{
  if (sample.median > 0.0)
  {
    std::printf(" %9.1f %7.1f-%-8.1f", sample.median, sample.lower, sample.upper);
  }
  else
  {
    std::printf(" %9s %16s", "-", "");
  }
}

void printRatio(const Sample& time, const Sample& reference)
{
  if (reference.median > 0.0)
  {
    std::printf(" %9.2f", time.median / reference.median);
  }
  else
  {
    std::printf(" %9s", "-");
  }
}

void measure(const KernelCase& kernel, const Options& options)
{
  std::vector<double> native;
  std::vector<double> opencl;
  std::vector<double> opencv;
  const int unmeasured = 3;  // compile, fault pages in, warm caches
  for (int round = -unmeasured; round < options.rounds; ++round)
  {
    const double native_us = microseconds(options.clock, kernel.native);
    const double opencl_us = microseconds(options.clock, kernel.opencl);
    const double opencv_us = kernel.opencv ? microseconds(options.clock, kernel.opencv) : 0.0;
    if (round < 0)
    {
      continue;
    }
    native.push_back(native_us);
    opencl.push_back(opencl_us);
    if (kernel.opencv)
    {
      opencv.push_back(opencv_us);
    }
  }
  const Sample samples[] = {summarise(native), summarise(opencl), summarise(opencv)};
  std::printf("%-34s", kernel.name.c_str());
  for (const Sample& sample : samples)
  {
    printSample(sample);
  }
  printRatio(samples[0], samples[2]);
  printRatio(samples[1], samples[0]);
  std::printf("\n");
  std::fflush(stdout);
}

void run(const Options& options)
{
  pinToLastCore();
  cv::setNumThreads(1);
  CodeletRunner runner;
  std::vector<KernelCase> cases = frontEndCases(runner);
  for (const auto& group : {descriptorCases, imageCases})
  {
    for (KernelCase& kernel : group(runner))
    {
      cases.push_back(std::move(kernel));
    }
  }
  std::printf("machine: %s, OpenCV %s, %d alternating rounds, one core each, %s time\n", processorName().c_str(),
              CV_VERSION, options.rounds, options.clock == CLOCK_MONOTONIC ? "wall" : "processor");
  std::printf("%-34s %9s %-16s %9s %-16s %9s %-16s %9s %9s\n", "median [us], quartiles [us]", "native", "", "opencl",
              "", "OpenCV", "", "nat/OCV", "ocl/nat");
  for (const KernelCase& kernel : cases)
  {
    if (kernel.name.find(options.filter) != std::string::npos)
    {
      measure(kernel, options);
    }
  }
}

}  // namespace
}  // namespace pi_runtime

int main(int argc, char** argv)
{
  setenv("POCL_AFFINITY", "1", 1);  // before the first OpenCL call
  try
  {
    pi_runtime::run(pi_runtime::parse(argc, argv));
  }
  catch (const std::exception& error)
  {
    std::cerr << "bench_kernels: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
