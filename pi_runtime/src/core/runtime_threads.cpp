// RuntimeCore: the threads of the units, and the one that watches them.
#include <pi_node/durations.h>
#include <pi_node/scheduling.h>
#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <cstring>

#include "core/runtime_core.h"
#include "scheduler/fixed_priority_admission.h"

namespace pi_runtime
{
namespace
{

constexpr std::chrono::milliseconds WATCH_INTERVAL{500};
constexpr int ETC_SAVE_INTERVALS = 60;
constexpr std::chrono::milliseconds RUNAWAY_INTERVAL{100};
/// A job with real-time priority runs away if it uses more than this many times its admitted worst case.
constexpr double RUNAWAY_FACTOR = 5.0;
constexpr double LEAST_RUNAWAY_S = 0.05;
/// A task hangs if it takes more than this many times its prediction.
constexpr double HANG_FACTOR = 20.0;
/// Factor on the hang timeout for a codelet's first run on a unit.
constexpr double FIRST_RUN_FACTOR = 6.0;

}  // namespace

int64_t threadCpuNs(pthread_t thread)
{
  clockid_t clock;
  timespec time{};
  if (pthread_getcpuclockid(thread, &clock) == 0)
  {
    clock_gettime(clock, &time);
  }
  return int64_t{1000000000} * time.tv_sec + time.tv_nsec;
}

void RuntimeCore::makeLanes()
{
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    all_.push_back(unit.get());
  }
  if (!options_.preemption || options_.queue_order == QueueOrder::FIFO)
  {
    not_real_time_ = "are switched off (preemption)";
  }
  else if (!mayBeRealTime(ABOVE_LANES, &not_real_time_))
  {
    not_real_time_ = "are refused (" + not_real_time_ + ", see pi_edge doctor)";
  }
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    if (!not_real_time_.empty())
    {
      unit->scheduling = "nothing is interrupted: real-time priorities " + not_real_time_;
      continue;
    }
    const bool native = std::strcmp(unit->executors.front().executor->name(), "native") == 0;
    if (unit->type != UnitType::CPU || unit->cores.empty() || !native || unit->tuning.slowdown > 1.0)
    {
      continue;
    }
    for (int priority = LOWEST_PRIORITY; priority <= HIGHEST_PRIORITY; ++priority)
    {
      lanes_.push_back(makeLane(unit.get(), priority));
      unit->lanes.push_back(lanes_.back().get());
      all_.push_back(lanes_.back().get());
    }
    unit->scheduling = "SCHED_FIFO " + std::to_string(LOWEST_PRIORITY) + " to " + std::to_string(HIGHEST_PRIORITY) +
                       " for short jobs of streams, which interrupt others";
  }
}

void RuntimeCore::raiseThread() const
{
  if (!lanes_.empty())
  {
    setRealTimePriority(pthread_self(), ABOVE_LANES);
  }
}

void RuntimeCore::startWorker(Unit& unit)
{
  unit.worker_left = false;
  unit.worker = std::thread(&RuntimeCore::workerLoop, this, std::ref(unit));
}

void RuntimeCore::setUpWorker(Unit& unit)
{
  const std::string level = unit.base != nullptr ? "_rt" + std::to_string(unit.priority) : "";
  pthread_setname_np(pthread_self(), ("pi_" + unit.name + level).substr(0, 15).c_str());
  // The response times of lanes hold for the cores of one unit.
  if ((options_.pin_threads || unit.base != nullptr) && !unit.cores.empty())
  {
    cpu_set_t set;
    CPU_ZERO(&set);
    for (const int core : unit.cores)
    {
      CPU_SET(core, &set);
    }
    sched_setaffinity(0, sizeof set, &set);
  }
  if (unit.base != nullptr)
  {
    setRealTimePriority(pthread_self(), unit.priority);
    return;
  }
  if (unit.type == UnitType::CPU)
  {
    const std::string preferred = pi_node::preferThread();
    Lock lock(mutex_);
    unit.scheduling += (unit.scheduling.empty() ? "" : "; ") + preferred;
  }
}

void RuntimeCore::workerLoop(Unit& unit)
{
  setUpWorker(unit);
  Lock lock(mutex_);
  while (!stopping_)
  {
    unit.look_again_ns = 0;
    pump(lock, unit, Caller::WORKER);
    if (stopping_)
    {
      break;
    }
    if (unit.look_again_ns != 0)
    {
      unit.wake.wait_for(lock, std::chrono::nanoseconds(unit.look_again_ns - pi_node::monotonicNs()));
    }
    else
    {
      unit.wake.wait(lock);
    }
  }
  unit.worker_left = true;
  idle_.notify_all();
}

void RuntimeCore::checkHanging(int64_t now, std::vector<TaskPtr>* ended)
{
  for (Unit* const unit : all_)
  {
    checkHanging(*unit, now, ended);
  }
}

void RuntimeCore::checkHanging(Unit& unit, int64_t now, std::vector<TaskPtr>* ended)
{
  if (unit.running.empty() || unit.failed)
  {
    return;
  }
  TaskState& task = *unit.running.front();
  // The first run of an OpenCL codelet compiles in its kernels' first enqueueing, too.
  const double first = task.measured ? 1.0 : FIRST_RUN_FACTOR;
  const double limit_s =
      std::max(first * std::chrono::duration<double>(options_.hang_timeout).count(), HANG_FACTOR * task.run_s);
  const double elapsed_s = pi_node::seconds(now - std::max(task.started_ns, unit.last_end_ns));
  if (elapsed_s <= limit_s || task.phase != TaskState::Phase::RUNNING)
  {
    return;
  }
  const std::string reason = "codelet " + task.request.codelet->name + " hangs (" + std::to_string(elapsed_s) +
                             " s, hang_timeout and 20 times its prediction are over)";
  const std::deque<TaskPtr> hanging = unit.running;
  failUnit(unit, reason, ended);
  for (const TaskPtr& lost : hanging)
  {
    lost->cancelled = true;
    end(*lost, Outcome::UNIT_FAILED, unit.name + ": " + reason, ended);
  }
}

void RuntimeCore::checkRunaways()
{
  for (const std::unique_ptr<Unit>& lane : lanes_)
  {
    if (lane->running.empty() || lane->demoted)
    {
      continue;
    }
    const TaskState& task = *lane->running.front();
    const auto stream = streams_.find(task.request.stream);
    const double wcet_s = stream == streams_.end() ? 0.0 : stream->second.load.wcet_s;
    const double used_s =
        pi_node::seconds(task.run_ns + threadCpuNs(lane->worker.native_handle()) - lane->cpu_begin_ns);
    if (used_s > std::max(RUNAWAY_FACTOR * wcet_s, LEAST_RUNAWAY_S) &&
        setRealTimePriority(lane->worker.native_handle(), 0) == 0)
    {
      lane->demoted = true;
      note("a job of stream " + task.request.codelet->name + " has used " + milliseconds(used_s) + " of unit " +
           lane->name + ", admitted are " + milliseconds(wcet_s) + ": it goes on without real-time priority");
    }
  }
}

void RuntimeCore::watchLoop()
{
  pthread_setname_np(pthread_self(), "pi_watch");
  raiseThread();
  Lock lock(mutex_);
  auto next_tick = std::chrono::steady_clock::now() + WATCH_INTERVAL;
  for (int tick = 1; !stopping_;)
  {
    const bool lanes_used = std::any_of(lanes_.begin(), lanes_.end(),
                                        [](const std::unique_ptr<Unit>& lane) { return !lane->streams.empty(); });
    watch_.wait_for(lock, lanes_used ? RUNAWAY_INTERVAL : WATCH_INTERVAL);
    if (stopping_)
    {
      break;
    }
    std::vector<TaskPtr> ended;
    checkRunaways();
    if (std::chrono::steady_clock::now() < next_tick)
    {
      leave(lock, ended);
      lock.lock();
      continue;
    }
    next_tick += WATCH_INTERVAL;
    ++tick;
    checkHanging(pi_node::monotonicNs(), &ended);
    refreshOthersBudgets(&ended);
    if (tick % ETC_SAVE_INTERVALS == 0)
    {
      saveEtc(lock);
    }
    if (!ended.empty())
    {
      pumpAll(lock, Caller::COMPLETION);
    }
    leave(lock, ended);
    lock.lock();
  }
}

}  // namespace pi_runtime
