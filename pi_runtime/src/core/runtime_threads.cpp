// RuntimeCore: the threads of the units, and the one that watches them.
#include <pi_node/durations.h>
#include <pthread.h>
#include <sched.h>

#include <algorithm>

#include "core/runtime_core.h"

namespace pi_runtime
{
namespace
{

constexpr std::chrono::milliseconds WATCH_INTERVAL{500};
constexpr int ETC_SAVE_INTERVALS = 60;
/// A task hangs if it takes more than this many times its prediction.
constexpr double HANG_FACTOR = 20.0;
/// Factor on the hang timeout for a codelet's first run on a unit.
constexpr double FIRST_RUN_FACTOR = 6.0;

}  // namespace

void RuntimeCore::workerLoop(Unit& unit)
{
  pthread_setname_np(pthread_self(), ("pi_" + unit.name).substr(0, 15).c_str());
  if (options_.pin_threads && !unit.cores.empty())
  {
    cpu_set_t set;
    CPU_ZERO(&set);
    for (const int core : unit.cores)
    {
      CPU_SET(core, &set);
    }
    sched_setaffinity(0, sizeof set, &set);
  }
  if (options_.thread_priority > 0)
  {
    sched_param parameter{};
    parameter.sched_priority = options_.thread_priority;
    const int code = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter);
    if (code != 0)
    {
      say(LogLevel::WARNING, "unit " + unit.name +
                                 " runs without thread_priority = " + std::to_string(options_.thread_priority) +
                                 ": not permitted (give the program CAP_SYS_NICE or an rtprio limit)");
    }
  }
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
  for (const std::unique_ptr<Unit>& unit : units_)
  {
    if (unit->running.empty() || unit->failed)
    {
      continue;
    }
    TaskState& task = *unit->running.front();
    // The first run of an OpenCL codelet compiles in its kernels' first enqueueing, too.
    const double first = task.measured ? 1.0 : FIRST_RUN_FACTOR;
    const double limit_s =
        std::max(first * std::chrono::duration<double>(options_.hang_timeout).count(), HANG_FACTOR * task.run_s);
    const double elapsed_s = pi_node::seconds(now - std::max(task.started_ns, unit->last_end_ns));
    if (elapsed_s <= limit_s || task.phase != TaskState::Phase::RUNNING)
    {
      continue;
    }
    const std::string reason = "codelet " + task.request.codelet->name + " hangs (" + std::to_string(elapsed_s) +
                               " s, hang_timeout and 20 times its prediction are over)";
    const std::deque<TaskPtr> hanging = unit->running;
    failUnit(*unit, reason, ended);
    for (const TaskPtr& lost : hanging)
    {
      lost->cancelled = true;
      end(*lost, Outcome::UNIT_FAILED, unit->name + ": " + reason, ended);
    }
  }
}

void RuntimeCore::watchLoop()
{
  pthread_setname_np(pthread_self(), "pi_watch");
  Lock lock(mutex_);
  for (int tick = 1; !stopping_; ++tick)
  {
    watch_.wait_for(lock, WATCH_INTERVAL);
    if (stopping_)
    {
      break;
    }
    std::vector<TaskPtr> ended;
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
