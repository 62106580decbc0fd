// Run: the informed policy in place of engines. It knows what is now (rates, queues, failures of nodes) and all
// statistics, but not what comes: it weighs each choice over sampled futures.

#include <algorithm>
#include <cmath>

#include "simulation/hash_random.h"
#include "simulation/run.h"

namespace pi_offload::simulation
{
namespace
{

constexpr int FUTURES = 12;
constexpr double COMING_S = 1.0;       ///< of others' tasks in a sampled future
constexpr double REMEMBERED_S = 1.0;   ///< they are those of a recent time that began at most so long ago
constexpr double MARGIN_SIGMAS = 3.5;  ///< of the vehicle's time, at a fallback
constexpr double FALLBACK_MISS = 0.0005;
constexpr double RARE = 0.02;        ///< late answers that the sampled futures do not show
constexpr uint64_t INFORMED = 1000;  ///< purpose of random numbers

}  // namespace

/// Answer times of the task at the node in sampled futures [s since its creation]; infinite: refused or dropped.
std::vector<double> Run::sampledAnswers(size_t v, size_t node, const Task& task, int64_t sent_ns)
{
  std::vector<double> answers(FUTURES, HUGE_VAL);
  const Scenario::Network& network = scenario_.network;
  const Scenario::Node& server = scenario_.nodes[node];
  const auto kind = static_cast<size_t>(task.kind);
  const double receiving_s = megabits(scenario_.stream(task.kind)->output_bytes) / world_.rate_mbps(v, node, now_ns_);
  for (int i = 0; i < FUTURES; ++i)
  {
    HashRandom random(world_.seed(), INFORMED, v, node, task.id, i);
    const auto one_way_s = [&]
    {
      const double way_s = 0.5 * network.round_trip_s * random.logNormal(network.round_trip_deviation);
      return way_s + (random.uniform() < network.loss ? network.retransmission_s : 0.0);
    };
    PendingArrival mine;
    mine.at_ns = sent_ns + toNs(one_way_s());
    mine.arrival = arrivalOf(v, node, task, last_ticket_ + 1, mine.at_ns);
    mine.arrival.service_s = server.service_s[kind] * random.logNormal(server.service_deviation) *
                             (random.uniform() < server.slow_share ? server.slow_factor : 1.0);
    const int64_t shift_ns = toNs(COMING_S + REMEMBERED_S * random.uniform());
    std::vector<OthersTask> coming;
    const std::vector<OthersTask>& others = world_.others(node);
    const auto before = [](const OthersTask& other, int64_t at_ns) { return other.arrived_ns < at_ns; };
    for (auto other = std::lower_bound(others.begin(), others.end(), now_ns_ - shift_ns, before);
         other != others.end() && other->arrived_ns < now_ns_ - shift_ns + toNs(COMING_S); ++other)
    {
      coming.push_back(*other);
      coming.back().arrived_ns += shift_ns;
    }
    const int64_t limit_ns = task.created_ns + toNs(task.deadline_s);
    if (const auto done_ns = foreseeEnd(nodes_[node].withOthers(&coming), pending_[node], mine, limit_ns))
    {
      answers[static_cast<size_t>(i)] = toS(*done_ns - task.created_ns) + receiving_s + one_way_s();
    }
  }
  return answers;
}

void Run::askInformed(size_t v, const Task& task, int refused)
{
  Vehicle& vehicle = vehicles_[v];
  const auto kind = static_cast<size_t>(task.kind);
  const Scenario::Stream& stream = *scenario_.stream(task.kind);
  const Radio& radio = scenario_.engine.radio;
  const double miss_j = scenario_.engine.policy.miss_cost_j;
  const double free_s = std::max(0.0, toS(vehicle.processor_free_ns[kind] - task.created_ns));
  const double need_s = stream.local_s * std::exp(MARGIN_SIGMAS * stream.local_deviation);
  const double begin_s = std::max(toS(now_ns_ - task.created_ns), free_s);
  const bool local_in_time = begin_s + need_s <= task.deadline_s;
  double least_j = stream.local_j + (local_in_time ? 0.0 : miss_j);
  int best = -1;
  double best_fallback_s = 0.0;
  for (size_t n = 0; n < nodes_.size(); ++n)
  {
    const int64_t radio_ns = std::max(now_ns_, vehicle.radio_free_ns);
    const double rate_mbps = world_.rate_mbps(v, n, radio_ns);
    if (static_cast<int>(n) == refused || down_[n] || !(rate_mbps > 0.0))
    {
      continue;
    }
    const double sending_s = megabits(task.input_bytes) / rate_mbps;
    const int64_t sent_ns = radio_ns + toNs(sending_s);
    std::vector<EdgeNode::End> ends;
    nodes_[n].advance(now_ns_, &ends);
    handleEnds(n, ends);
    if (sent_ns >= task.created_ns + toNs(task.deadline_s))
    {
      continue;
    }
    const std::vector<double> answers = sampledAnswers(v, n, task, sent_ns);
    const double sent_s = toS(sent_ns - task.created_ns);
    const double fallback_s = task.deadline_s - need_s;
    for (const double at_s : {fallback_s, task.deadline_s})
    {
      const bool in_time = at_s < task.deadline_s && at_s >= free_s && now_ns_ < task.created_ns + toNs(at_s);
      if (at_s < task.deadline_s && !in_time)
      {
        continue;
      }
      double cost_j = 0.0;
      for (const double answer_s : answers)
      {
        const double ended_s = std::min(answer_s, at_s + stream.local_s);
        cost_j += radio.transmit_w * sending_s + radio.wait_w * std::max(0.0, ended_s - sent_s);
        cost_j += answer_s > at_s ? stream.local_j : 0.0;
        cost_j += answer_s > task.deadline_s ? miss_j * (in_time ? FALLBACK_MISS : 1.0) : 0.0;
      }
      cost_j /= static_cast<double>(FUTURES);
      // So few futures do not show what is rare.
      cost_j += in_time ? 0.0 : miss_j * RARE;
      if (cost_j < least_j)
      {
        least_j = cost_j;
        best = static_cast<int>(n);
        best_fallback_s = at_s;
      }
    }
  }
  place(v, best, task);
  if (best >= 0)
  {
    push(task.created_ns + toNs(best_fallback_s), Event::Type::FALLBACK, v, 0, task.id);
  }
}

void Run::onFallback(size_t v, uint64_t id)
{
  Vehicle& vehicle = vehicles_[v];
  const auto open = vehicle.open.find(id);
  if (open != vehicle.open.end() && !open->second.local)
  {
    open->second.local = true;
    runLocal(v, *open->second.task, 0.0);
  }
}

}  // namespace pi_offload::simulation
