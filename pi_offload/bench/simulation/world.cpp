#include "simulation/world.h"

#include <algorithm>
#include <cmath>

#include "simulation/hash_random.h"

namespace pi_offload::simulation
{
namespace
{

/// Purposes of random numbers.
enum Purpose : uint64_t
{
  PLACE,
  ARRIVAL,
  SHADOWING,
  LATENCY,
  SERVICE,
  LOCAL,
  OTHERS,
  OUTAGE,
};

/// Longest time of messages after the last task.
constexpr double TAIL_S = 60.0;
constexpr double SHADOWING_STEPS = 10.0;  ///< per correlation distance
constexpr unsigned VEHICLE_SHIFT = 32;

}  // namespace

World::World(const Scenario& scenario, uint32_t seed)
  : scenario_(scenario)
  , seed_(seed)
  , route_(scenario.route)
  , end_ns_(toNs(scenario.duration_s))
  , shadowing_step_m_(scenario.network.correlation_m / SHADOWING_STEPS)
{
  const auto vehicles = static_cast<size_t>(scenario.vehicles);
  tasks_.resize(vehicles);
  for (size_t v = 0; v < vehicles; ++v)
  {
    starts_.push_back(HashRandom(seed, PLACE, v).uniform() * route_.length());
    makeTasks(v);
    for (size_t n = 0; n < scenario.nodes.size(); ++n)
    {
      makeShadowing(v, n);
    }
  }
  others_.resize(scenario.nodes.size());
  outages_.resize(scenario.nodes.size());
  for (size_t n = 0; n < scenario.nodes.size(); ++n)
  {
    makeOthers(n);
    makeOutages(n);
  }
}

void World::makeTasks(size_t vehicle)
{
  std::vector<Task>& tasks = tasks_[vehicle];
  for (const Scenario::Stream& stream : scenario_.streams)
  {
    HashRandom random(seed_, ARRIVAL, vehicle, stream.kind);
    const double period_s = 1.0 / stream.rate_hz;
    double at_s = stream.regular ? random.uniform() * period_s : random.exponential(period_s);
    while (at_s < scenario_.duration_s)
    {
      Task task;
      task.kind = stream.kind;
      task.created_ns = toNs(at_s);
      task.deadline_s = stream.deadline_s;
      task.input_bytes = stream.input_bytes;
      tasks.push_back(task);
      at_s += stream.regular ? period_s : random.exponential(period_s);
    }
  }
  std::stable_sort(tasks.begin(), tasks.end(),
                   [](const Task& a, const Task& b) { return a.created_ns < b.created_ns; });
  for (size_t i = 0; i < tasks.size(); ++i)
  {
    tasks[i].id = (static_cast<uint64_t>(vehicle) << VEHICLE_SHIFT) + i + 1;
  }
}

void World::makeOthers(size_t node)
{
  const Scenario::Load& load = scenario_.load;
  const Scenario::Node& server = scenario_.nodes[node];
  const double fast_s = server.service_s[0];
  const double slow_s = server.service_s[1];
  const double slow_share = fast_s == slow_s ? 0.5 : std::clamp((load.task_s - fast_s) / (slow_s - fast_s), 0.0, 1.0);
  const double mean_s = fast_s + slow_share * (slow_s - fast_s);
  HashRandom random(seed_, OTHERS, node);
  const double quiet_s = load.heavy_share > 0.0 ? load.mean_burst_s * (1.0 / load.heavy_share - 1.0) : 0.0;
  bool burst = random.uniform() < load.heavy_share;
  double at_s = 0.0;
  const double end_s = scenario_.duration_s + TAIL_S;
  while (at_s < end_s)
  {
    const bool for_ever = load.heavy_share <= 0.0 || load.heavy_share >= 1.0;
    const double phase_end_s = for_ever ? end_s : at_s + random.exponential(burst ? load.mean_burst_s : quiet_s);
    const double rate_hz = (burst ? load.heavy_load : load.base_load) * server.workers / mean_s;
    while (rate_hz > 0.0)
    {
      at_s += random.exponential(1.0 / rate_hz);
      if (at_s >= std::min(phase_end_s, end_s))
      {
        break;
      }
      OthersTask task;
      task.arrived_ns = toNs(at_s);
      task.kind = random.uniform() < slow_share ? TaskKind::SPEECH : TaskKind::DETECTION;
      task.vehicle = static_cast<int>(random.next() % static_cast<uint64_t>(load.vehicles));
      const auto kind = static_cast<size_t>(task.kind);
      task.service_s = server.service_s[kind] * random.logNormal(server.service_deviation);
      task.remaining_s = load.time_left * scenario_.engine.needs[kind].deadline_s;
      const double kind_share = task.kind == TaskKind::SPEECH ? slow_share : 1.0 - slow_share;
      task.lease_hz = load.leases ? rate_hz * kind_share / load.vehicles : 0.0;
      others_[node].push_back(task);
    }
    at_s = phase_end_s;  // Poisson arrivals have no memory
    burst = !burst;
  }
}

void World::makeOutages(size_t node)
{
  const Scenario::Failures& failures = scenario_.failures;
  if (failures.mean_between_s <= 0.0)
  {
    return;
  }
  HashRandom random(seed_, OUTAGE, node);
  double at_s = random.exponential(failures.mean_between_s);
  while (at_s < scenario_.duration_s + TAIL_S)
  {
    Outage outage;
    outage.begin_ns = toNs(at_s);
    at_s += random.exponential(failures.mean_repair_s);
    outage.end_ns = toNs(at_s);
    outage.silent = random.uniform() < 0.5;
    outages_[node].push_back(outage);
    at_s += random.exponential(failures.mean_between_s);
  }
}

void World::makeShadowing(size_t vehicle, size_t node)
{
  const Scenario::Network& network = scenario_.network;
  const double driven_m = scenario_.speed * (scenario_.duration_s + TAIL_S);
  const auto steps = static_cast<size_t>(driven_m / shadowing_step_m_) + 2;
  const double deviation = network.shadowing_db * std::log(10.0) / 10.0;
  const double kept = std::exp(-1.0 / SHADOWING_STEPS);
  HashRandom random(seed_, SHADOWING, vehicle, node);
  std::vector<float> values;
  values.reserve(steps);
  double value = random.normal();
  for (size_t i = 0; i < steps; ++i)
  {
    values.push_back(static_cast<float>(deviation * value));
    value = kept * value + std::sqrt(1.0 - kept * kept) * random.normal();
  }
  shadowing_.push_back(std::move(values));
}

const Outage* World::outage(size_t node, int64_t now_ns) const
{
  for (const Outage& outage : outages_[node])
  {
    if (now_ns >= outage.begin_ns && now_ns < outage.end_ns)
    {
      return &outage;
    }
  }
  return nullptr;
}

double World::way(size_t vehicle, int64_t now_ns) const
{
  return starts_[vehicle] + scenario_.speed * toS(now_ns);
}

VehicleState World::vehicle(size_t vehicle, int64_t now_ns) const
{
  VehicleState state;
  state.known = true;
  state.position = route_.at(way(vehicle, now_ns));
  state.heading = route_.heading(way(vehicle, now_ns));
  state.speed = scenario_.speed;
  return state;
}

std::vector<Point> World::routeAhead(size_t vehicle, int64_t now_ns) const
{
  return route_.ahead(way(vehicle, now_ns));
}

double World::rate_mbps(size_t vehicle, size_t node, int64_t now_ns) const
{
  const Point position = route_.at(way(vehicle, now_ns));
  const NodeDescription& description = scenario_.nodes[node].description;
  const double distance = std::hypot(position.x - description.position.x, position.y - description.position.y);
  if (distance > description.range_m)
  {
    return 0.0;
  }
  const Scenario::Network& network = scenario_.network;
  const double far =
      std::isfinite(description.range_m) && description.range_m > 0.0 ? distance / description.range_m : 0.0;
  const std::vector<float>& shadowing = shadowing_[vehicle * scenario_.nodes.size() + node];
  const double at = scenario_.speed * toS(now_ns) / shadowing_step_m_;
  const size_t i = std::min(static_cast<size_t>(at), shadowing.size() - 2);
  const double share = std::min(at - static_cast<double>(i), 1.0);
  const double shadow = (1.0 - share) * shadowing[i] + share * shadowing[i + 1];
  return network.rate_near_mbps * std::exp(far * std::log(network.rate_edge_mbps / network.rate_near_mbps) + shadow);
}

double World::latency_s(size_t vehicle, size_t node, uint64_t key, uint64_t direction) const
{
  const Scenario::Network& network = scenario_.network;
  HashRandom random(seed_, LATENCY, vehicle, node, key, direction);
  const double way_s = 0.5 * network.round_trip_s * random.logNormal(network.round_trip_deviation);
  return way_s + (random.uniform() < network.loss ? network.retransmission_s : 0.0);
}

double World::uplink_latency_s(size_t vehicle, size_t node, uint64_t key) const
{
  return latency_s(vehicle, node, key, 0);
}

double World::downlink_latency_s(size_t vehicle, size_t node, uint64_t key) const
{
  return latency_s(vehicle, node, key, 1);
}

double World::service_s(size_t node, const Task& task) const
{
  const Scenario::Node& server = scenario_.nodes[node];
  HashRandom random(seed_, SERVICE, node, task.id);
  const double usual_s = server.service_s[static_cast<size_t>(task.kind)] * random.logNormal(server.service_deviation);
  return random.uniform() < server.slow_share ? server.slow_factor * usual_s : usual_s;
}

double World::local_s(const Task& task) const
{
  const Scenario::Stream* stream = scenario_.stream(task.kind);
  return stream->local_s * HashRandom(seed_, LOCAL, task.id).logNormal(stream->local_deviation);
}

}  // namespace pi_offload::simulation
