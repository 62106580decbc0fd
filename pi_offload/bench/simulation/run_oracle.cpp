// Run: the oracle in place of engines.

#include "simulation/run.h"

#include <algorithm>
#include <cmath>

namespace pi_offload::simulation
{

std::optional<double> Run::foreseeCost(size_t v, size_t node, const Task& task)
{
  const Vehicle& vehicle = vehicles_[v];
  const Radio& radio = scenario_.engine.radio;
  const int64_t deadline_ns = task.created_ns + toNs(task.deadline_s);
  const int64_t begin_ns = std::max(now_ns_, vehicle.radio_free_ns);
  const double up_mbps = world_.rate_mbps(v, node, begin_ns);
  if (up_mbps <= 0.0 || begin_ns >= deadline_ns)
  {
    return std::nullopt;
  }
  const double sending_s = megabits(task.input_bytes) / up_mbps;
  const int64_t sent_ns = begin_ns + toNs(sending_s);
  PendingArrival mine;
  mine.at_ns = sent_ns + toNs(world_.uplink_latency_s(v, node, task.id));
  if (mine.at_ns >= deadline_ns)
  {
    return std::nullopt;
  }
  mine.arrival = arrivalOf(v, node, task, last_ticket_ + 1, mine.at_ns);
  const std::optional<int64_t> done_ns = foreseeEnd(nodes_[node], pending_[node], mine, deadline_ns);
  if (!done_ns)
  {
    return std::nullopt;
  }
  for (const Outage& outage : world_.outages(node))
  {
    if (outage.begin_ns <= *done_ns && outage.end_ns > mine.at_ns)
    {
      return std::nullopt;
    }
  }
  const double down_mbps = world_.rate_mbps(v, node, *done_ns);
  if (down_mbps <= 0.0)
  {
    return std::nullopt;
  }
  const double receiving_s = megabits(scenario_.stream(task.kind)->output_bytes) / down_mbps;
  const int64_t received_ns = *done_ns + toNs(receiving_s + world_.downlink_latency_s(v, node, task.id));
  if (received_ns > deadline_ns)
  {
    return std::nullopt;
  }
  const double waiting_s = toS(received_ns - sent_ns) - receiving_s;
  return radio.transmit_w * sending_s + radio.receive_w * receiving_s + radio.wait_w * waiting_s +
         radio.tail_w * radio.tail_s;
}

void Run::askOracle(size_t v, const Task& task)
{
  Vehicle& vehicle = vehicles_[v];
  const auto kind = static_cast<size_t>(task.kind);
  const Scenario::Stream& stream = *scenario_.stream(task.kind);
  const double local_s = world_.local_s(task);
  const int64_t local_end_ns = std::max(now_ns_, vehicle.processor_free_ns[kind]) + toNs(local_s);
  const bool local_in_time = local_end_ns <= task.created_ns + toNs(task.deadline_s);
  double least_j = local_in_time ? stream.local_j * local_s / stream.local_s : HUGE_VAL;
  int best = -1;
  for (size_t n = 0; n < nodes_.size(); ++n)
  {
    if (down_[n] || world_.rate_mbps(v, n, now_ns_) <= 0.0)
    {
      continue;
    }
    std::vector<EdgeNode::End> ends;
    nodes_[n].advance(now_ns_, &ends);
    handleEnds(n, ends);
    const std::optional<double> cost_j = foreseeCost(v, n, task);
    if (cost_j && *cost_j < least_j)
    {
      least_j = *cost_j;
      best = static_cast<int>(n);
    }
  }
  place(v, best, task);
}

void Run::place(size_t v, int node, const Task& task)
{
  if (node < 0)
  {
    runLocal(v, task, 0.0);
    return;
  }
  int& last = vehicles_[v].last_node[static_cast<size_t>(task.kind)];
  result_.handovers += last >= 0 && last != node ? 1 : 0;
  last = node;
  sendTask(v, static_cast<size_t>(node), 0, task);
}

}  // namespace pi_offload::simulation
