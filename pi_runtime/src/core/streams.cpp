// RuntimeCore: admitted streams.
#include <pi_node/durations.h>
#include <algorithm>
#include <cmath>

#include "core/runtime_core.h"

namespace pi_runtime
{
namespace
{

constexpr size_t KEPT_RESPONSES = 1024;
/// Slices are made shorter down to 1/8 of the usual length to get a stream admitted.
constexpr double SHORTEST_SLICE = 1.0 / 8.0;

double seconds(std::chrono::nanoseconds duration)
{
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

void RuntimeCore::refreshBudget(Unit& unit)
{
  std::vector<PeriodicLoad> loads;
  for (const auto& [id, load] : unit.streams)
  {
    loads.push_back(load);
  }
  unit.blocking_budget_s = analyseEdf(loads).blocking_budget_s;
  if (unit.arbiter)
  {
    unit.arbiter->setBlockingBudget(std::isinf(unit.blocking_budget_s) ? UnitArbiter::NO_BUDGET
                                                                       : pi_node::nanoseconds(unit.blocking_budget_s));
  }
}

std::string RuntimeCore::tryHome(const Unit& unit, const PeriodicLoad& load) const
{
  std::vector<PeriodicLoad> loads;
  double busy = load.wcet_s / load.period_s;
  for (const auto& [id, other] : unit.streams)
  {
    loads.push_back(other);
    busy += other.wcet_s / other.period_s;
  }
  loads.push_back(load);
  if (load.chunk_s > unit.others_budget_s)
  {
    return unit.name + " must not be held longer than " + milliseconds(unit.others_budget_s) +
           " for the streams of other processes";
  }
  if (!analyseEdf(loads).feasible)
  {
    return unit.name + " would be used to " + std::to_string(static_cast<int>(std::lround(busy * 100.0))) +
           " % and could miss deadlines (longest uninterrupted piece of the new one " + milliseconds(load.chunk_s) +
           ")";
  }
  return "";
}

std::string RuntimeCore::tryHomeInSlices(const Unit& unit, bool sliceable, PeriodicLoad* load) const
{
  const double usual_s = load->chunk_s;
  const std::string problem = tryHome(unit, *load);
  if (problem.empty() || !sliceable)
  {
    return problem;
  }
  for (double share = 0.5; share >= SHORTEST_SLICE; share *= 0.5)
  {
    load->chunk_s = usual_s * share;
    if (tryHome(unit, *load).empty())
    {
      return "";
    }
  }
  return problem;
}

std::string RuntimeCore::loadOn(const Unit& unit, const StreamRequest& request, PeriodicLoad* load)
{
  if (!unit.usable())
  {
    return unit.name + " is out: " + unit.whyOut();
  }
  CodeletRecord& record = recordOf(request.codelet);
  double wcet_s = std::numeric_limits<double>::infinity();
  bool supported = false;
  for (const UnitExecutor& entry : unit.executors)
  {
    if (!canRun(entry, record))
    {
      continue;
    }
    supported = true;
    const EtcTable::Estimate estimate = record.row->predict(EtcTable::sizeBucket(request.size), entry.column);
    if (estimate.known)
    {
      wcet_s = std::min(wcet_s, estimate.seconds + 3.0 * estimate.deviation_s);
    }
  }
  if (!supported)
  {
    return unit.name + " cannot run it";
  }
  load->wcet_s = request.wcet.count() > 0 ? seconds(request.wcet) : wcet_s;
  if (std::isinf(load->wcet_s))
  {
    return "nothing is known of its run time on " + unit.name + " (calibrate() it, or give wcet)";
  }
  load->period_s = seconds(request.period);
  load->deadline_s = request.deadline.count() > 0 ? seconds(request.deadline) : load->period_s;
  load->chunk_s = request.codelet->sliceable ? std::min(load->wcet_s, seconds(options_.slice)) : load->wcet_s;
  return "";
}

bool RuntimeCore::findHome(StreamId id, Stream& stream, std::string* reason, std::vector<TaskPtr>* ended)
{
  // Units with streams first, so that the others stay free for long batch tasks; then the fastest.
  std::vector<std::pair<Unit*, PeriodicLoad>> candidates;
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    PeriodicLoad load{};
    const std::string problem = loadOn(*unit, stream.request, &load);
    if (problem.empty())
    {
      candidates.emplace_back(unit.get(), load);
    }
    else
    {
      *reason += (reason->empty() ? "" : "; ") + problem;
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b)
                   {
                     const bool a_used = !a.first->streams.empty();
                     const bool b_used = !b.first->streams.empty();
                     return a_used != b_used ? a_used : a.second.wcet_s < b.second.wcet_s;
                   });
  for (auto& [unit, load] : candidates)
  {
    const std::string problem = tryHomeInSlices(*unit, stream.request.codelet->sliceable, &load);
    if (!problem.empty())
    {
      *reason += (reason->empty() ? "" : "; ") + problem;
      continue;
    }
    stream.unit = unit;
    stream.load = load;
    unit->streams.emplace_back(id, load);
    refreshBudget(*unit);
    replaceDelaying(*unit, ended);
    warnOfShortWcet(*unit, stream);
    return true;
  }
  return false;
}

void RuntimeCore::warnOfShortWcet(const Unit& unit, const Stream& stream)
{
  const EtcTable::Row& row = *recordOf(stream.request.codelet).row;
  double expected_s = std::numeric_limits<double>::infinity();
  for (const UnitExecutor& entry : unit.executors)
  {
    const EtcTable::Estimate estimate = row.predict(EtcTable::sizeBucket(stream.request.size), entry.column);
    if (estimate.measured)
    {
      expected_s = std::min(expected_s, estimate.seconds);
    }
  }
  if (!std::isinf(expected_s) && expected_s > stream.load.wcet_s)
  {
    note("stream " + stream.request.name + " is admitted with wcet = " + milliseconds(stream.load.wcet_s) +
         ", but takes " + milliseconds(expected_s) + " on unit " + unit.name + ": its own deadlines will be missed");
  }
}

void RuntimeCore::beginStreamJob(const TaskState& task)
{
  const auto found = streams_.find(task.request.stream);
  if (found != streams_.end())
  {
    found->second.used_ns = 0;
    found->second.server_deadline_ns = std::max(found->second.server_deadline_ns, task.urgency_ns);
  }
}

void RuntimeCore::chargeStream(TaskState& task, int64_t run_ns)
{
  const auto found = streams_.find(task.request.stream);
  if (found == streams_.end() || task.calibration)
  {
    return;
  }
  Stream& stream = found->second;
  const auto budget_ns = std::max<int64_t>(pi_node::nanoseconds(stream.load.wcet_s), 1);
  const auto period_ns = pi_node::nanoseconds(stream.load.period_s);
  stream.used_ns += run_ns;
  if (stream.used_ns > budget_ns)
  {
    const int64_t periods = (stream.used_ns - 1) / budget_ns;
    stream.used_ns -= periods * budget_ns;
    stream.server_deadline_ns += periods * period_ns;
    postponeQueued(found->first, stream.server_deadline_ns);
  }
  task.urgency_ns = std::max(task.urgency_ns, stream.server_deadline_ns);
}

void RuntimeCore::postponeQueued(StreamId id, int64_t urgency_ns)
{
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    std::vector<TaskState*> jobs;
    for (TaskState* const queued : unit->queue)
    {
      if (queued->request.stream == id && queued->urgency_ns < urgency_ns)
      {
        jobs.push_back(queued);
      }
      else if (options_.queue_order == QueueOrder::EDF && queued->urgency_ns >= urgency_ns)
      {
        break;
      }
    }
    for (TaskState* const job : jobs)
    {
      unit->remove(*job);
      job->urgency_ns = urgency_ns;
      unit->push(*job);
    }
  }
}

Admission RuntimeCore::admit(const StreamRequest& request)
{
  Admission admission;
  std::vector<TaskPtr> ended;
  if (!request.codelet || request.period.count() <= 0 || request.deadline.count() < 0 || request.wcet.count() < 0 ||
      !(request.size > 0.0) || std::isinf(request.size))
  {
    admission.reason =
        "stream " + request.name + " needs a codelet, a period above 0, a finite size above 0, and no negative times";
    return admission;
  }
  Lock lock(mutex_);
  const StreamId id = next_stream_++;
  Stream& stream = streams_[id];
  stream.request = request;
  if (findHome(id, stream, &admission.reason, &ended))
  {
    admission.id = id;
    admission.reason.clear();
    pumpAll(lock, Caller::COMPLETION);
  }
  else
  {
    streams_.erase(id);
  }
  leave(lock, ended);
  return admission;
}

void RuntimeCore::retire(StreamId id)
{
  Lock lock(mutex_);
  const auto stream = streams_.find(id);
  if (stream == streams_.end())
  {
    return;
  }
  if (Unit* const unit = stream->second.unit)
  {
    unit->streams.erase(std::remove_if(unit->streams.begin(), unit->streams.end(),
                                       [id](const auto& entry) { return entry.first == id; }),
                        unit->streams.end());
    refreshBudget(*unit);
  }
  streams_.erase(stream);
}

void RuntimeCore::moveStreams(Unit& from, std::vector<TaskPtr>* ended)
{
  const auto leaving = std::exchange(from.streams, {});
  refreshBudget(from);
  for (const auto& [id, load] : leaving)
  {
    Stream& stream = streams_.at(id);
    stream.unit = nullptr;
    std::string reason;
    note(findHome(id, stream, &reason, ended)
             ? "stream " + stream.request.name + " now has its place on unit " + stream.unit->name
             : "stream " + stream.request.name +
                   " has lost its place: its deadlines are no longer guaranteed on any unit (" + reason + ")");
  }
}

void RuntimeCore::housePlaceless(std::vector<TaskPtr>* ended)
{
  for (auto& [id, stream] : streams_)
  {
    std::string reason;
    if (stream.unit == nullptr && findHome(id, stream, &reason, ended))
    {
      note("stream " + stream.request.name + " has a place again, on unit " + stream.unit->name);
    }
  }
}

void RuntimeCore::refreshOthersBudgets(std::vector<TaskPtr>* ended)
{
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    if (!unit->arbiter)
    {
      continue;
    }
    const int64_t budget_ns = unit->arbiter->blockingBudget();
    const double budget_s =
        budget_ns == UnitArbiter::NO_BUDGET ? std::numeric_limits<double>::infinity() : pi_node::seconds(budget_ns);
    const bool tighter = budget_s < unit->others_budget_s;
    unit->others_budget_s = budget_s;
    if (tighter)
    {
      replaceDelaying(*unit, ended);
    }
  }
}

void RuntimeCore::countStreamJob(const TaskState& task)
{
  const auto found = streams_.find(task.request.stream);
  if (found == streams_.end())
  {
    return;
  }
  Stream& stream = found->second;
  const auto response_s = static_cast<float>(task.result.finished_ns - task.submitted_ns) * 1e-9f;
  if (stream.responses_s.size() < KEPT_RESPONSES)
  {
    stream.responses_s.push_back(response_s);
  }
  else
  {
    stream.responses_s[stream.jobs % KEPT_RESPONSES] = response_s;
  }
  ++stream.jobs;
  stream.missed += task.result.missedDeadline() || task.result.outcome != Outcome::OK ? 1 : 0;
  stream.max_s = std::max(stream.max_s, static_cast<double>(response_s));
}

std::vector<StreamStatus> RuntimeCore::streams() const
{
  std::vector<StreamStatus> result;
  std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& [id, stream] : streams_)
  {
    StreamStatus status{};
    status.id = id;
    status.name = stream.request.name;
    status.unit = stream.unit != nullptr ? stream.unit->name : "";
    status.period_s = stream.load.period_s;
    status.deadline_s = stream.load.deadline_s;
    status.wcet_s = stream.load.wcet_s;
    status.jobs = stream.jobs;
    status.missed = stream.missed;
    status.max_s = stream.max_s;
    if (!stream.responses_s.empty())
    {
      std::vector<float> sorted = stream.responses_s;
      std::sort(sorted.begin(), sorted.end());
      status.p50_s = sorted[sorted.size() / 2];
      status.p99_s = sorted[sorted.size() * 99 / 100];
    }
    result.push_back(std::move(status));
  }
  return result;
}

}  // namespace pi_runtime
