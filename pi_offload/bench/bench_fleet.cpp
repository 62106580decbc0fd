// A fleet on a road with sites along it: real clients, real servers whose detection only takes its time, real
// nats-servers in a cluster, and what happens to them:
//   bench_fleet --vehicles 100 --sites 5 --transport nats --kills 10
//   bench_fleet --vehicles 100 --sites 5 --transport nats --partition 5 --upgrade
// Each task is counted. Exits with 1 if one did not end exactly once.

#include <pi_node/command_line.h>
#include <pi_node/durations.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <fstream>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/offload_client.h"
#include "fleet/site.h"
#include "wire/socket_tools.h"

namespace
{

using namespace pi_offload;
using namespace pi_offload_bench;

constexpr double SPACING_M = 100.0;  ///< of sites
constexpr double RANGE_M = 70.0;
constexpr double SPEED_M_S = 8.0;
constexpr double DEADLINE_S = 0.2;
constexpr double LOCAL_S = 0.09;
constexpr double DOWN_S = 1.0;  ///< from a kill to the new start

struct Arguments
{
  size_t vehicles = 20;
  size_t sites = 2;
  std::string transport = "nats";
  double rate_hz = 10.0;
  double load = 0.6;
  double service_s = 0.03;
  size_t bytes = 40000;
  size_t kills = 0;
  double partition_s = 0.0;
  bool upgrade = false;
  double warm_up_s = 3.0;
  double measured_s = 20.0;
  uint32_t seed = 1;
  std::string host = "127.0.0.1";
  std::string policy = "expected_cost";
  std::string site;

  bool nats() const { return transport == toString(Transport::NATS); }
  bool disturbed() const { return kills > 0 || partition_s > 0.0 || upgrade; }
  /// Of each site, for that load.
  int workers() const
  {
    const double busy = static_cast<double>(vehicles) * rate_hz * service_s;
    return std::max(1, static_cast<int>(std::lround(busy / (load * static_cast<double>(sites)))));
  }
};

/// How the tasks of a fleet ended.
struct Tally
{
  std::mutex mutex;
  uint64_t tasks = 0;
  uint64_t local = 0;
  uint64_t remote = 0;
  uint64_t fallback = 0;
  uint64_t abandoned = 0;
  uint64_t late = 0;
  uint64_t twice = 0;
  std::set<size_t> served;  ///< vehicles
  std::vector<double> answer_s;
  std::map<std::string, std::vector<double>> late_s;  ///< by how long, by who did them and why
};

/// A vehicle that goes along the road; its own detector only takes its time.
class FleetVehicle
{
public:
  FleetVehicle(size_t number, const Arguments& arguments, Tally* tally)
    : number_(number)
    , length_m_(SPACING_M * static_cast<double>(arguments.sites))
    , bytes_(arguments.bytes, 7)
    , tally_(*tally)
  {
    OffloadClientOptions options;
    options.vehicle = "vehicle_" + std::to_string(number);
    options.transport = arguments.nats() ? Transport::NATS : Transport::DIRECT;
    options.engine.policy_name = arguments.policy;
    options.engine.needs[0].deadline_s = DEADLINE_S;
    options.engine.needs[0].work_gcycles = LOCAL_S * options.engine.computer.frequency_ghz;
    OffloadClient::Callbacks callbacks;
    callbacks.run_local = [this](const Task& task)
    {
      const int64_t now_ns = pi_node::monotonicNs();
      const int64_t begin_ns = local_.empty() ? now_ns : std::max(now_ns, local_.back().second);
      local_.emplace_back(task.id, begin_ns + pi_node::nanoseconds(LOCAL_S));
    };
    callbacks.deliver = [this](const Outcome& outcome, const OffloadReply*) { onEnd(outcome); };
    callbacks.log = [](bool, const std::string&) {};
    callbacks.next_time = [this] { return local_.empty() ? INT64_MAX : local_.front().second; };
    callbacks.on_time = [this](int64_t now_ns)
    {
      while (!local_.empty() && local_.front().second <= now_ns)
      {
        const uint64_t task = local_.front().first;
        local_.pop_front();
        client_->engine().onLocalDone(task, LOCAL_S, now_ns);
      }
    };
    client_ = std::make_unique<OffloadClient>(options, std::move(callbacks));
    client_->setClassesKnown(true);
    client_->start();
  }
  ~FleetVehicle() { client_->stop(); }

  void addSite(size_t site, const std::string& address)
  {
    NodeDescription node;
    node.id = "site_" + std::to_string(site);
    node.address = address;
    node.position = {0.0, SPACING_M * (static_cast<double>(site) + 0.5)};
    node.range_m = RANGE_M;
    client_->call([&](int64_t now_ns) { client_->setNode(node, now_ns); });
  }
  void move(double time_s)
  {
    VehicleState state;
    state.known = true;
    state.speed = SPEED_M_S;
    state.position.y = std::fmod(static_cast<double>(number_) * 37.0 + SPEED_M_S * time_s, length_m_);
    client_->post([this, state](int64_t) { client_->engine().setVehicle(state); });
  }
  void submit(bool counts)
  {
    client_->post(
        [this, counts](int64_t now_ns)
        {
          TaskData data;
          data.encoding = Encoding::JPEG;
          data.bytes = bytes_;
          const uint64_t task = ++last_;
          if (counts)
          {
            open_.insert(task);
            const std::lock_guard<std::mutex> lock(tally_.mutex);
            ++tally_.tasks;
          }
          client_->submit(task, TaskKind::DETECTION, now_ns, DEADLINE_S, std::move(data), now_ns);
        });
  }
  size_t open()
  {
    return client_->call([this](int64_t) { return open_.size(); });  // not ended
  }

private:
  void onEnd(const Outcome& outcome)
  {
    const bool first = all_.insert(outcome.task.id).second;
    const bool counts = open_.erase(outcome.task.id) > 0;
    const std::lock_guard<std::mutex> lock(tally_.mutex);
    tally_.twice += first ? 0U : 1U;
    if (!counts)
    {
      return;
    }
    if (!outcome.by_deadline)
    {
      ++tally_.late;
      const char* const by = outcome.how == Outcome::How::REMOTE ? "a site" : "the vehicle";
      tally_.late_s[std::string("by ") + by + ", " + (*outcome.reason != '\0' ? outcome.reason : "as decided")]
          .push_back(pi_node::secondsBetween(outcome.task.created_ns, outcome.finished_ns) - DEADLINE_S);
    }
    switch (outcome.how)
    {
      case Outcome::How::LOCAL:
        ++tally_.local;
        break;
      case Outcome::How::REMOTE:
        ++tally_.remote;
        tally_.served.insert(number_);
        tally_.answer_s.push_back(pi_node::secondsBetween(outcome.task.created_ns, outcome.finished_ns));
        break;
      case Outcome::How::FALLBACK:
        ++tally_.fallback;
        break;
      case Outcome::How::ABANDONED:
        ++tally_.abandoned;
        break;
    }
  }

  const size_t number_;
  const double length_m_;
  const std::vector<uint8_t> bytes_;
  Tally& tally_;
  std::unique_ptr<OffloadClient> client_;
  // On the engine's thread:
  std::deque<std::pair<uint64_t, int64_t>> local_;  ///< task and when it is done
  std::set<uint64_t> open_;
  std::set<uint64_t> all_;
  uint64_t last_ = 0;
};

/// Sites, each with a nats-server if that is the transport.
class Sites
{
public:
  explicit Sites(const Arguments& arguments) : arguments_(arguments)
  {
    std::vector<uint16_t> routes(arguments.sites, 0);
    std::string all;
    for (uint16_t& route : routes)
    {
      route = freePort();
      all += "\"nats-route://127.0.0.1:" + std::to_string(route) + "\", ";
    }
    for (size_t i = 0; arguments.nats() && i < arguments.sites; ++i)
    {
      servers_.push_back(std::make_unique<NatsServer>(
          "max_payload: 8MB\nserver_name: site_" + std::to_string(i) +
              "\ncluster {name: fleet, listen: \"127.0.0.1:" + std::to_string(routes[i]) + "\", routes: [" + all + "]}",
          arguments.host == "127.0.0.1" ? arguments.host : "0.0.0.0"));
    }
    for (size_t i = 0; i < arguments.sites; ++i)
    {
      SiteOptions options;
      options.transport = arguments.nats() ? Transport::NATS : Transport::DIRECT;
      options.host = arguments.host;
      options.workers = arguments.workers();
      options.service_s = arguments.service_s;
      for (size_t k = 0; k < servers_.size(); ++k)
      {
        options.servers.push_back(servers_[(i + k) % servers_.size()]->address());
      }
      sites_.push_back(std::make_unique<Site>("site_" + std::to_string(i), options));
    }
  }

  std::string address(size_t site) const
  {
    return arguments_.host + ":" +
           (arguments_.nats() ? between(servers_[site]->address() + "\n", ":", "\n")
                              : std::to_string(sites_[site]->port()));
  }
  /// kill -9 of the worker or, for odd numbers, of the nats-server with it.
  void kill(size_t number, size_t site)
  {
    sites_[site]->kill();
    if (arguments_.nats() && number % 2 == 1)
    {
      servers_[site]->kill();
    }
  }
  void revive(size_t number, size_t site)
  {
    if (arguments_.nats() && number % 2 == 1)
    {
      servers_[site]->revive();
    }
    sites_[site]->revive();
  }
  /// Nothing of the site answers, and no connection ends, as when its link is cut.
  void silence(size_t site, bool silent)
  {
    const int signal = silent ? SIGSTOP : SIGCONT;
    ::kill(sites_[site]->process(), signal);
    if (arguments_.nats())
    {
      ::kill(servers_[site]->process(), signal);
    }
  }
  /// The worker drains and ends, then its nats-server; both start again.
  void upgrade(size_t site)
  {
    sites_[site]->end();
    if (arguments_.nats())
    {
      servers_[site]->end();
      servers_[site]->revive();
    }
    sites_[site]->revive();
  }
  /// Processor time and memory of the nats-servers. @return seconds, MB of all.
  std::pair<double, double> natsUse() const
  {
    std::pair<double, double> use;
    for (const auto& server : servers_)
    {
      std::ifstream file("/proc/" + std::to_string(server->process()) + "/stat");
      std::string field;
      double ticks = 0.0;
      double pages = 0.0;
      for (int i = 1; i <= 24 && file >> field; ++i)
      {
        ticks += i == 14 || i == 15 ? std::stod(field) : 0.0;
        pages = i == 24 ? std::stod(field) : 0.0;
      }
      use.first += ticks / static_cast<double>(sysconf(_SC_CLK_TCK));
      use.second += pages * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
    }
    return use;
  }

private:
  /// Below those that connections get from the kernel: one of these could have taken it before its server starts.
  static uint16_t freePort()
  {
    static std::mt19937 random(std::random_device{}());
    for (;;)
    {
      auto port = static_cast<uint16_t>(20000 + random() % 12000);
      try
      {
        listenOn("127.0.0.1", &port);
        return port;
      }
      catch (const std::runtime_error&)
      {
        // taken
      }
    }
  }

  const Arguments& arguments_;
  std::vector<std::unique_ptr<NatsServer>> servers_;
  std::vector<std::unique_ptr<Site>> sites_;
};

struct OwnUse
{
  double threads = 0.0;
  double sockets = 0.0;
  double memory_mb = 0.0;
  double processor_s = 0.0;
};

OwnUse ownUse()
{
  OwnUse use;
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
  {
    use.threads = line.rfind("Threads:", 0) == 0 ? std::stod(line.substr(8)) : use.threads;
    use.memory_mb = line.rfind("VmRSS:", 0) == 0 ? std::stod(line.substr(6)) / 1e3 : use.memory_mb;
  }
  std::error_code gone;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd"))
  {
    use.sockets += std::filesystem::read_symlink(entry.path(), gone).string().rfind("socket:", 0) == 0 ? 1.0 : 0.0;
  }
  // Without this thread, which plays the road.
  rusage all{};
  rusage own{};
  getrusage(RUSAGE_SELF, &all);
  getrusage(RUSAGE_THREAD, &own);
  const auto seconds = [](const rusage& of)
  {
    return static_cast<double>(of.ru_utime.tv_sec + of.ru_stime.tv_sec) +
           1e-6 * static_cast<double>(of.ru_utime.tv_usec + of.ru_stime.tv_usec);
  };
  use.processor_s = seconds(all) - seconds(own);
  return use;
}

/// Moves the vehicles, makes their tasks, and disturbs the sites.
class Drive
{
public:
  Drive(const Arguments& arguments, Sites* sites, std::vector<std::unique_ptr<FleetVehicle>>* vehicles)
    : arguments_(arguments), sites_(*sites), vehicles_(*vehicles), random_(arguments.seed)
  {
  }

  ~Drive()
  {
    over_.set_value();
    if (trouble_.joinable())
    {
      trouble_.join();
    }
  }
  Drive(const Drive&) = delete;
  Drive& operator=(const Drive&) = delete;

  /// @param measured  tasks count, and the sites are disturbed.
  void run(double duration_s, bool measured)
  {
    const double period_s = 1.0 / (arguments_.rate_hz * static_cast<double>(vehicles_.size()));
    const auto start = std::chrono::steady_clock::now();
    std::promise<void> disturbed;
    if (measured && arguments_.disturbed())
    {
      // A server's start takes its time; and servers end with the thread that started them.
      trouble_ = std::thread(
          [this, start, duration_s, &disturbed]
          {
            const std::future<void> over = over_.get_future();
            disturb(start, duration_s);
            disturbed.set_value();
            over.wait();
          });
    }
    uint64_t made = 0;
    for (double now_s = 0.0; now_s < duration_s; now_s += STEP_S)
    {
      std::this_thread::sleep_until(start + std::chrono::duration<double>(now_s));
      time_s_ += STEP_S;
      for (; period_s * static_cast<double>(made) < now_s && arguments_.rate_hz > 0.0; ++made)
      {
        vehicles_[next_++ % vehicles_.size()]->submit(measured);
      }
      if (std::fmod(time_s_, MOVE_S) < STEP_S)
      {
        for (const auto& vehicle : vehicles_)
        {
          vehicle->move(time_s_);
        }
      }
    }
    if (trouble_.joinable())
    {
      disturbed.get_future().wait();
    }
  }

private:
  using Instant = std::chrono::steady_clock::time_point;

  static void pause(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }
  void disturb(Instant start, double duration_s)
  {
    const double period_s = duration_s / static_cast<double>(arguments_.kills + 1);
    for (size_t number = 0; number < arguments_.kills; ++number)
    {
      std::this_thread::sleep_until(start +
                                    std::chrono::duration<double>(period_s * (static_cast<double>(number) + 0.5)));
      const size_t site = random_() % arguments_.sites;
      sites_.kill(number, site);
      pause(DOWN_S);
      sites_.revive(number, site);
    }
    if (arguments_.partition_s > 0.0)
    {
      pause(DOWN_S);
      const auto cut = [this](bool silent)
      {
        for (size_t site = 0; site < (arguments_.sites + 1) / 2; ++site)
        {
          sites_.silence(site, silent);
        }
      };
      cut(true);
      pause(arguments_.partition_s);
      cut(false);
    }
    for (size_t site = 0; arguments_.upgrade && site < arguments_.sites; ++site)
    {
      pause(DOWN_S);
      sites_.upgrade(site);
    }
  }

  static constexpr double STEP_S = 0.005;
  static constexpr double MOVE_S = 0.5;
  const Arguments& arguments_;
  Sites& sites_;
  std::vector<std::unique_ptr<FleetVehicle>>& vehicles_;
  std::mt19937 random_;
  double time_s_ = 0.0;
  size_t next_ = 0;
  std::promise<void> over_;
  std::thread trouble_;
};

double percentileMs(std::vector<double>* values, double share)
{
  std::sort(values->begin(), values->end());
  const auto at = static_cast<size_t>(share * static_cast<double>(values->size()));
  return values->empty() ? std::nan("") : 1e3 * (*values)[std::min(values->size() - 1, at)];
}

/// @return whether all tasks ended exactly once.
bool measure(const Arguments& arguments)
{
  Sites sites(arguments);
  const OwnUse alone = ownUse();
  Tally tally;
  std::vector<std::unique_ptr<FleetVehicle>> vehicles;
  for (size_t i = 0; i < arguments.vehicles; ++i)
  {
    vehicles.push_back(std::make_unique<FleetVehicle>(i, arguments, &tally));
    for (size_t site = 0; site < arguments.sites; ++site)
    {
      vehicles.back()->addSite(site, sites.address(site));
    }
  }
  Drive drive(arguments, &sites, &vehicles);
  drive.run(arguments.warm_up_s, false);
  const OwnUse before = ownUse();
  const auto nats_before = sites.natsUse();
  drive.run(arguments.measured_s, true);
  const OwnUse after = ownUse();
  const auto nats_after = sites.natsUse();
  size_t open = 0;
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  do
  {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    open = 0;
    for (const auto& vehicle : vehicles)
    {
      open += vehicle->open();
    }
  } while (open > 0 && std::chrono::steady_clock::now() < until);
  const std::lock_guard<std::mutex> lock(tally.mutex);
  const auto count = static_cast<double>(vehicles.size());
  const auto part = [&](uint64_t of)
  { return 100.0 * static_cast<double>(of) / std::max(1.0, static_cast<double>(tally.tasks)); };
  std::printf(
      "| transport | vehicles | sites x workers | kills, partition [s], upgrades | tasks | by a site %% | at home %% | "
      "fallback %% | late %% | not ended | twice | never served | site's answer p50, p99 [ms] | threads, connections, "
      "MB, %% of a core per "
      "vehicle | nats-servers: MB, %% of a core each |\n");
  std::printf("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  std::printf(
      "| %s | %zu | %zu x %d | %zu, %.0f, %zu | %llu | %.2f | %.2f | %.2f | %.3f | %zu | %llu | %zu | %.1f, %.1f | "
      "%.1f, %.1f, %.2f, %.2f | %.1f, %.2f |\n",
      arguments.transport.c_str(), vehicles.size(), arguments.sites, arguments.workers(), arguments.kills,
      arguments.partition_s, arguments.upgrade ? arguments.sites : 0, static_cast<unsigned long long>(tally.tasks),
      part(tally.remote), part(tally.local), part(tally.fallback), part(tally.late), open,
      static_cast<unsigned long long>(tally.twice), vehicles.size() - tally.served.size(),
      percentileMs(&tally.answer_s, 0.5), percentileMs(&tally.answer_s, 0.99), (before.threads - alone.threads) / count,
      (before.sockets - alone.sockets) / count, (after.memory_mb - alone.memory_mb) / count,
      100.0 * (after.processor_s - before.processor_s) / arguments.measured_s / count,
      nats_after.second / static_cast<double>(arguments.sites),
      arguments.disturbed() ? std::nan("")
                            : 100.0 * (nats_after.first - nats_before.first) / arguments.measured_s /
                                  static_cast<double>(arguments.sites));
  for (auto& [why, values] : tally.late_s)
  {
    std::printf("late: %zu %s: by %.1f ms (p50), %.1f ms (p99)\n", values.size(), why.c_str(),
                percentileMs(&values, 0.5), percentileMs(&values, 0.99));
  }
  return open == 0 && tally.twice == 0 && tally.abandoned == 0 && (tally.tasks > 0 || arguments.rate_hz == 0.0);
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments arguments;
  pi_node::CommandLine line("bench_fleet [options]: vehicles, sites and what happens to these, each task counted");
  line.addValue("vehicles", &arguments.vehicles, "number");
  line.addValue("sites", &arguments.sites, "number, 100 m apart along the road");
  line.addValue("transport", &arguments.transport, "nats or direct");
  line.addValue("rate", &arguments.rate_hz, "[Hz] of pictures of each vehicle; 0: probes only");
  line.addValue("load", &arguments.load, "part of the workers' time, if all is sent; gives their number");
  line.addValue("service", &arguments.service_s, "[s] that a picture takes at a site");
  line.addValue("bytes", &arguments.bytes, "of a picture");
  line.addValue("kills", &arguments.kills, "kill -9 of a worker, in turn with that of a worker and its nats-server");
  line.addValue("partition", &arguments.partition_s, "[s] that half of the sites are silent, after the kills");
  line.addFlag("upgrade", &arguments.upgrade, "then each site drains, ends and starts again, one after the other");
  line.addValue("warm-up", &arguments.warm_up_s, "[s]");
  line.addValue("duration", &arguments.measured_s, "[s] measured");
  line.addValue("seed", &arguments.seed, "of the places of the kills");
  line.addValue("policy", &arguments.policy, "of the vehicles");
  line.addValue("host", &arguments.host, "where vehicles reach sites: 127.0.0.2 for a link that tc shapes");
  line.addValue("site", &arguments.site, "used by itself: be the site of this file");
  return pi_node::runTool(
      "bench_fleet", [&] { return line.parse(argc, argv); },
      [&]
      {
        if (!arguments.site.empty())
        {
          runSite(arguments.site);
          return 0;
        }
        if (!arguments.nats() && arguments.transport != toString(Transport::DIRECT))
        {
          throw std::invalid_argument("transport = " + arguments.transport + ", must be nats or direct");
        }
        if (arguments.vehicles < 1 || arguments.sites < 1 || arguments.sites > 100 || !(arguments.load > 0.0) ||
            !(arguments.rate_hz >= 0.0) || !(arguments.service_s > 0.0) || !(arguments.partition_s >= 0.0))
        {
          throw std::invalid_argument(
              "vehicles, sites, load and service must be positive, sites at most 100, rate and partition not negative");
        }
        rlimit limit{};
        getrlimit(RLIMIT_NOFILE, &limit);
        limit.rlim_cur = limit.rlim_max;
        setrlimit(RLIMIT_NOFILE, &limit);
        return measure(arguments) ? 0 : 1;
      });
}
