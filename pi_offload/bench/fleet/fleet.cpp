#include <pi_node/durations.h>

#include <algorithm>
#include <chrono>
#include <queue>
#include <random>
#include <utility>

#include "fleet.h"
#include "vehicle.h"
#include "wire/socket_tools.h"

namespace pi_offload_bench
{

using namespace pi_offload;

namespace
{

/// Vehicles look at their clocks so often.
constexpr int64_t TICK_NS = 5000000;
/// A camera's pictures come so much earlier or later than its rate says: part of the period, to either side. Without
/// it vehicles would meet in the same order for the whole time.
constexpr double JITTER = 0.05;

void sleepUntil(int64_t time_ns)
{
  std::this_thread::sleep_until(std::chrono::steady_clock::time_point(std::chrono::nanoseconds(time_ns)));
}

template <typename Value>
void append(const std::vector<Value>& from, std::vector<Value>* to)
{
  to->insert(to->end(), from.begin(), from.end());
}

}  // namespace

Fleet::Fleet(const FleetOptions& options, const FleetInputs& inputs) : options_(options), inputs_(inputs)
{
  begin_ns_ = pi_node::monotonicNs() + pi_node::nanoseconds(options.warm_up_s);
  end_ns_ = begin_ns_ + pi_node::nanoseconds(options.measured_s);
  for (size_t i = 0; i < options.vehicles; ++i)
  {
    vehicles_.push_back(std::make_unique<Vehicle>(i, options_, inputs_, begin_ns_, end_ns_));
  }
  driver_ = std::thread([this] { drive(); });
}

Fleet::~Fleet()
{
  stop_ = true;
  if (driver_.joinable())
  {
    driver_.join();
  }
}

void Fleet::waitForBegin() const
{
  sleepUntil(begin_ns_);
}

void Fleet::waitForEnd() const
{
  sleepUntil(end_ns_);
}

/// One thread makes all tasks.
void Fleet::drive()
{
  struct Next
  {
    int64_t due_ns = 0;      ///< with jitter
    int64_t regular_ns = 0;  ///< without
    size_t vehicle = 0;
    TaskKind kind = TaskKind::DETECTION;
    bool operator<(const Next& other) const { return due_ns > other.due_ns; }
  };
  std::mt19937 random(options_.seed);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  std::priority_queue<Next> tasks;
  const int64_t start_ns = pi_node::monotonicNs();
  for (size_t vehicle = 0; vehicle < vehicles_.size(); ++vehicle)
  {
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      if (options_.rate_hz[kind] > 0.0)
      {
        const int64_t first_ns = start_ns + pi_node::nanoseconds(share(random) / options_.rate_hz[kind]);
        tasks.push({first_ns, first_ns, vehicle, static_cast<TaskKind>(kind)});
      }
    }
  }
  int64_t tick_ns = start_ns;
  while (!stop_)
  {
    const bool task_first = !tasks.empty() && tasks.top().due_ns < tick_ns;
    sleepUntil(task_first ? tasks.top().due_ns : tick_ns);
    if (!task_first)
    {
      const int64_t now_ns = pi_node::monotonicNs();
      for (const auto& vehicle : vehicles_)
      {
        vehicle->onTime(now_ns);
      }
      tick_ns = now_ns + TICK_NS;
      continue;
    }
    Next next = tasks.top();
    tasks.pop();
    if (next.regular_ns >= end_ns_)
    {
      continue;  // no more of it: what is under way ends
    }
    vehicles_[next.vehicle]->create(next.kind, pi_node::monotonicNs());
    const double period_s = 1.0 / options_.rate_hz[static_cast<size_t>(next.kind)];
    next.regular_ns += pi_node::nanoseconds(period_s);
    next.due_ns = next.regular_ns + pi_node::nanoseconds(period_s * JITTER * (2.0 * share(random) - 1.0));
    tasks.push(next);
  }
}

std::array<FleetTally, TASK_KINDS> Fleet::finish()
{
  while (std::any_of(vehicles_.begin(), vehicles_.end(), [](const auto& vehicle) { return vehicle->busy(); }))
  {
    sleepUntil(pi_node::monotonicNs() + 10 * TICK_NS);
  }
  stop_ = true;
  driver_.join();
  std::array<FleetTally, TASK_KINDS> sum;
  for (const auto& vehicle : vehicles_)
  {
    const std::array<FleetTally, TASK_KINDS> part = vehicle->tally();
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      const FleetTally& from = part[kind];
      FleetTally& to = sum[kind];
      to.tasks += from.tasks;
      to.in_time += from.in_time;
      to.refused += from.refused;
      to.given_back += from.given_back;
      to.kept += from.kept;
      to.late += from.late;
      to.failed += from.failed;
      to.missed += from.missed;
      append(from.answer_s, &to.answer_s);
      append(from.refusal_s, &to.refusal_s);
      append(from.given_back_s, &to.given_back_s);
      append(from.served, &to.served);
      append(from.longest_pause_s, &to.longest_pause_s);
    }
  }
  return sum;
}

}  // namespace pi_offload_bench
