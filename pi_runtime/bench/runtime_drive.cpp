// Part `drive` of bench_runtime: streams with deadlines on shared units, by pi_runtime, by the paper's static map, and
// by StarPU. Each contender runs in a process of its own; they take turns.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <stdexcept>

#include <pi_runtime/runtime.h>
#include "drive_work.h"
#include "runtime_bench.h"

namespace pi_runtime_bench
{
namespace
{

constexpr double START_LIMIT_S = 60.0;  ///< for start, compilation and calibration of a contender

struct Contender
{
  std::string name;  ///< also the variant of our own ones
  std::string title;
  std::string starpu_policy;  ///< empty: it is no StarPU
  int workers = 2;
  bool contract = false;  ///< the front end must not miss a deadline
};

/// All jobs of one stream under one contender.
struct StreamFigures
{
  double deadline_s = 0.0;
  std::vector<double> responses_s;  ///< of those that ended
  size_t jobs = 0;
  size_t missed = 0;

  double missPercent() const
  {
    return jobs == 0 ? 0.0 : 100.0 * static_cast<double>(missed) / static_cast<double>(jobs);
  }
};

struct Figures
{
  std::map<std::string, StreamFigures> streams;
  std::vector<double> cpu_percent;
  std::vector<std::string> notes;
  std::vector<double> front_end_misses_percent;  ///< per round
};

std::vector<Contender> contenders()
{
  std::vector<Contender> all{
      {"ours", "pi_runtime, 2 units: streams admitted, short jobs interrupt", "", 2, true},
      {"ours_uninterrupted", "pi_runtime, 2 units: streams admitted, nothing is interrupted", "", 2, true},
      {"ours_one_unit", "pi_runtime, 1 unit: short jobs interrupt", "", 1, false},
      {"ours_one_unit_uninterrupted", "pi_runtime, 1 unit: detection in slices", "", 1, false},
      {"static_one_unit", "static map, both on 1 unit, FIFO (paper, VII.B)", "", 2, false},
      {"static_two_units", "static map, a unit each, FIFO", "", 2, false},
  };
  if (starpuAvailable())
  {
    all.push_back({"starpu_dmda", "StarPU dmda, 2 workers", "dmda", 2, false});
    all.push_back({"starpu_dmdas", "StarPU dmdas with priorities, 2 workers", "dmdas", 2, false});
    all.push_back({"starpu_one_worker", "StarPU dmdas with priorities, 1 worker", "dmdas", 1, false});
  }
  return all;
}

/// The detection's name is that of its codelet: with slices it is another one.
std::string streamName(const std::string& codelet)
{
  return codelet == "detection_sliced" ? "detection" : codelet;
}

void addJobs(const Lines& lines, Figures* figures)
{
  for (const std::vector<std::string>& words : lines)
  {
    if (words.front() == "stream")
    {
      figures->streams[streamName(words.at(1))].deadline_s = std::stod(words.at(2));
    }
    else if (words.front() == "note" && figures->notes.size() < 3)
    {
      std::string note;
      for (size_t i = 1; i < words.size(); ++i)
      {
        note += (i == 1 ? "" : " ") + words[i];
      }
      figures->notes.push_back(note);
    }
  }
  size_t front_end_jobs = 0;
  size_t front_end_missed = 0;
  for (const std::vector<std::string>& words : lines)
  {
    if (words.front() != "job")
    {
      continue;
    }
    const std::string name = streamName(words.at(1));
    StreamFigures& stream = figures->streams[name];
    const double response_s = std::stod(words.at(2));
    const bool missed = response_s < 0.0 || response_s > stream.deadline_s;
    ++stream.jobs;
    stream.missed += missed ? 1 : 0;
    front_end_jobs += name == "front_end" ? 1 : 0;
    front_end_missed += name == "front_end" && missed ? 1 : 0;
    if (response_s >= 0.0)
    {
      stream.responses_s.push_back(response_s);
    }
  }
  figures->front_end_misses_percent.push_back(100.0 * static_cast<double>(front_end_missed) /
                                              static_cast<double>(std::max<size_t>(front_end_jobs, 1)));
  const std::vector<double> cpu = valuesOf(lines, "cpu");
  figures->cpu_percent.insert(figures->cpu_percent.end(), cpu.begin(), cpu.end());
}

Lines runContender(const Settings& settings, const Contender& contender, const WorkSize& size, double seconds)
{
  const std::string inertial = settings.inertial ? "inertial" : "none";
  const double limit_s = seconds + START_LIMIT_S;
  if (contender.starpu_policy.empty())
  {
    return runChild({"drive", contender.name, std::to_string(seconds), std::to_string(size.points),
                     std::to_string(size.layers), settings.executors, inertial},
                    limit_s);
  }
  return runChild({"starpu", "drive", std::to_string(seconds), std::to_string(size.points), std::to_string(size.layers),
                   inertial, contender.starpu_policy == "dmdas" ? "priorities" : "none"},
                  limit_s, starpuEnvironment(settings, contender.starpu_policy, contender.workers));
}

/// The detection's native and OpenCL implementation must agree before they are compared.
void checkTwins()
{
  constexpr uint64_t LAYERS = 8;      // rounding errors grow with the depth
  constexpr float TOLERANCE = 1e-4f;  // values up to 6; the two add in another order
  pi_runtime::RuntimeOptions options = benchOptions();
  options.cpu_units = {1};
  pi_runtime::Runtime runtime(options);
  std::vector<std::vector<float>> results;
  for (const bool native : {true, false})
  {
    pi_runtime::Codelet codelet = *detectionCodelet(false);
    codelet.name = native ? "native_twin" : "opencl_twin";
    (native ? codelet.opencl.clear() : codelet.native.clear());
    const DetectionMemory memory;
    pi_runtime::TaskRequest request;
    request.codelet = makeCodelet(std::move(codelet));
    request.arguments = memory.arguments();
    request.range = Network::HEIGHT * LAYERS;
    const pi_runtime::TaskResult result = runtime.submit(std::move(request)).wait();
    if (!result.ok())
    {
      throw std::runtime_error("the detection does not run: " + result.message);
    }
    const float* const maps = memory.maps->hostAs<float>(pi_runtime::Access::READ);
    results.emplace_back(maps, maps + 2 * Network::MAP_FLOATS);
  }
  for (size_t i = 0; i < results[0].size(); ++i)
  {
    if (!(std::abs(results[0][i] - results[1][i]) <= TOLERANCE))
    {
      throw std::runtime_error("the detection's native and OpenCL implementations differ");
    }
  }
}

void printStream(const StreamFigures& stream)
{
  std::printf(" | %6zu %6.2f %7.2f %7.2f %7.2f", stream.jobs, stream.missPercent(),
              quantile(stream.responses_s, 0.5) * 1e3, quantile(stream.responses_s, 0.99) * 1e3,
              quantile(stream.responses_s, 1.0) * 1e3);
}

void printTable(const std::vector<Contender>& all, const std::map<std::string, Figures>& figures, bool inertial)
{
  std::printf("%-50s | %-38s | %-38s%s | %s\n", "response from the nominal release", "front end, 30 Hz, deadline 33 ms",
              "detection, 10 Hz, deadline 100 ms", inertial ? " | inertial, 200 Hz, deadline 5 ms         " : "",
              "CPU % (range)");
  std::printf("%-50s", "");
  for (int stream = 0; stream < (inertial ? 3 : 2); ++stream)
  {
    std::printf(" | %6s %6s %7s %7s %7s", "jobs", "miss%", "p50 ms", "p99 ms", "max ms");
  }
  std::printf(" |\n");
  for (const Contender& contender : all)
  {
    const Figures& own = figures.at(contender.name);
    std::printf("%-50s", contender.title.c_str());
    for (const char* const name : {"front_end", "detection", "inertial"})
    {
      const auto stream = own.streams.find(name);
      if (stream != own.streams.end())
      {
        printStream(stream->second);
      }
    }
    std::printf(" | %s\n", spread(own.cpu_percent, "%.0f").c_str());
  }
  for (const Contender& contender : all)
  {
    const Figures& own = figures.at(contender.name);
    std::printf("  %s: front-end misses per round %s %%\n", contender.name.c_str(),
                spread(own.front_end_misses_percent, "%.2f").c_str());
    for (const std::string& note : own.notes)
    {
      std::printf("    %s\n", note.c_str());
    }
  }
}

void writeCsv(const std::string& path, const std::vector<Contender>& all, const std::map<std::string, Figures>& figures)
{
  std::ofstream file(path);
  file << "contender,title,stream,deadline_ms,lost,response_ms\n";
  for (const Contender& contender : all)
  {
    for (const auto& [name, stream] : figures.at(contender.name).streams)
    {
      const size_t lost = stream.jobs - stream.responses_s.size();
      for (const double response_s : stream.responses_s)
      {
        file << contender.name << ",\"" << contender.title << "\"," << name << ',' << stream.deadline_s * 1e3 << ','
             << lost << ',' << response_s * 1e3 << '\n';
      }
    }
  }
  file.flush();
  if (!file)
  {
    throw std::runtime_error("output-csv = \"" + path + "\" cannot be written, expected a writable file");
  }
}

}  // namespace

void benchDrive(Settings* settings)
{
  WorkSize size = WorkSize::forThisMachine();
  size.layers = static_cast<int32_t>(std::max(1.0, std::round(size.layers * settings->overrun)));
  checkTwins();
  const double seconds = settings->seconds / settings->rounds;
  std::printf(
      "\nDrive: front end (%d points, %.1f ms) and detection (%d layers, %.0f ms) side by side, %d x %.0f s each;\n"
      "CPU times of one core. Detection by %s. Lost jobs count as missed.\n",
      size.points, size.front_end_s * 1e3, size.layers, DRIVE_DETECTION.typical_s * 1e3 * settings->overrun,
      settings->rounds, seconds,
      settings->executors == "any" ? "the implementation that the ETC table says is faster"
                                   : settings->executors.c_str());
  const std::vector<Contender> all = contenders();
  std::map<std::string, Figures> figures;
  for (int round = 0; round < settings->rounds; ++round)
  {
    for (const Contender& contender : all)
    {
      addJobs(runContender(*settings, contender, size, seconds), &figures[contender.name]);
    }
  }
  printTable(all, figures, settings->inertial);
  for (const Contender& contender : all)
  {
    if (contender.contract)
    {
      printBar(settings, "front-end deadlines missed, " + contender.title,
               figures[contender.name].streams["front_end"].missPercent(), 0.0, " %", true);
    }
  }
  if (!settings->csv_path.empty())
  {
    writeCsv(settings->csv_path, all, figures);
  }
}

}  // namespace pi_runtime_bench
