// RuntimeCore: admitted streams.
#include <pi_node/durations.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "core/runtime_core.h"
#include "scheduler/fixed_priority_admission.h"

namespace pi_runtime
{
namespace
{

constexpr size_t KEPT_RESPONSES = 1024;
/// Slices are made shorter down to 1/8 of the usual length to get a stream admitted.
constexpr double SHORTEST_SLICE = 1.0 / 8.0;

/// For which jobs with real-time priority may keep a unit from the ordinary class: callbacks, drivers, the transport.
constexpr double LONGEST_REALTIME_S = 0.02;

double seconds(std::chrono::nanoseconds duration)
{
  return std::chrono::duration<double>(duration).count();
}

struct UnitVerdict
{
  bool feasible;
  double blocking_budget_s;
  double longest_realtime_s;
};

/// By the test that is in force: that of fixed priorities if some loads interrupt others, else EDF without preemption.
UnitVerdict analyse(const std::vector<PeriodicLoad>& loads)
{
  if (std::any_of(loads.begin(), loads.end(), [](const PeriodicLoad& load) { return load.priority > 0; }))
  {
    const FixedPriorityVerdict verdict = analyseFixedPriority(loads);
    return {verdict.feasible, verdict.blocking_budget_s, verdict.longest_realtime_s};
  }
  const EdfVerdict verdict = analyseEdf(loads);
  return {verdict.feasible, verdict.blocking_budget_s, 0.0};
}

}  // namespace

std::vector<PeriodicLoad> RuntimeCore::loadsOn(const Unit& unit) const
{
  std::vector<PeriodicLoad> loads;
  const auto take = [&loads](const Unit& of)
  {
    std::transform(of.streams.begin(), of.streams.end(), std::back_inserter(loads),
                   [](const auto& entry) { return entry.second; });
  };
  take(unit);
  for (const Unit* const lane : unit.lanes)
  {
    take(*lane);
  }
  if (unit.arbiter)
  {
    for (const auto& [pid, other] : unit.arbiter->othersStreams())
    {
      if (other.reserved != 0)
      {
        loads.push_back({other.period_s, other.deadline_s, other.wcet_s, other.chunk_s, other.priority});
      }
    }
  }
  return loads;
}

double RuntimeCore::reservedOn(const Unit& unit) const
{
  double sum = 0.0;
  for (const PeriodicLoad& load : loadsOn(unit))
  {
    sum += load.wcet_s / load.period_s;
  }
  return sum;
}

void RuntimeCore::refreshBudget(Unit& unit)
{
  publishStreams(unit);
  std::vector<PeriodicLoad> loads;
  if (!unit.streams.empty())  // those in lanes are not held up
  {
    loads = loadsOn(unit);
  }
  if (loads == unit.analysed)
  {
    return;
  }
  unit.blocking_budget_s = analyse(loads).blocking_budget_s;
  unit.analysed = std::move(loads);
  if (unit.arbiter)
  {
    unit.arbiter->setBlockingBudget(std::isinf(unit.blocking_budget_s) ? UnitArbiter::NO_BUDGET
                                                                       : pi_node::nanoseconds(unit.blocking_budget_s));
  }
}

std::string RuntimeCore::tryHome(const Unit& unit, const PeriodicLoad& load) const
{
  std::vector<PeriodicLoad> loads = loadsOn(unit);
  loads.push_back(load);
  const double busy = reservedOn(unit) + load.wcet_s / load.period_s;
  if (load.priority == 0 && load.chunk_s > unit.others_budget_s)
  {
    return unit.name + " must not be held longer than " + milliseconds(unit.others_budget_s) +
           " for the streams of other processes";
  }
  if (!analyse(loads).feasible)
  {
    return unit.name + " would be used to " + std::to_string(static_cast<int>(std::lround(busy * 100.0))) +
           " % and could miss deadlines (longest uninterrupted piece of the new one " + milliseconds(load.chunk_s) +
           ")";
  }
  return "";
}

std::string RuntimeCore::tryHomeInLanes(const Unit& unit, const StreamRequest& request, PeriodicLoad* load) const
{
  if (!unit.lanes.empty() && !request.codelet->native.empty() && request.codelet->opencl.empty())
  {
    PeriodicLoad urgent = *load;
    urgent.priority = priorityOf(load->deadline_s);
    const Unit& lane = *unit.lanes[static_cast<size_t>(urgent.priority - LOWEST_PRIORITY)];
    std::vector<PeriodicLoad> loads = loadsOn(unit);
    loads.push_back(urgent);
    const UnitVerdict verdict = analyse(loads);
    if (lane.usable() && verdict.feasible && verdict.longest_realtime_s <= LONGEST_REALTIME_S)
    {
      *load = urgent;
      return "";
    }
  }
  return tryHomeInSlices(unit, request.codelet->sliceable, load);
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
  if (request.period.count() == 0)
  {
    return "its period is not known on " + unit.name;
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
  const double piece_s = request.piece.count() > 0    ? seconds(request.piece)
                         : request.codelet->sliceable ? seconds(options_.slice)
                                                      : load->wcet_s;
  load->chunk_s = std::min(load->wcet_s, piece_s);
  return "";
}

bool RuntimeCore::findHome(StreamId id, Stream& stream, std::string* reason, std::vector<TaskPtr>* ended)
{
  // Units with streams first, so that the others stay free for long batch tasks; then the fastest. Units whose streams
  // interrupt what they do: the one with the least reserved.
  struct Candidate
  {
    Unit* unit;
    PeriodicLoad load;
    std::pair<bool, double> rank;
  };
  std::vector<Candidate> candidates;
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    PeriodicLoad load{};
    const std::string problem = loadOn(*unit, stream.request, &load);
    if (problem.empty())
    {
      candidates.push_back({unit.get(), load,
                            unit->lanes.empty() ? std::make_pair(unit->streams.empty(), load.wcet_s)
                                                : std::make_pair(false, reservedOn(*unit))});
    }
    else
    {
      *reason += (reason->empty() ? "" : "; ") + problem;
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.rank < b.rank; });
  for (auto& [unit, load, rank] : candidates)
  {
    const std::string problem = tryHomeInLanes(*unit, stream.request, &load);
    if (!problem.empty())
    {
      *reason += (reason->empty() ? "" : "; ") + problem;
      continue;
    }
    Unit& home = load.priority == 0 ? *unit : *unit->lanes[static_cast<size_t>(load.priority - LOWEST_PRIORITY)];
    settleHome(id, stream, home, load);
    if (!analyse(loadsOn(*unit)).feasible)
    {
      leaveHome(id, stream);
      *reason += (reason->empty() ? "" : "; ") + unit->name + " was taken by another process just now";
      continue;
    }
    replaceDelaying(*unit, ended);
    warnOfShortWcet(home, stream);
    return true;
  }
  return false;
}

void RuntimeCore::settleHome(StreamId id, Stream& stream, Unit& unit, const PeriodicLoad& load)
{
  stream.unit = &unit;
  stream.load = load;
  unit.streams.emplace_back(id, load);
  if (unit.base != nullptr && !unit.worker.joinable())
  {
    startWorker(unit);
  }
  refreshBudget(unit.own());
}

void RuntimeCore::leaveHome(StreamId id, Stream& stream)
{
  if (Unit* const unit = std::exchange(stream.unit, nullptr))
  {
    unit->streams.erase(std::remove_if(unit->streams.begin(), unit->streams.end(),
                                       [id](const auto& entry) { return entry.first == id; }),
                        unit->streams.end());
    refreshBudget(unit->own());
  }
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
  if (found == streams_.end() || task.calibration || found->second.load.wcet_s <= 0.0)
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
  admission.reason = problemOf(request);
  if (!admission.reason.empty())
  {
    return admission;
  }
  Lock lock(mutex_);
  const StreamId id = next_stream_++;
  Stream& stream = streams_[id];
  stream.request = request;
  if (findHome(id, stream, &admission.reason, &ended) || request.best_effort)
  {
    admission.id = id;
  }
  fillAdmission(stream, &admission);
  if (!admission.admitted())
  {
    streams_.erase(id);
    publishStreams(*units_.front());
  }
  pumpAll(lock, Caller::COMPLETION);
  leave(lock, ended);
  return admission;
}

std::string RuntimeCore::problemOf(const StreamRequest& request)
{
  const bool period = request.period.count() > 0 || (request.best_effort && request.period.count() == 0);
  if (!request.codelet || !period || request.deadline.count() < 0 || request.wcet.count() < 0 ||
      !(request.size > 0.0) || std::isinf(request.size))
  {
    return "stream " + request.name +
           " needs a codelet, a period above 0, a finite size above 0, and no negative times";
  }
  return "";
}

void RuntimeCore::fillAdmission(const Stream& stream, Admission* admission)
{
  if (stream.unit != nullptr)
  {
    admission->unit = stream.unit->name;
    admission->reason.clear();
    return;
  }
  admission->shortest_period = shortestPeriod(stream.request);
  publishStreams(*units_.front());
}

Admission RuntimeCore::amend(StreamId id, const StreamRequest& request)
{
  Admission admission;
  admission.reason = problemOf(request);
  if (!admission.reason.empty())
  {
    return admission;
  }
  std::vector<TaskPtr> ended;
  Lock lock(mutex_);
  const auto found = streams_.find(id);
  if (found == streams_.end())
  {
    admission.reason = "stream " + std::to_string(id) + " is not admitted";
    return admission;
  }
  Stream& stream = found->second;
  admission.id = id;
  Unit* const old_unit = stream.unit;
  const PeriodicLoad old_load = stream.load;
  leaveHome(id, stream);
  stream.request = request;
  if (!findHome(id, stream, &admission.reason, &ended) && old_unit != nullptr)
  {
    admission.shortest_period = shortestPeriod(request);
    admission.reason += "; it keeps " + milliseconds(old_load.wcet_s) + " of every " + milliseconds(old_load.period_s);
    settleHome(id, stream, *old_unit, old_load);
    admission.unit = old_unit->name;
  }
  else
  {
    fillAdmission(stream, &admission);
  }
  pumpAll(lock, Caller::COMPLETION);
  leave(lock, ended);
  return admission;
}

std::chrono::nanoseconds RuntimeCore::shortestPeriod(const StreamRequest& request)
{
  constexpr double LONGEST = 100.0;  ///< times the period that was asked for
  constexpr double PRECISION = 1.02;
  double best_s = std::numeric_limits<double>::infinity();
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    PeriodicLoad load{};
    if (!loadOn(*unit, request, &load).empty())
    {
      continue;
    }
    const auto fits = [&](double factor)
    {
      PeriodicLoad longer = load;
      longer.period_s *= factor;
      longer.deadline_s *= factor;
      return tryHomeInLanes(*unit, request, &longer).empty();
    };
    double too_short = 1.0;
    double enough = LONGEST;
    if (!fits(enough))
    {
      continue;
    }
    while (enough > PRECISION * too_short)
    {
      const double middle = std::sqrt(too_short * enough);
      (fits(middle) ? enough : too_short) = middle;
    }
    best_s = std::min(best_s, enough * load.period_s);
  }
  return std::chrono::nanoseconds(std::isinf(best_s) ? 0 : pi_node::nanoseconds(best_s));
}

void RuntimeCore::retire(StreamId id)
{
  Lock lock(mutex_);
  const auto stream = streams_.find(id);
  if (stream == streams_.end())
  {
    return;
  }
  leaveHome(id, stream->second);
  streams_.erase(stream);
  publishStreams(*units_.front());
}

void RuntimeCore::moveStreams(Unit& from, std::vector<TaskPtr>* ended)
{
  const auto leaving = std::exchange(from.streams, {});
  refreshBudget(from.own());
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
    refreshBudget(*unit);
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
  if (found == streams_.end() || task.result.outcome == Outcome::REFUSED)
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

StreamStatus RuntimeCore::statusOf(StreamId id, const Stream& stream)
{
  StreamStatus status{};
  status.id = id;
  status.pid = getpid();
  status.name = stream.request.name;
  status.unit = stream.unit != nullptr ? stream.unit->name : "";
  status.priority = stream.unit != nullptr ? stream.load.priority : 0;
  // Without capacity: what it asked for.
  const StreamRequest& asked = stream.request;
  status.period_s = stream.unit != nullptr ? stream.load.period_s : seconds(asked.period);
  status.deadline_s = stream.unit != nullptr       ? stream.load.deadline_s
                      : asked.deadline.count() > 0 ? seconds(asked.deadline)
                                                   : seconds(asked.period);
  status.wcet_s = stream.unit != nullptr ? stream.load.wcet_s : seconds(asked.wcet);
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
  return status;
}

std::vector<StreamStatus> RuntimeCore::streams() const
{
  std::vector<StreamStatus> result;
  std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& [id, stream] : streams_)
  {
    result.push_back(statusOf(id, stream));
  }
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    if (!unit->arbiter)
    {
      continue;
    }
    for (const auto& [pid, other] : unit->arbiter->othersStreams())
    {
      StreamStatus status{};
      status.pid = pid;
      status.name = other.name;
      status.unit = other.reserved != 0 ? unit->name : "";
      status.priority = other.priority;
      status.period_s = other.period_s;
      status.deadline_s = other.deadline_s;
      status.wcet_s = other.wcet_s;
      status.jobs = other.jobs;
      status.missed = other.missed;
      status.p50_s = other.p50_s;
      status.p99_s = other.p99_s;
      status.max_s = other.max_s;
      result.push_back(std::move(status));
    }
  }
  return result;
}

void RuntimeCore::publishStreams(const Unit& unit) const
{
  if (!unit.arbiter)
  {
    return;
  }
  std::vector<SharedStream> shared;
  for (const auto& [id, stream] : streams_)
  {
    // Those without capacity are told on the first unit.
    if (stream.unit != nullptr ? &stream.unit->own() != &unit : unit.index != 0)
    {
      continue;
    }
    const StreamStatus status = statusOf(id, stream);
    SharedStream& entry = shared.emplace_back();
    status.name.copy(entry.name, sizeof entry.name - 1);
    entry.period_s = status.period_s;
    entry.deadline_s = status.deadline_s;
    entry.wcet_s = status.wcet_s;
    entry.chunk_s = stream.load.chunk_s;
    entry.priority = status.priority;
    entry.jobs = status.jobs;
    entry.missed = status.missed;
    entry.p50_s = static_cast<float>(status.p50_s);
    entry.p99_s = static_cast<float>(status.p99_s);
    entry.max_s = static_cast<float>(status.max_s);
    entry.reserved = stream.unit != nullptr ? 1 : 0;
  }
  unit.arbiter->setStreams(shared);
}

}  // namespace pi_runtime
