// Short jobs of streams interrupt longer work on their unit, within a process and across processes.
#include <gtest/gtest.h>
#include <pi_runtime/stage.h>
#include <sched.h>

#include <atomic>
#include <ctime>

#include "core/fake_executor.h"
#include "units/forked_users.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;

/// A job that runs until it is told, or has used so much of the processor that it must have been let run.
constexpr double GIVES_UP_S = 1.0;

double cpuSeconds()
{
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

int schedulingPolicy()
{
  return sched_getscheduler(0) & ~SCHED_RESET_ON_FORK;
}

struct Ends
{
  std::atomic<int> ended{0};
  std::atomic<int> short_place{0};  ///< 1: it was the first that ended
  std::atomic<int> long_place{0};
};

class Preemption : public UnitTest
{
protected:
  RuntimeOptions oneUnit(bool preemption)
  {
    RuntimeOptions options = FakeRuntime::fakeOptions();
    options.native = true;
    options.cpu_units = {1};
    options.pin_threads = true;  // all of it on one core
    options.arbitration = true;
    options.arbitration_folder = folder_;
    options.preemption = preemption;
    options.log = [this](LogLevel, const std::string& text)
    {
      std::lock_guard<std::mutex> lock(log_mutex_);
      log_ += text + "\n";
    };
    return options;
  }
  bool permitted()
  {
    const Runtime runtime(oneUnit(true));
    return runtime.units()[0].preemptive;
  }
  std::string log()
  {
    std::lock_guard<std::mutex> lock(log_mutex_);
    return log_;
  }

  static CodeletPtr codeletOf(const std::string& name, std::function<void()> work)
  {
    Codelet codelet;
    codelet.name = name;
    codelet.native = {{[work = std::move(work)](const NativeCall&) { work(); }}};
    return makeCodelet(std::move(codelet));
  }
  /// Runs until the short job has ended.
  static CodeletPtr longCodelet(Ends* ends, std::function<void()> begun)
  {
    return codeletOf("long",
                     [ends, begun]
                     {
                       begun();
                       const double begin_s = cpuSeconds();
                       while (ends->short_place == 0 && cpuSeconds() - begin_s < GIVES_UP_S)
                       {
                       }
                       ends->long_place = ++ends->ended;
                     });
  }
  /// Submits a job of a stream of 3 ms every 33 ms, and waits for its end.
  static void runShort(Runtime* runtime, Ends* ends)
  {
    StreamRequest stream;
    stream.name = "short";
    stream.codelet = codeletOf("short", [ends] { ends->short_place = ++ends->ended; });
    stream.period = 33ms;
    stream.wcet = 3ms;
    TaskRequest job = requestOf(stream.codelet);
    const Admission admission = runtime->admit(stream);
    job.stream = admission.id;
    ASSERT_NE(NO_STREAM, job.stream) << admission.reason;
    EXPECT_TRUE(runtime->submit(job).wait().ok());
  }

  std::mutex log_mutex_;
  std::string log_;
};

#define SKIP_WITHOUT_PERMISSION()                                                                         \
  if (!permitted())                                                                                       \
  {                                                                                                       \
    GTEST_SKIP() << "the kernel grants this user no real-time priorities (pi_edge doctor tells the way)"; \
  }

TEST_F(Preemption, AShortJobEndsBeforeTheLongOneThatRuns)
{
  SKIP_WITHOUT_PERMISSION();
  Runtime runtime(oneUnit(true));
  Ends ends;
  Event begun;
  const TaskHandle batch = runtime.submit(requestOf(longCodelet(&ends, [&begun] { begun.set(); })));
  ASSERT_TRUE(begun.wait());
  runShort(&runtime, &ends);
  batch.wait();
  EXPECT_EQ(1, ends.short_place);
  EXPECT_EQ(2, ends.long_place);
}

TEST_F(Preemption, WithoutItTheShortJobWaits)
{
  Runtime runtime(oneUnit(false));
  Ends ends;
  Event begun;
  const TaskHandle batch = runtime.submit(requestOf(longCodelet(&ends, [&begun] { begun.set(); })));
  ASSERT_TRUE(begun.wait());
  runShort(&runtime, &ends);
  batch.wait();
  EXPECT_EQ(1, ends.long_place);
  EXPECT_EQ(2, ends.short_place);
}

TEST_F(Preemption, AShortJobEndsBeforeTheLongOneOfAnotherProcess)
{
  for (const bool preemption : {true, false})
  {
    if (preemption && !permitted())
    {
      continue;
    }
    Shared<Ends> ends;
    Child other(
        [&](Child& test)
        {
          Runtime runtime(oneUnit(preemption));
          runtime.submit(requestOf(longCodelet(ends.operator->(), [&test] { test.say('b'); }))).wait();
          test.say('e');
        });
    ASSERT_EQ('b', other.hear());
    Runtime runtime(oneUnit(preemption));
    runShort(&runtime, ends.operator->());
    EXPECT_EQ('e', other.hear());
    EXPECT_EQ(0, other.reap());
    EXPECT_EQ(preemption ? 1 : 2, ends->short_place);
    EXPECT_EQ(preemption ? 2 : 1, ends->long_place);
  }
}

TEST_F(Preemption, TheAdmissionKnowsWhichIsInForce)
{
  const auto admit =
      [](Runtime& runtime, const char* name, std::chrono::nanoseconds period, std::chrono::nanoseconds wcet)
  {
    StreamRequest stream;
    stream.name = name;
    stream.codelet = fakeCodelet(name);
    stream.period = period;
    stream.wcet = wcet;
    return runtime.admit(stream).reason;
  };
  {
    Runtime runtime(oneUnit(false));
    EXPECT_FALSE(runtime.units()[0].preemptive);
    EXPECT_NE(std::string::npos, runtime.units()[0].scheduling.find("nothing is interrupted")) << "says so";
    EXPECT_EQ("", admit(runtime, "front_end", 33ms, 5ms));
    EXPECT_NE("", admit(runtime, "network", 200ms, 60ms));
  }
  SKIP_WITHOUT_PERMISSION();
  Runtime runtime(oneUnit(true));
  EXPECT_EQ(0u, runtime.units()[0].scheduling.find("SCHED_FIFO 10 to 15")) << runtime.units()[0].scheduling;
  EXPECT_EQ("", admit(runtime, "front_end", 33ms, 5ms));
  EXPECT_EQ("", admit(runtime, "network", 200ms, 60ms));
  EXPECT_EQ("", admit(runtime, "imu", 5ms, 100us));
  EXPECT_NE("", admit(runtime, "overload", 100ms, 60ms));
  std::string priorities;
  for (const StreamStatus& stream : runtime.streams())
  {
    priorities += stream.name + " " + std::to_string(stream.priority) + " " + stream.unit + ", ";
  }
  EXPECT_EQ("front_end 12 cpu0, network 0 cpu0, imu 15 cpu0, ", priorities);
}

TEST_F(Preemption, LeavesTimeForTheOrdinaryClass)
{
  SKIP_WITHOUT_PERMISSION();
  const auto runtime = std::make_shared<Runtime>(oneUnit(true));
  const Stage first(runtime, {"first", 100ms, 40ms, 12ms});
  const Stage second(runtime, {"second", 100ms, 40ms, 12ms});
  EXPECT_EQ(12, first.status().stream.priority);
  EXPECT_EQ(0, second.status().stream.priority) << "both together would keep callbacks waiting for 24 ms";
  EXPECT_EQ("cpu0", second.status().stream.unit);
}

TEST_F(Preemption, JobsHaveTheirPriorityAndRunawaysLoseIt)
{
  SKIP_WITHOUT_PERMISSION();
  const auto runtime = std::make_shared<Runtime>(oneUnit(true));
  Stage stage(runtime, {"stage", 33ms, 0ms, 1ms});
  int policy = -1;
  int priority = -1;
  const auto look = [&]
  {
    sched_param parameter{};
    sched_getparam(0, &parameter);
    policy = schedulingPolicy();
    priority = parameter.sched_priority;
  };
  stage.run(look);
  EXPECT_EQ(SCHED_FIFO, policy);
  EXPECT_EQ(12, priority);
  stage.run(
      []
      {
        const double begin_s = cpuSeconds();
        while (schedulingPolicy() != SCHED_OTHER && cpuSeconds() - begin_s < GIVES_UP_S)
        {
        }
        EXPECT_LT(cpuSeconds() - begin_s, GIVES_UP_S) << "nothing stops a runaway job";
      });
  EXPECT_NE(std::string::npos, log().find("goes on without real-time priority")) << log();
  stage.run(look);
  EXPECT_EQ(SCHED_FIFO, policy) << "the next job has its priority again, or another unit";
}

TEST_F(Preemption, AStageMovesOutOfTheLaneWhenItGrowsTooLong)
{
  SKIP_WITHOUT_PERMISSION();
  const auto runtime = std::make_shared<Runtime>(oneUnit(true));
  StreamRequest stream;
  stream.name = "stage";
  stream.codelet = fakeCodelet("stage");
  stream.period = 100ms;
  stream.wcet = 5ms;
  const StreamId id = runtime->admit(stream).id;
  EXPECT_EQ(10, runtime->streams()[0].priority);
  stream.wcet = 50ms;
  EXPECT_EQ("", runtime->amend(id, stream).reason);
  EXPECT_EQ(0, runtime->streams()[0].priority);
  stream.wcet = 5ms;
  EXPECT_EQ("", runtime->amend(id, stream).reason);
  EXPECT_EQ(10, runtime->streams()[0].priority);
}

TEST_F(Preemption, AUnitThatIsTakenOutTakesItsLanesAlong)
{
  SKIP_WITHOUT_PERMISSION();
  const auto runtime = std::make_shared<Runtime>(oneUnit(true));
  Stage stage(runtime, {"stage", 33ms, 0ms, 1ms});
  ASSERT_EQ("cpu0", stage.status().stream.unit);
  runtime->setUnitAvailable("cpu0", false);
  EXPECT_EQ("", stage.status().stream.unit);
  int runs = 0;
  stage.run([&runs] { ++runs; });
  EXPECT_EQ(1, runs);
  runtime->setUnitAvailable("cpu0", true);
  EXPECT_EQ("cpu0", stage.status().stream.unit);
}

}  // namespace
}  // namespace pi_runtime
