#include <pi_runtime/stage.h>

#include <pi_node/durations.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <utility>

#include "core/runtime_core.h"

namespace pi_runtime
{
namespace
{

constexpr std::chrono::milliseconds FIRST_DEADLINE{100};  ///< until a period is known
constexpr uint64_t MEASURED_RUNS = 8;                     ///< before a stage reserves by what it measured
constexpr uint64_t RUNS_BETWEEN_TRIES = 64;               ///< of a stage that was refused
constexpr size_t PERIODS = 15;                            ///< whose median is the period
constexpr double PERIOD_TOLERANCE = 0.15;
/// Reserved above the longest run: the next one may be longer.
constexpr double WCET_MARGIN = 1.2;

/// A run yields at most so often.
constexpr int64_t YIELD_INTERVAL_NS = 500000;

/// The run that this thread does.
struct RunHere
{
  int64_t looked_ns = 0;  ///< when it yielded, or began
  double looked_cpu_s = 0.0;
  double piece_s = 0.0;   ///< longest between two of these
  double others_s = 0.0;  ///< of jobs done within it
};
thread_local RunHere* run_here = nullptr;

double threadCpuSeconds()
{
  return pi_node::seconds(threadCpuNs(pthread_self()));
}

void checkStage(const StageOptions& options)
{
  const bool word = !options.name.empty() &&
                    std::all_of(options.name.begin(), options.name.end(),
                                [](unsigned char letter) { return std::isgraph(letter) != 0 && letter != ','; });
  if (!word || options.period.count() < 0 || options.deadline.count() < 0 || options.wcet.count() < 0)
  {
    throw std::invalid_argument("Stage \"" + options.name +
                                "\": needs a name of one word without commas, and times of "
                                "at least 0");
  }
}

}  // namespace

using StageWork = std::function<void()>;

/// The run in hand. Belongs to the codelet too, whose function the runtime may call late.
class StageRun
{
public:
  struct End
  {
    bool begun = false;
    double cpu_s = 0.0;
    double piece_s = 0.0;
    std::exception_ptr error;
  };

  uint64_t begin(const StageWork* work)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    work_ = work;
    end_ = End();
    return ++number_;
  }
  /// On a unit's thread.
  void serve(uint64_t number)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (number == number_ && !end_.begun)
    {
      work();
    }
  }
  /// It does not begin any more on a unit's thread. @return false if it has begun.
  bool takeBack()
  {
    const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock() || end_.begun)
    {
      return false;
    }
    ++number_;
    return true;
  }
  /// Waits for a function that the runtime has given up; does the work here if it has not begun.
  End finish(bool* here)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    *here = !end_.begun;
    if (*here)
    {
      work();
    }
    work_ = nullptr;
    return end_;
  }

private:
  void work()
  {
    end_.begun = true;
    RunHere here;
    here.looked_ns = pi_node::monotonicNs();
    here.looked_cpu_s = threadCpuSeconds();
    const double begin_s = here.looked_cpu_s;
    RunHere* const outer = std::exchange(run_here, &here);
    try
    {
      (*work_)();
    }
    catch (...)
    {
      end_.error = std::current_exception();
    }
    run_here = outer;
    const double end_s = threadCpuSeconds();
    end_.piece_s = std::max(here.piece_s, end_s - here.looked_cpu_s);
    end_.cpu_s = end_s - begin_s - here.others_s;
  }

  std::mutex mutex_;  ///< held while the work is done
  const StageWork* work_ = nullptr;
  uint64_t number_ = 0;
  End end_;
};

std::string StageStatus::text() const
{
  if (!runtime)
  {
    return "not used: plain calls";
  }
  if (stream.unit.empty())
  {
    return "nothing reserved: " + problem;
  }
  return milliseconds(stream.wcet_s) + " of every " + milliseconds(stream.period_s) + " reserved on " + stream.unit +
         (stream.priority > 0 ? ", real-time priority " + std::to_string(stream.priority) : "") +
         (problem.empty() ? "" : "; " + problem);
}

struct Stage::Implementation
{
  Implementation(std::shared_ptr<Runtime> runtime_in, const StageOptions& options)
    : runtime(std::move(runtime_in)), run(std::make_shared<StageRun>())
  {
    Codelet codelet;
    codelet.name = options.name;
    NativeImplementation native;
    native.function = [run = run](const NativeCall& call) { run->serve(call.value<uint64_t>(0)); };
    codelet.native = {std::move(native)};
    request.name = options.name;
    request.codelet = makeCodelet(std::move(codelet));
    request.period = options.period;
    request.deadline = options.deadline;
    request.wcet = options.wcet;
    request.best_effort = true;
    period_given = options.period.count() > 0;
    take(runtime->admit(request));
  }
  ~Implementation() { runtime->retire(stream); }

  void work(const StageWork& work)
  {
    notePeriod(pi_node::monotonicNs());
    if (!settled && !isKnown())
    {
      // Without reserved capacity, a unit would let it wait behind everything; the caller may be more urgent than that.
      bool here = false;
      run->begin(&work);
      end(run->finish(&here), false, std::string());
      return;
    }
    TaskRequest task;
    task.codelet = request.codelet;
    task.arguments = {Argument::value(run->begin(&work))};
    task.stream = stream;
    const std::chrono::nanoseconds known = request.deadline.count() > 0 ? request.deadline : request.period;
    const std::chrono::nanoseconds patience = known.count() > 0 ? known : FIRST_DEADLINE;
    task.deadline = patience;
    const TaskHandle handle = runtime->submit(std::move(task));
    if (!handle.waitFor(patience) && run->takeBack())
    {
      handle.cancel();
    }
    else
    {
      handle.wait();
    }
    bool here = false;
    const StageRun::End ended = run->finish(&here);
    end(ended, here, here ? std::string() : handle.wait().unit);
  }

  bool isKnown() const { return request.wcet.count() > 0 && request.period.count() > 0; }

  void end(const StageRun::End& end, bool late, const std::string& unit)
  {
    account(end, late, unit);
    if (end.error)
    {
      std::rethrow_exception(end.error);
    }
  }

  /// The median of the last times between two runs, unless a period was given.
  void notePeriod(int64_t now_ns)
  {
    const int64_t before_ns = std::exchange(last_ns, now_ns);
    if (period_given || before_ns == 0)
    {
      return;
    }
    periods[period_count++ % PERIODS] = now_ns - before_ns;
    if (period_count % PERIODS == 0 || (period_count < PERIODS && period_count >= MEASURED_RUNS))
    {
      std::array<int64_t, PERIODS> sorted = periods;
      const auto end = sorted.begin() + static_cast<long>(std::min(period_count, PERIODS));
      const auto middle = sorted.begin() + (end - sorted.begin()) / 2;
      std::nth_element(sorted.begin(), middle, end);
      period_ns = *middle;
    }
  }

  /// @param late  the calling thread did it, as no unit had begun it. @param unit  that did it; empty: none
  void account(const StageRun::End& end, bool late, const std::string& unit)
  {
    {
      std::lock_guard<std::mutex> lock(mutex);
      shown.cpu_s += end.cpu_s;
      shown.piece_s = std::max(shown.piece_s, end.piece_s);
      shown.plain += late ? 1 : 0;
      shown.ran_on = unit.empty() ? shown.ran_on : unit;
    }
    if (++runs == 1)
    {
      return;  // fills caches, may compile
    }
    worst_s = std::max(worst_s, end.cpu_s);
    longest_piece_s = std::max(longest_piece_s, end.piece_s);
    const bool longer = worst_s > std::chrono::duration<double>(request.wcet).count() ||
                        longest_piece_s > std::chrono::duration<double>(request.piece).count();
    const auto change = static_cast<double>(period_ns - request.period.count());
    const bool period_changed = !period_given && period_ns > 0 &&
                                std::abs(change) > PERIOD_TOLERANCE * static_cast<double>(request.period.count());
    const bool known = runs >= MEASURED_RUNS && (period_given || period_ns > 0);
    const bool due = settled ? longer || period_changed : runs >= next_try;
    if (!known || !due)
    {
      return;
    }
    if (longer)
    {
      request.wcet = std::max(request.wcet, std::chrono::nanoseconds(pi_node::nanoseconds(WCET_MARGIN * worst_s)));
      request.piece = std::chrono::nanoseconds(pi_node::nanoseconds(WCET_MARGIN * longest_piece_s));
    }
    if (period_changed)
    {
      request.period = std::chrono::nanoseconds(period_ns);
    }
    take(runtime->amend(stream, request));
  }

  void take(const Admission& admission)
  {
    stream = admission.id;
    settled = admission.reason.empty();
    const bool known = isKnown();
    next_try = known ? runs + RUNS_BETWEEN_TRIES : MEASURED_RUNS;
    std::string problem;
    if (!admission.reason.empty())
    {
      problem = known ? admission.reason : "its times are measured first";
      if (admission.shortest_period.count() > 0)
      {
        problem += "; every " + milliseconds(std::chrono::duration<double>(admission.shortest_period).count()) +
                   " would fit, instead of " + milliseconds(std::chrono::duration<double>(request.period).count());
      }
    }
    std::lock_guard<std::mutex> lock(mutex);
    shown.problem = std::move(problem);
  }

  StageStatus status() const
  {
    StageStatus status;
    {
      std::lock_guard<std::mutex> lock(mutex);
      status = shown;
    }
    status.runtime = true;
    for (StreamStatus& own : runtime->streams())
    {
      if (own.id == stream)
      {
        status.stream = std::move(own);
      }
    }
    return status;
  }

  const std::shared_ptr<Runtime> runtime;
  const std::shared_ptr<StageRun> run;
  StreamRequest request;
  bool period_given = false;
  StreamId stream = NO_STREAM;  ///< does not change
  bool settled = false;         ///< what it needs is reserved
  uint64_t runs = 0;
  uint64_t next_try = 0;
  double worst_s = 0.0;
  double longest_piece_s = 0.0;
  int64_t last_ns = 0;
  std::array<int64_t, PERIODS> periods{};
  size_t period_count = 0;
  int64_t period_ns = 0;

  mutable std::mutex mutex;
  StageStatus shown;  ///< without the stream
};

Stage::Stage(std::shared_ptr<Runtime> runtime, const StageOptions& options)
  : implementation_(
        (checkStage(options), runtime ? std::make_unique<Implementation>(std::move(runtime), options) : nullptr))
{
}

Stage::~Stage() = default;

void Stage::run(const std::function<void()>& work)
{
  if (implementation_ && run_here == nullptr)
  {
    implementation_->work(work);
  }
  else
  {
    work();
  }
}

void Stage::yield()
{
  RunHere* const here = run_here;
  if (here == nullptr || pi_node::monotonicNs() - here->looked_ns < YIELD_INTERVAL_NS)
  {
    return;
  }
  const double before_s = threadCpuSeconds();
  here->piece_s = std::max(here->piece_s, before_s - here->looked_cpu_s);
  run_here = nullptr;  // a stage within a job that is done now is no part of this run
  RuntimeCore::yieldHere();
  run_here = here;
  here->looked_cpu_s = threadCpuSeconds();
  here->others_s += here->looked_cpu_s - before_s;
  here->looked_ns = pi_node::monotonicNs();
}

double Stage::cpuSeconds() const
{
  if (!implementation_)
  {
    return 0.0;
  }
  std::lock_guard<std::mutex> lock(implementation_->mutex);
  return implementation_->shown.cpu_s;
}

StageStatus Stage::status() const
{
  return implementation_ ? implementation_->status() : StageStatus();
}

}  // namespace pi_runtime
