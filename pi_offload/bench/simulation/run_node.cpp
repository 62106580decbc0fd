// Run: what nodes do.

#include "simulation/run.h"

#include <algorithm>

namespace pi_offload::simulation
{
namespace
{

constexpr double RECONNECT_S = 0.5;

}  // namespace

void Run::onArrival(const Event& event)
{
  std::vector<PendingArrival>& pending = pending_[event.node];
  pending.erase(std::remove_if(pending.begin(), pending.end(),
                               [&](const PendingArrival& other) { return other.arrival.task.ticket == event.id; }),
                pending.end());
  const auto found = requests_.find(event.id);
  if (found == requests_.end() || down_[event.node])
  {
    return;
  }
  std::vector<EdgeNode::End> ends;
  EdgeNode& node = nodes_[event.node];
  node.advance(now_ns_, &ends);
  const Admission::Verdict verdict = node.arrive(found->second.arrival, &ends);
  if (verdict != Admission::Verdict::TAKEN)
  {
    found->second.state = Request::State::REFUSED;
    found->second.output_bytes = SMALL_MESSAGE_BYTES;
    sendReply(event.id);
  }
  handleEnds(event.node, ends);
}

void Run::onProbeArrival(const Event& event)
{
  if (down_[event.node])
  {
    requests_.erase(event.id);
    return;
  }
  std::vector<EdgeNode::End> ends;
  EdgeNode& node = nodes_[event.node];
  node.advance(now_ns_, &ends);
  const Request& request = requests_.at(event.id);
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    node.askLease(vehicles_[event.vehicle].name, static_cast<TaskKind>(kind), request.lease_hz[kind], now_ns_);
  }
  sendReply(event.id);
  handleEnds(event.node, ends);
}

void Run::onNode(size_t node)
{
  if (!down_[node])
  {
    std::vector<EdgeNode::End> ends;
    nodes_[node].advance(now_ns_, &ends);
    handleEnds(node, ends);
  }
}

void Run::handleEnds(size_t node, const std::vector<EdgeNode::End>& ends)
{
  for (const EdgeNode::End& end : ends)
  {
    const auto found = requests_.find(end.ticket);
    if (found == requests_.end())
    {
      continue;
    }
    Request& request = found->second;
    request.state = end.done ? Request::State::DONE : Request::State::EXPIRED;
    request.output_bytes = end.done ? request.output_bytes : SMALL_MESSAGE_BYTES;
    request.queue_s = end.queue_s;
    request.service_s = end.service_s;
    sendReply(end.ticket);
  }
  scheduleNode(node);
}

void Run::scheduleNode(size_t node)
{
  const int64_t next_ns = nodes_[node].nextTime();
  if (next_ns < node_event_ns_[node])
  {
    node_event_ns_[node] = std::max(next_ns, now_ns_);
    push(node_event_ns_[node], Event::Type::NODE, 0, node, 0);
  }
}

void Run::sendReply(uint64_t ticket)
{
  Request& request = requests_.at(ticket);
  const double rate_mbps = world_.rate_mbps(request.vehicle, request.node, now_ns_);
  if (rate_mbps <= 0.0)
  {
    if (request.probe)
    {
      requests_.erase(ticket);
    }
    return;
  }
  request.advertisement = nodes_[request.node].advertisement(vehicles_[request.vehicle].name, now_ns_);
  request.receiving_s = megabits(request.output_bytes) / rate_mbps;
  const uint64_t key = request.probe ? PROBE_KEY | static_cast<uint64_t>(request.sent_ns) : request.task.id;
  const double latency_s = world_.downlink_latency_s(request.vehicle, request.node, key);
  push(now_ns_ + toNs(request.receiving_s + latency_s), Event::Type::REPLY, request.vehicle, request.node, ticket);
}

/// All connections to the node break.
void Run::onNodeDown(size_t node)
{
  const std::string& id = scenario_.nodes[node].description.id;
  for (size_t v = 0; v < vehicles_.size(); ++v)
  {
    Vehicle& vehicle = vehicles_[v];
    if (vehicle.engine != nullptr && vehicle.link_up[node])
    {
      vehicle.link_up[node] = false;
      vehicle.engine->onLinkDown(id, now_ns_);
      wakeEngine(v);
    }
  }
}

void Run::onNodeUp(size_t node)
{
  down_[node] = false;
  nodes_[node].restart(now_ns_);
  for (size_t v = 0; v < vehicles_.size(); ++v)
  {
    if (!vehicles_[v].link_up[node])
    {
      push(now_ns_ + toNs(RECONNECT_S), Event::Type::LINK_UP, v, node, 0);
    }
  }
}

void Run::onLinkUp(size_t v, size_t node)
{
  Vehicle& vehicle = vehicles_[v];
  if (vehicle.engine != nullptr && !down_[node])
  {
    vehicle.link_up[node] = true;
    vehicle.engine->onLinkUp(scenario_.nodes[node].description.id, now_ns_);
    wakeEngine(v);
  }
}

}  // namespace pi_offload::simulation
