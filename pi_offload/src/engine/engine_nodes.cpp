#include "engine/engine_impl.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>

namespace pi_offload
{
namespace
{
constexpr double INFINITE = std::numeric_limits<double>::infinity();
constexpr double PROBE_LOST_S = 1.0;
/// Knowledge of a queue fades with this time constant [s].
constexpr double QUEUE_MEMORY_S = 0.2;
/// After this time without own tasks the vehicle uses the advertised service time [s].
constexpr double SERVICE_MEMORY_S = 10.0;
/// Least deviation of a service time, as a part of it.
constexpr double LEAST_SERVICE_DEVIATION = 0.05;
/// Residences along the route are computed again after this change of speed [m/s] or time [s].
constexpr double STEADY_M_S = 0.1;
constexpr double RENEW_S = 0.1;
/// Burst that a lease covers: at least LEAST_BURST tasks, else those of BURST_S.
constexpr double LEAST_BURST = 2.0;
constexpr double BURST_S = 0.5;
/// A lease is larger than the rate of tasks because they do not come evenly.
constexpr double LEASE_MARGIN = 1.2;
/// Tasks have stopped after this many intervals without one.
constexpr double STOPPED_INTERVALS = 5.0;
constexpr double LONGEST_BACKLOG_S = 1.0;
/// Weight of an answer in the share of refused tasks, and time constant of forgetting it [s].
constexpr double REFUSED_GAIN = 1.0 / 16.0;
constexpr double REFUSED_MEMORY_S = 1.0;

bool usable(const VehicleState& vehicle)
{
  return vehicle.known && std::isfinite(vehicle.position.x) && std::isfinite(vehicle.position.y) &&
         std::isfinite(vehicle.heading) && std::isfinite(vehicle.speed) && vehicle.speed >= 0.0;
}
}  // namespace

void OffloadEngine::Impl::setNode(const NodeDescription& description)
{
  description.validate();
  NodeState* node = find(description.id);
  if (node == nullptr)
  {
    auto added = std::make_unique<NodeState>(options.estimates, times);
    node = added.get();
    node->key = ++last_key;
    node->index = nodes.size();
    nodes.push_back(std::move(added));
    nodes_by_id[description.id] = node;
    nodes_by_key[node->key] = node;
    input.nodes.emplace_back();
    input.nodes.back().id = description.id;
    due.reserve(nodes.size());
  }
  else if (node->description.address != description.address)
  {
    node->estimates = NodeEstimates(options.estimates);
    node->suspended = false;
    node->failures = 0;
    node->of_kind = {NodeState::OfKind(&times[0]), NodeState::OfKind(&times[1])};
  }
  node->description = description;
  node->placed = false;
  node->probe_soon = true;
  measure(*node);
}

bool OffloadEngine::Impl::removeNode(const std::string& id)
{
  NodeState* node = find(id);
  if (node == nullptr)
  {
    return false;
  }
  const uint64_t key = node->key;
  fallBackAll(key, "the node was removed", false, true);
  node = find(key);
  if (node == nullptr)
  {
    return true;
  }
  const size_t index = node->index;
  nodes_by_id.erase(node->description.id);
  nodes_by_key.erase(key);
  nodes.erase(nodes.begin() + static_cast<std::ptrdiff_t>(index));
  input.nodes.erase(input.nodes.begin() + static_cast<std::ptrdiff_t>(index));
  for (size_t i = index; i < nodes.size(); ++i)
  {
    nodes[i]->index = i;
  }
  return true;
}

NodeState* OffloadEngine::Impl::find(const std::string& id) const
{
  const auto found = nodes_by_id.find(id);
  return found == nodes_by_id.end() ? nullptr : found->second;
}

NodeState* OffloadEngine::Impl::find(uint64_t key) const
{
  const auto found = nodes_by_key.find(key);
  return found == nodes_by_key.end() ? nullptr : found->second;
}

void OffloadEngine::Impl::setVehicle(const VehicleState& state)
{
  const bool known = usable(state);
  bool moved = route.empty() || known != vehicle.known || !(std::abs(state.speed - vehicle.speed) <= STEADY_M_S);
  vehicle = state;
  vehicle.known = known;
  if (known && !route.empty())
  {
    moved = route.setPosition(vehicle.position) || moved;
  }
  for (const std::unique_ptr<NodeState>& node : nodes)
  {
    node->old = true;
    node->moved = node->moved || moved;
    measure(*node);
  }
}

void OffloadEngine::Impl::setRoute(const std::vector<Point>& points)
{
  route.setRoute(points);
  if (vehicle.known)
  {
    route.setPosition(vehicle.position);
  }
  for (const std::unique_ptr<NodeState>& node : nodes)
  {
    node->old = true;
    node->moved = true;
  }
}

void OffloadEngine::Impl::measure(NodeState& node)
{
  const NodeDescription& description = node.description;
  const bool everywhere = std::isinf(description.range_m);
  if (vehicle.known)
  {
    const double x = vehicle.position.x - description.position.x;
    const double y = vehicle.position.y - description.position.y;
    node.distance_m = std::sqrt(x * x + y * y);
  }
  else
  {
    node.distance_m = everywhere ? 0.0 : INFINITE;
  }
  const bool in_range = everywhere || node.distance_m <= description.range_m;
  if (in_range && vehicle.known)
  {
    node.estimates.setPlace(vehicle.position);
  }
  if (in_range && !node.in_range)
  {
    node.placed = false;
    node.probe_soon = true;
  }
  if (!in_range && node.in_range && vehicle.known)
  {
    node.estimates.forgetNetwork();
  }
  node.in_range = in_range;
}

/// @param whole_route  to the end of the route, not only to RouteTracker's horizon.
Residence OffloadEngine::Impl::residenceIn(const NodeDescription& node, bool whole_route) const
{
  if (std::isinf(node.range_m))
  {
    return {INFINITE, 0.0, INFINITE};
  }
  if (!vehicle.known)
  {
    return {0.0, INFINITE, 0.0};
  }
  if (route.empty())
  {
    return straightResidence(vehicle.position, vehicle.heading, vehicle.speed, node.position, node.range_m);
  }
  return whole_route ? route.wholeResidence(node.position, node.range_m, vehicle.speed)
                     : route.residence(node.position, node.range_m, vehicle.speed);
}

void OffloadEngine::Impl::place(NodeState& node)
{
  node.placed = true;
  node.old = false;
  node.moved = false;
  node.placed_ns = now;
  node.residence = residenceIn(node.description, false);
}

void OffloadEngine::Impl::placeNodes(size_t renewals)
{
  for (const std::unique_ptr<NodeState>& node : nodes)
  {
    if (node->in_range && !node->placed)
    {
      place(*node);
    }
  }
  for (size_t looked_at = 0; looked_at < nodes.size() && renewals > 0; ++looked_at)
  {
    next_renewal = next_renewal + 1 < nodes.size() ? next_renewal + 1 : 0;
    NodeState& node = *nodes[next_renewal];
    if (node.in_range && node.old && (node.moved || pi_node::seconds(now - node.placed_ns) >= RENEW_S))
    {
      place(node);
      --renewals;
    }
  }
}

double OffloadEngine::Impl::residence(const NodeState& node) const
{
  return node.in_range ? std::max(0.0, node.residence.now_s - pi_node::seconds(now - node.placed_ns)) : 0.0;
}

bool OffloadEngine::Impl::connected(const NodeState& node, TaskKind kind) const
{
  const auto k = static_cast<size_t>(kind);
  return node.link_up && node.trusted && !node.suspended && now >= node.of_kind[k].refused_until_ns &&
         node.estimates.advertisementAge(now) <= options.advertisement_valid_s &&
         !node.estimates.advertisement().draining && node.estimates.advertisement().of_kind[k].served;
}

Estimate OffloadEngine::Impl::service(const NodeState& node, TaskKind kind) const
{
  const auto k = static_cast<size_t>(kind);
  const RecentMedian& own = node.estimates.service(kind);
  const NodeAdvertisement::OfKind& said = node.estimates.advertisement().of_kind[k];
  const int64_t served_ns = node.of_kind[k].served_ns;
  const bool recent = own.known() && served_ns != LONG_AGO_NS && pi_node::seconds(now - served_ns) <= SERVICE_MEMORY_S;
  Estimate estimate;
  if (own.known() && (recent || !(said.service_s > 0.0)))
  {
    estimate = {own.mean(), own.deviation()};
  }
  else
  {
    estimate = {said.service_s, said.service_deviation_s};
  }
  estimate.deviation = std::max(estimate.deviation, LEAST_SERVICE_DEVIATION * estimate.mean);
  return estimate;
}

double OffloadEngine::Impl::uplinkTime(const NodeState& node, TaskKind kind) const
{
  return node.estimates.network(options.needs[static_cast<size_t>(kind)].input_mbit, 0.0, now).mean_s;
}

QueueForecast OffloadEngine::Impl::queue(const NodeState& node, TaskKind kind, double ahead_s) const
{
  const auto k = static_cast<size_t>(kind);
  QueueForecast forecast;
  const double age = node.estimates.advertisementAge(now);
  // Until the task arrives, the queue moves towards its usual length.
  const NodeState::OfKind& of_kind = node.of_kind[k];
  const double kept = std::isfinite(age) ? std::exp(-(age + ahead_s) / QUEUE_MEMORY_S) : 0.0;
  forecast.advertised_s = node.estimates.advertisement().of_kind[k].queue_s;
  forecast.estimate.mean = kept * forecast.advertised_s + (1.0 - kept) * of_kind.said_queue_s.mean();
  forecast.estimate.deviation =
      std::max(of_kind.queue_error_s, std::sqrt(1.0 - kept * kept) * of_kind.said_queue_s.deviation());
  if (!node.own.empty() && std::isfinite(age))
  {
    // The node does not know tasks sent later than one round trip before its answer came.
    const int64_t unknown_ns = now - toNs(age + node.estimates.roundTrip().mean());
    for (const NodeState::Own& own : node.own)
    {
      forecast.own_s += own.sent_ns > unknown_ns ? service(node, own.kind).mean : 0.0;
    }
    forecast.estimate.mean += node.own_share * forecast.own_s;
    forecast.estimate.deviation += 0.5 * node.own_share * forecast.own_s;
  }
  return forecast;
}

double OffloadEngine::Impl::tokens(const NodeState& node, TaskKind kind) const
{
  const auto k = static_cast<size_t>(kind);
  const double rate = node.estimates.advertisement().of_kind[k].lease_rate_hz;
  const double since_s = pi_node::seconds(now - node.of_kind[k].tokens_ns);
  return std::min(std::max(LEAST_BURST, BURST_S * rate), node.of_kind[k].tokens + rate * since_s);
}

/// Expected time until the messages under way are sent; they go one after the other.
double OffloadEngine::Impl::uplinkBacklog() const
{
  return std::clamp(between(now, uplink_until_ns), 0.0, LONGEST_BACKLOG_S);
}

/// Fades while nothing is sent; otherwise a node that refused is never tried again.
double OffloadEngine::Impl::refusedShare(const NodeState::OfKind& of_kind) const
{
  return of_kind.answered_ns == LONG_AGO_NS
             ? 0.0
             : of_kind.refused_share * std::exp(-between(of_kind.answered_ns, now) / REFUSED_MEMORY_S);
}

void OffloadEngine::Impl::countRefused(NodeState::OfKind& of_kind, bool refused) const
{
  const double share = refusedShare(of_kind);
  of_kind.refused_share = share + REFUSED_GAIN * ((refused ? 1.0 : 0.0) - share);
  of_kind.answered_ns = now;
}

void OffloadEngine::Impl::fillView(NodeState& node, TaskKind kind, double input_mbit, double output_mbit,
                                   NodeView& view) const
{
  view.connected = connected(node, kind);
  view.distance_m = node.distance_m;
  view.range_m = node.description.range_m;
  view.residence_s = residence(node);
  view.capacity_gcycles = node.estimates.hasAdvertisement() ? node.estimates.advertisement().capacity_gcycles
                                                            : node.description.capacity_gcycles;
  view.frequency_ghz = node.description.frequency_ghz;
  view.uplink_mbps = node.estimates.rate(now);
  view.downlink_mbps = view.uplink_mbps;
  const NetworkTime network = node.estimates.network(input_mbit, output_mbit, now);
  view.network_s = {network.mean_s + uplinkBacklog(), network.deviation_s};
  view.network_age_s = node.estimates.rateAge(now);
  view.service_s = service(node, kind);
  view.queue_s = queue(node, kind, uplinkTime(node, kind)).estimate;
  view.refused_share = refusedShare(node.of_kind[static_cast<size_t>(kind)]);
  const NodeState::OfKind& of_kind = node.of_kind[static_cast<size_t>(kind)];
  view.times = &of_kind.times;
  view.lost = now < of_kind.rests_until_ns;
}

void OffloadEngine::Impl::heard(NodeState& node, const NodeAdvertisement& advertisement)
{
  node.heard_ns = now;
  node.link_up = true;
  node.estimates.setAdvertisement(advertisement, now);
  for (size_t k = 0; k < TASK_KINDS; ++k)
  {
    MeanDeviation& said_queue_s = node.of_kind[k].said_queue_s;
    const double queue_s = node.estimates.advertisement().of_kind[k].queue_s;
    if (!said_queue_s.known())
    {
      said_queue_s.add(0.0);  // avoids the deviation of half of the first sample
    }
    said_queue_s.add(queue_s);
  }
  const NodeAdvertisement& said = node.estimates.advertisement();
  NodeDescription& description = node.description;
  if (said.has_position && said.range_m > 0.0 &&
      (said.position.x != description.position.x || said.position.y != description.position.y ||
       said.range_m != description.range_m))
  {
    description.position = said.position;
    description.range_m = said.range_m;
    node.placed = false;
    measure(node);
  }
}

int64_t OffloadEngine::Impl::probeDue(const NodeState& node) const
{
  if (node.probe != 0)
  {
    return node.probed_ns + toNs(PROBE_LOST_S);
  }
  if (node.probe_soon)
  {
    return now;
  }
  const bool near = node.in_range && node.link_up;
  return std::max(node.probed_ns, node.heard_ns) + toNs(near ? options.probe_period_s : options.probe_period_far_s);
}

void OffloadEngine::Impl::sendProbes()
{
  due.clear();
  for (const std::unique_ptr<NodeState>& node : nodes)
  {
    if (probeDue(*node) > now)
    {
      continue;
    }
    node->probe = 0;  // lost, if there was one
    if (probeDue(*node) <= now)
    {
      due.push_back(node->key);
    }
  }
  // Actions may change the nodes.
  for (size_t i = 0; i < due.size(); ++i)
  {
    const uint64_t key = due[i];
    NodeState* node = find(key);
    if (node == nullptr || node->probe != 0)
    {
      continue;
    }
    const uint64_t request = ++last_request;
    const std::string id = node->description.id;
    node->probe = request;
    node->probed_ns = now;
    node->probe_soon = false;
    bool sent = false;
    call([&] { sent = actions.probe(id, request); });
    node = find(key);
    if (!sent && node != nullptr && node->probe == request)
    {
      node->probe = 0;
    }
  }
}

void OffloadEngine::Impl::onProbeReply(const std::string& id, uint64_t request, double round_trip_s,
                                       const NodeAdvertisement& advertisement)
{
  NodeState* node = find(id);
  if (node == nullptr || request == 0 || request > last_request)
  {
    return;
  }
  heard(*node, advertisement);
  if (node->probe == request)
  {
    node->probe = 0;
    node->suspended = false;
    node->failures = 0;
    node->estimates.addRoundTrip(round_trip_s, now);
  }
}

OffloadEngine::NodeStatus OffloadEngine::Impl::status(const NodeState& node) const
{
  NodeStatus status;
  status.description = node.description;
  status.distance_m = node.distance_m;
  status.in_range = node.in_range;
  status.trusted = node.trusted;
  status.round_trip_s = node.estimates.roundTrip().mean();
  status.uplink_mbps = node.estimates.rate(now);
  for (size_t k = 0; k < TASK_KINDS; ++k)
  {
    const auto kind = static_cast<TaskKind>(k);
    status.connected = status.connected || connected(node, kind);
    status.service_s[k] = service(node, kind).mean;
    status.queue_s[k] = queue(node, kind, 0.0).estimate.mean;
  }
  status.residence = residenceIn(node.description, true);
  status.sent = node.sent;
  status.answered = node.answered;
  status.late = node.late;
  status.refused = node.refused;
  status.lost = node.lost;
  return status;
}

/// The node in range with the shortest expected time of a task; null: none.
const NodeState* OffloadEngine::Impl::quickestNode(TaskKind kind) const
{
  const TaskNeeds& needs = options.needs[static_cast<size_t>(kind)];
  const NodeState* quickest = nullptr;
  double least_s = INFINITE;
  for (const std::unique_ptr<NodeState>& node : nodes)
  {
    if (!node->in_range || !connected(*node, kind))
    {
      continue;
    }
    const double time_s = node->estimates.network(needs.input_mbit, needs.output_mbit, now).mean_s +
                          service(*node, kind).mean + queue(*node, kind, uplinkTime(*node, kind)).estimate.mean;
    if (time_s < least_s)
    {
      least_s = time_s;
      quickest = node.get();
    }
  }
  return quickest;
}

double OffloadEngine::Impl::leaseRate(const std::string& id, TaskKind kind) const
{
  const NodeState* node = find(id);
  const Last& tasks_of_kind = last[static_cast<size_t>(kind)];
  if (node == nullptr || !enabled || !tasks_of_kind.interval_s.known() || !node->in_range || !connected(*node, kind))
  {
    return 0.0;
  }
  const double interval_s = tasks_of_kind.interval_s.mean();
  if (!(interval_s > 0.0) || pi_node::seconds(now - tasks_of_kind.submitted_ns) > STOPPED_INTERVALS * interval_s)
  {
    return 0.0;
  }
  const NodeState* wanted = find(tasks_of_kind.node);
  if (wanted == nullptr || !wanted->in_range || !connected(*wanted, kind))
  {
    const NodeState* quickest = quickestNode(kind);
    wanted = quickest != nullptr ? quickest : wanted;
  }
  return wanted == node ? LEASE_MARGIN / interval_s : 0.0;
}

}  // namespace pi_offload
