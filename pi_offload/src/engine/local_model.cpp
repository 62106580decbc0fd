#include "engine/local_model.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>

namespace pi_offload
{
namespace
{
constexpr double MEAN_GAIN = 0.125;
constexpr double DEVIATION_GAIN = 0.03125;  // a margin of fallbacks must not ripple
/// Deviation after the first sample, as a part of it: the vehicle's times vary little.
constexpr double FIRST_DEVIATION = 0.03;
/// Shorter waits for other kinds tell nothing about shared processors [s].
constexpr double LEAST_TELLING_S = 0.005;
}  // namespace

LocalModel::LocalModel(const std::array<double, TASK_KINDS>& first_s, double highest_ghz) : highest_ghz_(highest_ghz)
{
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    times_[kind].mean_s = first_s[kind];
    times_[kind].deviation_s = FIRST_DEVIATION * first_s[kind];
  }
}

void LocalModel::start(uint64_t task, TaskKind kind, double frequency_ghz, int64_t now_ns)
{
  Run run;
  run.kind = kind;
  run.started_ns = now_ns;
  run.frequency_ghz = frequency_ghz;
  run.expected_s = seconds(kind) * highest_ghz_ / frequency_ghz;
  run.same_s = waiting(index(kind), now_ns);
  run.other_s = waitingOthers(index(kind), now_ns);
  runs_[task] = run;
  Queue& queue = queues_[index(kind)];
  if (queue.count == 0)
  {
    queue.begun_ns = now_ns;
  }
  ++queue.count;
  queue.expected_s += run.expected_s;
}

void LocalModel::done(uint64_t task, double work_s, int64_t now_ns)
{
  const auto found = runs_.find(task);
  if (found == runs_.end())
  {
    return;
  }
  const Run run = found->second;
  runs_.erase(found);
  leave(run, now_ns);
  if (!(work_s >= 0.0) || !std::isfinite(work_s))
  {
    return;
  }
  Time& time = times_[index(run.kind)];
  const double sample = work_s * run.frequency_ghz / highest_ghz_;
  if (!time.measured)
  {
    time = {true, sample, FIRST_DEVIATION * sample};
  }
  else
  {
    time.deviation_s += DEVIATION_GAIN * (std::abs(sample - time.mean_s) - time.deviation_s);
    time.mean_s += MEAN_GAIN * (sample - time.mean_s);
  }
  if (run.other_s >= LEAST_TELLING_S)
  {
    const double waited_s = pi_node::seconds(now_ns - run.started_ns) - work_s;
    shared_ += MEAN_GAIN * (std::clamp((waited_s - run.same_s) / run.other_s, 0.0, 1.0) - shared_);
  }
}

void LocalModel::drop(uint64_t task, int64_t now_ns)
{
  const auto found = runs_.find(task);
  if (found == runs_.end())
  {
    return;
  }
  leave(found->second, now_ns);
  runs_.erase(found);
}

void LocalModel::dropOlder(int64_t started_ns, int64_t now_ns)
{
  for (auto run = runs_.begin(); run != runs_.end();)
  {
    if (run->second.started_ns < started_ns)
    {
      leave(run->second, now_ns);
      run = runs_.erase(run);
    }
    else
    {
      ++run;
    }
  }
}

void LocalModel::leave(const Run& run, int64_t now_ns)
{
  Queue& queue = queues_[index(run.kind)];
  --queue.count;
  queue.expected_s = queue.count == 0 ? 0.0 : std::max(0.0, queue.expected_s - run.expected_s);
  queue.begun_ns = now_ns;
}

double LocalModel::waiting(size_t kind, int64_t now_ns) const
{
  const Queue& queue = queues_[kind];
  if (queue.count == 0)
  {
    return 0.0;
  }
  // The first task runs; it takes its expected time until its end is reported.
  const double first_s = queue.expected_s / static_cast<double>(queue.count);
  const double passed_s = std::max(0.0, pi_node::seconds(now_ns - queue.begun_ns));
  return queue.expected_s - std::min(passed_s, first_s);
}

double LocalModel::waitingOthers(size_t kind, int64_t now_ns) const
{
  double sum = 0.0;
  for (size_t other = 0; other < TASK_KINDS; ++other)
  {
    sum += other == kind ? 0.0 : waiting(other, now_ns);
  }
  return sum;
}

double LocalModel::backlog(TaskKind kind, int64_t now_ns) const
{
  return waiting(index(kind), now_ns) + shared_ * waitingOthers(index(kind), now_ns);
}

}  // namespace pi_offload
