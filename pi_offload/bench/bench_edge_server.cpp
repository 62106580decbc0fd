// Many vehicles at real edge_servers, which this program starts with pi_detect's own network, on this machine:
//   bench_edge_server [--pictures FOLDER] [--sound FILE] [--vehicles 1,5,10,20,50] [--servers 1,2] [--workers 1]
// Each vehicle sends pictures of 640x480 at 10 Hz as JPEG, wants an answer within 200 ms, and asks for leases; with
// --sound also an utterance every 4 s, within 500 ms. With --engine an OffloadEngine decides what is sent; without it
// everything is sent. Vehicles compute nothing: what is refused they would do themselves, and it is counted.
// Exits with 1 if a bar was missed.

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "fleet/fleet.h"
#include "fleet/inputs.h"
#include "fleet/server_process.h"

namespace
{

namespace fs = std::filesystem;
namespace po = boost::program_options;
using namespace pi_offload_bench;
using pi_offload::TASK_KINDS;
using pi_offload::TaskKind;

constexpr size_t DETECTION = static_cast<size_t>(TaskKind::DETECTION);
constexpr size_t SPEECH = static_cast<size_t>(TaskKind::SPEECH);
constexpr double SPEECH_HZ = 0.25;

// The bars.
constexpr double LEAST_FAIRNESS = 0.9;
constexpr double LEAST_PART_OF_MEAN = 0.5;  ///< a vehicle served less than that starves
constexpr double MOST_TIMEOUTS = 0.05;      ///< of what the servers do not do under overload
constexpr double LEAST_BUSY = 0.85;         ///< of the workers' time, under overload
constexpr double OVERLOAD = 1.2;            ///< so much more is asked for than the workers can do

struct Arguments
{
  std::string pictures;
  std::string sound;
  std::string server;
  std::vector<size_t> vehicles;
  std::vector<size_t> servers;
  int workers = 1;
  bool engine = false;
  double warm_up_s = 0.0;
  double measured_s = 0.0;
};

std::vector<size_t> numbers(const char* name, const std::string& text, size_t most)
{
  std::vector<size_t> values;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, ',');)
  {
    char* end = nullptr;
    const unsigned long value = std::strtoul(part.c_str(), &end, 10);
    if (part.empty() || *end != '\0' || value < 1 || value > most)
    {
      throw std::invalid_argument(std::string(name) + " = " + text + ", must be numbers in [1, " +
                                  std::to_string(most) + "], with commas between them");
    }
    values.push_back(value);
  }
  if (values.empty())
  {
    throw std::invalid_argument(std::string(name) + " = \"\", must be a number at least");
  }
  return values;
}

double checked(const char* name, double value, double least, double most)
{
  if (!(value >= least && value <= most))
  {
    std::ostringstream text;
    text << name << " = " << value << ", must be in [" << least << ", " << most << "]";
    throw std::invalid_argument(text.str());
  }
  return value;
}

fs::path ownFolder()
{
  return fs::read_symlink("/proc/self/exe").parent_path();
}

/// @return false: only help was wanted.
bool parse(int argc, char** argv, Arguments* arguments)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  std::string vehicles;
  std::string servers;
  po::options_description description("Simulated vehicles at real edge_servers");
  description.add_options()(
      "pictures",
      po::value(&arguments->pictures)->default_value(data != nullptr ? std::string(data) + "/detect/images_dev" : ""),
      "folder of JPEG pictures")("sound", po::value(&arguments->sound),
                                 "an utterance; then vehicles also ask for speech")(
      "server", po::value(&arguments->server)->default_value((ownFolder() / "edge_server").string()), "program")(
      "vehicles", po::value(&vehicles)->default_value("1,5,10,20,50"), "numbers of vehicles")(
      "servers", po::value(&servers)->default_value("1,2"), "numbers of servers")(
      "workers", po::value(&arguments->workers)->default_value(1), "of each server")(
      "engine", po::bool_switch(&arguments->engine), "an OffloadEngine of each vehicle decides")(
      "warm-up", po::value(&arguments->warm_up_s)->default_value(5.0), "[s]")(
      "duration", po::value(&arguments->measured_s)->default_value(60.0), "[s] measured in each case")("help",
                                                                                                       "this text");
  po::variables_map values;
  po::store(
      po::command_line_parser(argc, argv).options(description).positional(po::positional_options_description()).run(),
      values);
  po::notify(values);
  if (values.count("help") != 0)
  {
    std::cout << description;
    return false;
  }
  arguments->vehicles = numbers("vehicles", vehicles, 250);
  arguments->servers = numbers("servers", servers, 8);
  checked("workers", arguments->workers, 1, 64);
  checked("warm-up", arguments->warm_up_s, 1.0, 600.0);
  checked("duration", arguments->measured_s, 1.0, 3600.0);
  if (arguments->pictures.empty())
  {
    throw std::invalid_argument("pictures is not given and PI_EDGE_DATA not set; give --pictures FOLDER");
  }
  return true;
}

std::string machineName()
{
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown processor";
}

/// Each vehicle has a connection to each server, and a few descriptors with it.
void allowManyDescriptors()
{
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
}

/// Of all programs on the machine.
double machineProcessorSeconds()
{
  std::ifstream file("/proc/stat");
  std::string name;
  double user = 0.0;
  double nice = 0.0;
  double system = 0.0;
  file >> name >> user >> nice >> system;
  return (user + nice + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

double ownProcessorSeconds()
{
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time)
  { return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_usec) * 1e-6; };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// What is counted at the beginning and at the end.
struct Snapshot
{
  double servers_s = 0.0;  ///< processor time
  double own_s = 0.0;
  double machine_s = 0.0;
  double worker_s = 0.0;  ///< workers with a task
  double done = 0.0;
};

Snapshot take(const std::vector<std::unique_ptr<ServerProcess>>& servers)
{
  Snapshot now;
  for (const auto& server : servers)
  {
    now.servers_s += server->processorSeconds();
    const std::map<std::string, double> metrics = server->metrics();
    now.worker_s += metrics.at("pi_offload_busy_seconds_total");
    now.done += metrics.at("pi_offload_tasks_done_total{kind=\"detection\"}") +
                metrics.at("pi_offload_tasks_done_total{kind=\"speech\"}");
  }
  now.own_s = ownProcessorSeconds();
  now.machine_s = machineProcessorSeconds();
  return now;
}

double percentile(std::vector<double> values, double share)
{
  if (values.empty())
  {
    return std::nan("");
  }
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<size_t>(share * static_cast<double>(values.size())))];
}

/// (sum x)^2 / (n sum x^2): 1 if all have the same, 1/n if one has all.
double jain(const std::vector<uint64_t>& values)
{
  double sum = 0.0;
  double squares = 0.0;
  for (const uint64_t value : values)
  {
    sum += static_cast<double>(value);
    squares += static_cast<double>(value) * static_cast<double>(value);
  }
  return squares > 0.0 ? sum * sum / (static_cast<double>(values.size()) * squares) : 0.0;
}

/// In the pattern of printf; "-" for what is not known.
std::string text(const char* pattern, double value)
{
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, std::isnan(value) ? "-" : pattern, value);
  return buffer;
}

/// p50 and p99 [ms].
std::string percentiles(const std::vector<double>& seconds)
{
  return text("%.0f", 1e3 * percentile(seconds, 0.5)) + ", " + text("%.0f", 1e3 * percentile(seconds, 0.99));
}

double share(uint64_t part, uint64_t all)
{
  return all == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(all);
}

class Bench
{
public:
  explicit Bench(const Arguments& arguments)
    : arguments_(arguments)
    , inputs_{loadPictures(arguments.pictures),
              arguments.sound.empty() ? std::vector<uint8_t>() : loadSound(arguments.sound)}
  {
  }

  void printHead() const
  {
    size_t bytes = 0;
    for (const auto& picture : inputs_.pictures)
    {
      bytes += picture.size();
    }
    std::printf("%s, %ld cores; %zu pictures of %dx%d, JPEG of %zu kB each; %s; %.0f s measured after %.0f s\n\n",
                machineName().c_str(), sysconf(_SC_NPROCESSORS_ONLN), inputs_.pictures.size(), PICTURE_WIDTH,
                PICTURE_HEIGHT, bytes / inputs_.pictures.size() / 1000,
                arguments_.engine ? "an OffloadEngine decides" : "all are sent", arguments_.measured_s,
                arguments_.warm_up_s);
    std::fflush(stdout);
  }

  void measure(size_t servers, size_t vehicles)
  {
    std::vector<std::unique_ptr<ServerProcess>> processes;
    FleetOptions options;
    for (size_t i = 0; i < servers; ++i)
    {
      processes.push_back(std::make_unique<ServerProcess>(arguments_.server, config(i)));
      options.servers.push_back(processes.back()->address());
    }
    options.vehicles = vehicles;
    options.engine = arguments_.engine;
    options.rate_hz[SPEECH] = inputs_.sound.empty() ? 0.0 : SPEECH_HZ;
    options.warm_up_s = arguments_.warm_up_s;
    options.measured_s = arguments_.measured_s;
    std::array<FleetTally, TASK_KINDS> tallies;
    Snapshot before;
    Snapshot after;
    {
      Fleet fleet(options, inputs_);
      fleet.waitForBegin();
      before = take(processes);
      fleet.waitForEnd();
      after = take(processes);
      tallies = fleet.finish();
    }
    for (const auto& process : processes)
    {
      if (process->end() != 0)
      {
        throw std::runtime_error("an edge_server did not end in order");
      }
    }
    print(options, tallies[DETECTION], before, after);
    if (options.rate_hz[SPEECH] > 0.0)
    {
      printSpeech(tallies[SPEECH]);
    }
  }

  /// @return whether all bars were held.
  bool printBars() const
  {
    std::printf("%s\n", speech_.c_str());
    std::printf("\nfairness at least %.1f: %s\n", LEAST_FAIRNESS, worstText(least_fairness_, LEAST_FAIRNESS).c_str());
    std::printf("each vehicle served at least %.1f times the mean: %s\n", LEAST_PART_OF_MEAN,
                worstText(least_part_, LEAST_PART_OF_MEAN).c_str());
    std::printf("workers busy for %.2f of the time under overload: %s\n", LEAST_BUSY,
                worstText(least_busy_, LEAST_BUSY).c_str());
    std::printf("timeouts at most %.2f of what is not done under overload: %s\n", MOST_TIMEOUTS,
                worstText(-most_timeouts_, -MOST_TIMEOUTS).c_str());
    return least_fairness_ >= LEAST_FAIRNESS && least_part_ >= LEAST_PART_OF_MEAN && least_busy_ >= LEAST_BUSY &&
           most_timeouts_ <= MOST_TIMEOUTS;
  }

private:
  static std::string worstText(double value, double bound)
  {
    return std::isinf(value) ? "not tried"
                             : (value >= bound ? "held, worst " : "missed, worst ") + text("%.3f", std::abs(value));
  }

  std::string config(size_t number) const
  {
    std::ostringstream text;
    text << "{id: server_" << number << ", host: 127.0.0.1, port: 0, health: {host: 127.0.0.1, port: 0},\n"
         << " admission: {workers: " << arguments_.workers
         << "}, speech: {enabled: " << (inputs_.sound.empty() ? "false" : "true") << "}}\n";
    return text.str();
  }

  using Cells = std::vector<std::pair<const char*, std::string>>;  ///< heading and text

  void print(const FleetOptions& options, const FleetTally& tally, const Snapshot& before, const Snapshot& after)
  {
    const double window_s = options.measured_s;
    const double workers = static_cast<double>(options.servers.size()) * arguments_.workers;
    const double busy = (after.worker_s - before.worker_s) / (window_s * workers);
    const double service_s = (after.worker_s - before.worker_s) / std::max(1.0, after.done - before.done);
    const double cores_servers = (after.servers_s - before.servers_s) / window_s;
    const double cores_own = (after.own_s - before.own_s) / window_s;
    const double cores_all = (after.machine_s - before.machine_s) / window_s;
    const double fairness = jain(tally.served);
    const uint64_t least = *std::min_element(tally.served.begin(), tally.served.end());
    const double part = share(least * options.vehicles, tally.in_time);
    // Who gets a task back so late cannot do it in time any more: to that vehicle it is a timeout, too.
    const double latest_s = options.deadline_s[DETECTION] - options.local_s;
    const auto too_late = static_cast<uint64_t>(std::count_if(tally.given_back_s.begin(), tally.given_back_s.end(),
                                                              [&](double passed_s) { return passed_s > latest_s; }));
    const double asked_hz = static_cast<double>(tally.tasks) / window_s;
    const auto part_of_tasks = [&](uint64_t count) { return text("%.1f %%", 100.0 * share(count, tally.tasks)); };
    Cells cells = {
        {"servers x workers", std::to_string(options.servers.size()) + " x " + std::to_string(arguments_.workers)},
        {"vehicles", std::to_string(options.vehicles)},
        {"pictures [1/s]", text("%.0f", asked_hz)},
        {"answered in time [1/s]", text("%.1f", static_cast<double>(tally.in_time) / window_s)},
        {"service [ms]", text("%.1f", 1e3 * service_s)},
        {"workers busy", text("%.2f", busy)},
        {"refused", part_of_tasks(tally.refused)},
    };
    if (options.engine)
    {
      cells.emplace_back("not sent", part_of_tasks(tally.kept));
    }
    else
    {
      cells.emplace_back("given back, of that late", part_of_tasks(tally.given_back) + ", " + part_of_tasks(too_late));
    }
    cells.emplace_back("timeouts", text("%.2f %%", 100.0 * share(tally.late, tally.tasks)));
    cells.emplace_back("failed", text("%.2f %%", 100.0 * share(tally.failed, tally.tasks)));
    if (options.engine)
    {
      cells.emplace_back("missed", text("%.2f %%", 100.0 * share(tally.missed, tally.tasks)));
    }
    cells.emplace_back("answer p50, p99 [ms]", percentiles(tally.answer_s));
    if (!options.engine)
    {
      cells.emplace_back("refusal p50, p99 [ms]", percentiles(tally.refusal_s));
    }
    cells.emplace_back("Jain", text("%.3f", fairness));
    cells.emplace_back("least / mean", text("%.2f", part));
    cells.emplace_back("longest pause [s]",
                       text("%.1f", *std::max_element(tally.longest_pause_s.begin(), tally.longest_pause_s.end())));
    cells.emplace_back("cores: servers, this, others",
                       text("%.2f", cores_servers) + ", " + text("%.2f", cores_own) + ", " +
                           text("%.2f", std::max(0.0, cores_all - cores_servers - cores_own)));
    printRow(cells);
    least_fairness_ = std::min(least_fairness_, fairness);
    least_part_ = std::min(least_part_, part);
    if (asked_hz * service_s > OVERLOAD * workers)
    {
      least_busy_ = std::min(least_busy_, busy);
      most_timeouts_ =
          std::max(most_timeouts_, share(tally.late + too_late, tally.tasks - tally.in_time - tally.failed));
    }
  }

  void printRow(const Cells& cells)
  {
    if (!head_printed_)
    {
      std::string rule = "|";
      std::printf("|");
      for (const auto& cell : cells)
      {
        std::printf(" %s |", cell.first);
        rule += "---|";
      }
      std::printf("\n%s\n", rule.c_str());
      head_printed_ = true;
    }
    std::printf("|");
    for (const auto& cell : cells)
    {
      std::printf(" %s |", cell.second.c_str());
    }
    std::printf("\n");
    std::fflush(stdout);
  }

  /// As a line of its own, for the row above it.
  void printSpeech(const FleetTally& tally)
  {
    const auto part_of_tasks = [&](uint64_t count) { return text("%.1f %%", 100.0 * share(count, tally.tasks)); };
    speech_ += "\n" + std::to_string(tally.served.size()) + " vehicles, " + std::to_string(tally.tasks) +
               " utterances: in time " + part_of_tasks(tally.in_time) + ", refused " + part_of_tasks(tally.refused) +
               ", given back " + part_of_tasks(tally.given_back) + ", not sent " + part_of_tasks(tally.kept) +
               ", timeouts " + part_of_tasks(tally.late) + ", failed " + part_of_tasks(tally.failed) +
               "; answer p50, p99 " + percentiles(tally.answer_s) + " ms; Jain " + text("%.3f", jain(tally.served));
  }

  const Arguments& arguments_;
  const FleetInputs inputs_;
  double least_fairness_ = INFINITY;
  double least_part_ = INFINITY;
  double least_busy_ = INFINITY;
  double most_timeouts_ = -INFINITY;
  bool head_printed_ = false;
  std::string speech_;
};

}  // namespace

int main(int argc, char** argv)
{
  try
  {
    Arguments arguments;
    if (!parse(argc, argv, &arguments))
    {
      return 0;
    }
    allowManyDescriptors();
    Bench bench(arguments);
    bench.printHead();
    for (const size_t servers : arguments.servers)
    {
      for (const size_t vehicles : arguments.vehicles)
      {
        bench.measure(servers, vehicles);
      }
    }
    return bench.printBars() ? 0 : 1;
  }
  catch (const po::error& error)
  {
    std::cerr << "bench_edge_server: " << error.what() << "; --help shows how it is called\n";
  }
  catch (const std::exception& error)
  {
    std::cerr << "bench_edge_server: " << error.what() << "\n";
  }
  return 2;
}
