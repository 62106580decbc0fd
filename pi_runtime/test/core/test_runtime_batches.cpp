// Metatasks: how they are spread, stealing, many threads at once.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <thread>

#include "core/fake_executor.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;

ExecutionReport good(const FakeDevice::Start&)
{
  return ExecutionReport();
}

/// Fails the test if two entries of one unit overlap. @return number of entries per task.
std::map<uint64_t, int> checkTrace(const std::vector<TaskTrace>& records)
{
  std::map<uint64_t, int> seen;
  std::map<uint32_t, std::vector<TaskTrace>> units;
  for (const TaskTrace& record : records)
  {
    ++seen[record.task];
    units[record.unit].push_back(record);
  }
  for (auto& [unit, runs] : units)
  {
    std::sort(runs.begin(), runs.end(),
              [](const TaskTrace& a, const TaskTrace& b) { return a.started_ns < b.started_ns; });
    for (size_t i = 0; i < runs.size(); ++i)
    {
      EXPECT_LE(runs[i].started_ns, runs[i].finished_ns);
      if (i > 0)
      {
        EXPECT_GE(runs[i].started_ns, runs[i - 1].finished_ns) << "on unit " << unit;
      }
    }
  }
  return seen;
}

class EveryPolicy : public testing::TestWithParam<InterCorePolicy>
{
};

TEST_P(EveryPolicy, RunsEachTaskOfABatchOnceAndOneAtATimePerUnit)
{
  constexpr size_t TASKS = 300;
  FakeRuntime runtime(3,
                      [](RuntimeOptions& options)
                      {
                        options.native = true;
                        options.trace_capacity = 10 * TASKS;
                        options.inter_core.policy = GetParam();
                      });
  for (size_t unit = 0; unit < 3; ++unit)
  {
    runtime.device(unit).serveAll(good);
  }
  std::vector<std::atomic<int>> calls(TASKS);
  std::vector<TaskRequest> batch;
  for (size_t i = 0; i < TASKS; ++i)
  {
    TaskRequest request = requestOf(fakeCodelet("work" + std::to_string(i % 5), i % 7 == 0));
    request.range = 1 + i % 40;
    request.priority = static_cast<int>(i % 3);
    request.done = [&calls, i](const TaskResult&) { ++calls[i]; };
    if (i % 11 == 0)
    {
      request.deadline = 1s;
    }
    batch.push_back(request);
  }
  const std::vector<TaskHandle> tasks = runtime->submitBatch(batch);
  ASSERT_EQ(TASKS, tasks.size());
  std::set<uint64_t> ids;
  for (const TaskHandle& task : tasks)
  {
    ASSERT_TRUE(task.waitFor(LONG_WAIT));
    EXPECT_TRUE(task.wait().ok()) << task.wait().message;
    ids.insert(task.id());
  }
  const std::map<uint64_t, int> seen = checkTrace(runtime->trace().snapshot());
  EXPECT_EQ(TASKS, seen.size());
  for (const TaskHandle& task : tasks)
  {
    EXPECT_EQ(static_cast<int>(task.wait().slices), seen.at(task.id()));
  }
  EXPECT_EQ(TASKS, ids.size());
  uint64_t ended = 0;
  for (const UnitStatus& unit : runtime->units())
  {
    ended += unit.tasks;
    EXPECT_EQ(0u, unit.queued);
  }
  EXPECT_EQ(TASKS, ended);
  EXPECT_EQ(TASKS, runtime->statistics().ended_ok);
  runtime.stop();
  EXPECT_TRUE(std::all_of(calls.begin(), calls.end(), [](const std::atomic<int>& count) { return count == 1; }));
}

INSTANTIATE_TEST_SUITE_P(RuntimeBatches, EveryPolicy, testing::ValuesIn(allInterCorePolicies()),
                         [](const auto& info) { return toString(info.param); });

TEST(RuntimeBatches, AnEmptyBatchIsNoError)
{
  FakeRuntime runtime(1);
  EXPECT_TRUE(runtime->submitBatch({}).empty());
}

TEST(RuntimeBatches, WrongRequestsInABatchDoNotHarmTheOthers)
{
  FakeRuntime runtime(1);
  runtime.device(0).serveAll(good);
  TaskRequest wrong = requestOf(fakeCodelet("work"));
  wrong.range = 0;
  TaskRequest nowhere = requestOf(fakeCodelet("work"), "gpu1");
  const std::vector<TaskHandle> tasks =
      runtime->submitBatch({wrong, requestOf(fakeCodelet("work")), nowhere, TaskRequest()});
  EXPECT_EQ(Outcome::REFUSED, tasks[0].wait().outcome);
  EXPECT_TRUE(tasks[1].wait().ok());
  EXPECT_EQ(Outcome::REFUSED, tasks[2].wait().outcome);
  EXPECT_EQ(Outcome::REFUSED, tasks[3].wait().outcome);
}

TEST(RuntimeBatches, FollowTheTable)
{
  FakeRuntime runtime(2);
  const CodeletPtr left = fakeCodelet("left");
  const CodeletPtr right = fakeCodelet("right");
  runtime.setTimes(left, {1.0, 30.0});
  runtime.setTimes(right, {30.0, 1.0});
  const std::vector<TaskHandle> tasks =
      runtime->submitBatch({requestOf(left), requestOf(right), requestOf(left), requestOf(right)});
  for (int i = 0; i < 2; ++i)
  {
    EXPECT_EQ("left", runtime.device(0).serve().codelet);
    EXPECT_EQ("right", runtime.device(1).serve().codelet);
  }
  EXPECT_TRUE(tasks[3].wait().ok());
  EXPECT_FALSE(tasks[3].wait().stolen);
}

TEST(RuntimeBatches, AnIdleUnitStealsWhatALyingTableGaveToAnother)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("work");
  runtime.setTimes(codelet, {1e-3, 40e-3});  // but the first unit takes for ever
  std::vector<TaskRequest> batch(10, requestOf(codelet));
  const std::vector<TaskHandle> tasks = runtime->submitBatch(batch);
  runtime.device(0).awaitStart();
  for (int i = 0; i < 9; ++i)
  {
    runtime.device(1).serve();
  }
  runtime.device(0).finish();
  uint64_t stolen = 0;
  for (const TaskHandle& task : tasks)
  {
    ASSERT_TRUE(task.waitFor(LONG_WAIT));
    EXPECT_TRUE(task.wait().ok());
    stolen += task.wait().stolen ? 1 : 0;
  }
  EXPECT_EQ(stolen, runtime->units()[1].stolen);
  EXPECT_GE(stolen, 8u);
}

TEST(RuntimeBatches, PinnedTasksAreNotStolen)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("work");
  runtime.setTimes(codelet, {1.0, 1e-3});
  const std::vector<TaskHandle> tasks =
      runtime->submitBatch({requestOf(codelet, "fake0"), requestOf(codelet, "fake0")});
  runtime->submit(requestOf(codelet, "fake1"));
  runtime.device(1).serve();  // it is idle now, and looks
  runtime.device(0).serve();
  runtime.device(0).serve();
  EXPECT_EQ("fake0", tasks[1].wait().unit);
  EXPECT_EQ(1u, runtime.device(1).started());
}

TEST(RuntimeBatches, ManyThreadsMaySubmitCancelAndAskAtOnce)
{
  constexpr int THREADS = 6;
  constexpr int ROUNDS = 150;
  FakeRuntime runtime(2,
                      [](RuntimeOptions& options)
                      {
                        options.native = true;
                        options.trace_capacity = 100000;
                      });
  runtime.device(0).serveAll(good);
  runtime.device(1).serveAll(good);
  const CodeletPtr codelets[] = {fakeCodelet("a"), fakeCodelet("b", true), fakeCodelet("c")};
  std::atomic<int> done{0};
  std::atomic<int> ended{0};
  const auto work = [&](int thread)
  {
    std::vector<TaskHandle> tasks;
    for (int round = 0; round < ROUNDS; ++round)
    {
      TaskRequest request = requestOf(codelets[(round + thread) % 3]);
      request.range = 1 + static_cast<uint64_t>(round % 5);
      request.done = [&](const TaskResult&) { ++done; };
      std::vector<TaskHandle> now;
      switch ((round + thread) % 4)
      {
        case 0:
          request.deadline = 1ms;
          now = {runtime->submit(request)};
          break;
        case 1:
          now = runtime->submitBatch({request, request, request});
          break;
        case 2:
        {
          GraphRequest graph;
          graph.tasks.assign(3, request);
          graph.edges = {{0, 1, 0.0}, {0, 2, 0.0}};
          now = runtime->submitGraph(graph);
          break;
        }
        default:
          now = {runtime->submit(request)};
          now[0].cancel();
      }
      if (round % 20 == 0)
      {
        runtime->units();
        runtime->statistics();
        runtime->setUnitAvailable("fake0", round % 40 == 0);
        const Admission stream = runtime->admit({"s", codelets[0], 1.0, 10ms, 10ms, 1ms});
        runtime->streams();
        runtime->retire(stream.id);
      }
      tasks.insert(tasks.end(), now.begin(), now.end());
    }
    for (const TaskHandle& task : tasks)
    {
      ASSERT_TRUE(task.waitFor(LONG_WAIT));
      const Outcome outcome = task.wait().outcome;
      EXPECT_TRUE(outcome == Outcome::OK || outcome == Outcome::CANCELLED) << task.wait().message;
      ++ended;
    }
  };
  std::vector<std::thread> threads;
  for (int thread = 0; thread < THREADS; ++thread)
  {
    threads.emplace_back(work, thread);
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  const RuntimeStatistics statistics = runtime->statistics();
  EXPECT_EQ(static_cast<uint64_t>(ended), statistics.submitted);
  EXPECT_EQ(statistics.submitted, statistics.ended_ok + statistics.cancelled);
  checkTrace(runtime->trace().snapshot());
  runtime.stop();
  EXPECT_EQ(ended, done);
}

}  // namespace
}  // namespace pi_runtime
