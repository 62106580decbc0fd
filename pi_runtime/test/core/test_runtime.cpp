// Life of tasks: requests, results, batches, callbacks, cancellation, the end of the runtime.
#include <pi_runtime/runtime.h>

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <thread>

#include "core/fake_executor.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;

RuntimeOptions nativeOptions()
{
  RuntimeOptions options = FakeRuntime::fakeOptions();
  options.native = true;
  return options;
}

CodeletPtr nativeCodelet(const std::string& name, NativeFunction function)
{
  Codelet codelet;
  codelet.name = name;
  codelet.native = {{std::move(function)}};
  return makeCodelet(std::move(codelet));
}

TEST(RuntimeTest, RunsANativeFunctionOnItsArguments)
{
  Runtime runtime(nativeOptions());
  const CodeletPtr add = nativeCodelet("add",
                                       [](const NativeCall& call)
                                       {
                                         for (uint64_t i = call.begin(); i < call.end(); ++i)
                                         {
                                           call.buffer<int>(1)[i] = call.buffer<const int>(0)[i] + call.value<int>(2);
                                         }
                                       });
  const std::vector<int> in = {1, 2, 3};
  const BufferPtr out = Buffer::allocate(3 * sizeof(int));
  TaskRequest request = requestOf(add);
  request.range = 3;
  request.arguments = {Argument::in(Buffer::wrap(in.data(), 3 * sizeof(int))), Argument::out(out), Argument::value(10)};
  const TaskHandle task = runtime.submit(request);
  const TaskResult& result = task.wait();
  ASSERT_TRUE(result.ok()) << result.message;
  EXPECT_EQ("native", result.executor);
  EXPECT_EQ(13, out->hostAs<int>(Access::READ)[2]);
  EXPECT_LE(result.submitted_ns, result.started_ns);
  EXPECT_LE(result.started_ns, result.finished_ns);
  EXPECT_EQ(0, result.deadline_ns);
  EXPECT_EQ(1u, result.slices);
}

TEST(RuntimeTest, LeavesItsTraceInTheFolderOfTheEnvironment)
{
  const pi_node::test_support::TemporaryFolder folder;
  ::setenv("PI_RUNTIME_TRACE", folder.path().c_str(), 1);
  {
    Runtime runtime(nativeOptions());
    EXPECT_TRUE(runtime.submit(requestOf(nativeCodelet("traced", [](const NativeCall&) {}))).wait().ok());
  }
  ::unsetenv("PI_RUNTIME_TRACE");
  std::ifstream file(folder.path() + "/" + program_invocation_short_name + "_" + std::to_string(getpid()) + ".json");
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  EXPECT_NE(std::string::npos, text.find("\"codelet\":\"traced\"")) << text;
}

TEST(RuntimeTest, SaysThatItsTraceCannotBeWritten)
{
  ::setenv("PI_RUNTIME_TRACE", "/nowhere", 1);
  RuntimeOptions options = nativeOptions();
  std::string said;
  options.log = [&said](LogLevel, const std::string& text) { said = text; };
  {
    Runtime runtime(options);
    EXPECT_EQ("PI_RUNTIME_TRACE = /nowhere is no folder: make it first", said);
  }
  ::unsetenv("PI_RUNTIME_TRACE");
  EXPECT_EQ(0u, said.find("PI_RUNTIME_TRACE: trace /nowhere/")) << said;
  EXPECT_NE(std::string::npos, said.find("cannot be written: No such file or directory")) << said;
}

TEST(RuntimeTest, AThrowingFunctionFailsItsTaskWithTheText)
{
  Runtime runtime(nativeOptions());
  const TaskHandle bad = runtime.submit(
      requestOf(nativeCodelet("bad", [](const NativeCall&) { throw std::runtime_error("too many points"); })));
  EXPECT_EQ(Outcome::EXECUTION_FAILED, bad.wait().outcome);
  EXPECT_EQ("too many points", bad.wait().message);
  const TaskHandle odd = runtime.submit(requestOf(nativeCodelet("odd", [](const NativeCall&) { throw 7; })));
  EXPECT_EQ(Outcome::EXECUTION_FAILED, odd.wait().outcome);
  const TaskHandle missing =
      runtime.submit(requestOf(nativeCodelet("missing", [](const NativeCall& call) { call.buffer<int>(4); })));
  EXPECT_NE(std::string::npos, missing.wait().message.find("argument 4")) << missing.wait().message;
  EXPECT_EQ(3u, runtime.statistics().failed);
}

TEST(RuntimeTest, WrongRequestsAreRefusedWithTheReason)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("work");
  const auto refusal = [&](const std::function<void(TaskRequest&)>& spoil)
  {
    TaskRequest request = requestOf(codelet);
    spoil(request);
    const TaskHandle task = runtime->submit(request);
    EXPECT_TRUE(task.ready());
    EXPECT_EQ(Outcome::REFUSED, task.wait().outcome);
    EXPECT_EQ(task.wait().message, runtime->refusalOf(request));
    return task.wait().message;
  };
  EXPECT_EQ("there is no codelet", refusal([](TaskRequest& request) { request.codelet = nullptr; }));
  EXPECT_EQ("range = 0 of codelet work, must be at least 1", refusal([](TaskRequest& request) { request.range = 0; }));
  for (const double size : {-1.0, std::nan(""), HUGE_VAL})
  {
    EXPECT_EQ("size = " + std::to_string(size) + " of codelet work, must be finite and at least 0 (0: the range)",
              refusal([&](TaskRequest& request) { request.size = size; }));
  }
  EXPECT_EQ("stream = 9 of codelet work is not admitted; admit it first, or leave it 0",
            refusal([](TaskRequest& request) { request.stream = 9; }));
  EXPECT_EQ("there is no unit \"gpu7\", there are fake0, fake1",
            refusal([](TaskRequest& request) { request.unit = "gpu7"; }));
  EXPECT_EQ(7u, runtime->statistics().refused);
  EXPECT_EQ(7u, runtime->statistics().submitted);
}

TEST(RuntimeTest, ACodeletThatNoUnitCanRunIsRefused)
{
  FakeRuntime runtime(1, nullptr, {[](const Codelet&) { return false; }});
  EXPECT_EQ("no unit can run any of its implementations",
            runtime->submit(requestOf(fakeCodelet("work"))).wait().message);
}

TEST(RuntimeTest, ExtremeSizesAndTimesDoNotUpsetThePlans)
{
  FakeRuntime runtime(2);
  runtime.device(0).serveAll([](const FakeDevice::Start&) { return ExecutionReport(); });
  runtime.device(1).serveAll([](const FakeDevice::Start&) { return ExecutionReport(); });
  const CodeletPtr codelet = fakeCodelet("work");
  runtime.setTimes(codelet, {1e9, 1e9}, 1e-300);
  TaskRequest request = requestOf(codelet);
  request.size = 1e300;
  EXPECT_TRUE(runtime->submit(request).wait().ok());
  for (const TaskHandle& task : runtime->submitBatch({request, request, request}))
  {
    EXPECT_TRUE(task.wait().ok());
  }
  GraphRequest graph;
  graph.tasks.assign(50, request);
  for (const TaskHandle& task : runtime->submitGraph(graph))
  {
    EXPECT_TRUE(task.wait().ok());
  }
}

TEST(RuntimeTest, HandlesReferToTheSameTaskAndWaitNoLongerThanTheyAreTold)
{
  FakeRuntime runtime(1);
  TaskHandle none;
  EXPECT_FALSE(none.valid());
  const TaskHandle task = runtime->submit(requestOf(fakeCodelet("work")));
  const TaskHandle copy = task;
  EXPECT_EQ(task.id(), copy.id());
  EXPECT_FALSE(task.ready());
  EXPECT_FALSE(task.waitFor(1ms));
  EXPECT_FALSE(task.waitFor(-1s));
  std::thread waiter([&] { EXPECT_TRUE(copy.waitFor(std::chrono::nanoseconds::max())); });
  std::thread other([&] { EXPECT_TRUE(copy.wait().ok()); });
  runtime.device(0).serve();
  waiter.join();
  other.join();
  EXPECT_TRUE(task.ready());
}

TEST(RuntimeTest, DoneIsCalledOnceWithTheResult)
{
  FakeRuntime runtime(1);
  std::atomic<int> calls{0};
  TaskRequest request = requestOf(fakeCodelet("work"));
  request.done = [&](const TaskResult& result) { calls += result.ok() ? 1 : 100; };
  const TaskHandle good = runtime->submit(request);
  runtime.device(0).serve();
  request.range = 0;
  runtime->submit(request);
  EXPECT_EQ(101, calls) << "for refused ones too, at once";
}

TEST(RuntimeTest, DoneMaySubmitTheNextTask)
{
  std::atomic<int> left{100};
  Event last;
  Runtime runtime(nativeOptions());
  TaskRequest request = requestOf(nativeCodelet("link", [](const NativeCall&) {}));
  request.done = [&](const TaskResult& result)
  {
    if (result.ok() && --left > 0)
    {
      runtime.submit(request);
    }
    else
    {
      last.set();
    }
  };
  runtime.submit(request);
  EXPECT_TRUE(last.wait());
  EXPECT_EQ(0, left);
}

TEST(RuntimeTest, DroppingAHandleCancelsNothing)
{
  Event ran;
  Runtime runtime(nativeOptions());
  runtime.submit(requestOf(nativeCodelet("work", [&](const NativeCall&) { ran.set(); })));
  EXPECT_TRUE(ran.wait());
}

TEST(RuntimeTest, AQueuedTaskIsCancelledAtOnce)
{
  FakeRuntime runtime(1);
  const TaskHandle running = runtime->submit(requestOf(fakeCodelet("work")));
  const TaskHandle queued = runtime->submit(requestOf(fakeCodelet("work")));
  queued.cancel();
  EXPECT_TRUE(queued.ready());
  EXPECT_EQ(Outcome::CANCELLED, queued.wait().outcome);
  EXPECT_EQ(0, queued.wait().started_ns);
  queued.cancel();  // has no effect
  runtime.device(0).serve();
  EXPECT_TRUE(running.wait().ok());
  running.cancel();
  EXPECT_TRUE(running.wait().ok());
  EXPECT_EQ(1u, runtime.device(0).started());
  EXPECT_EQ(1u, runtime->statistics().cancelled);
}

TEST(RuntimeTest, ARunningFunctionSeesThatItIsCancelled)
{
  Event begun;
  Runtime runtime(nativeOptions());
  const TaskHandle task = runtime.submit(requestOf(nativeCodelet("endless",
                                                                 [&](const NativeCall& call)
                                                                 {
                                                                   begun.set();
                                                                   while (!call.cancelled())
                                                                   {
                                                                     std::this_thread::yield();
                                                                   }
                                                                 })));
  ASSERT_TRUE(begun.wait());
  task.cancel();
  EXPECT_EQ(Outcome::CANCELLED, task.wait().outcome);
}

TEST(RuntimeTest, ASlicedTaskIsCancelledAfterItsSlice)
{
  FakeRuntime runtime(1);
  TaskRequest request = requestOf(fakeCodelet("long", true));
  request.range = 1000;
  const TaskHandle task = runtime->submit(request);
  runtime.device(0).awaitStart();
  task.cancel();
  EXPECT_FALSE(task.ready());
  runtime.device(0).finish();
  EXPECT_EQ(Outcome::CANCELLED, task.wait().outcome);
  EXPECT_EQ(1u, runtime.device(0).started());
}

TEST(RuntimeTest, SlicesCoverTheRangeOnceAndKeepToTheGranularity)
{
  FakeRuntime runtime(1);
  Codelet codelet = *fakeCodelet("grainy", true);
  codelet.slice_granularity = 7;
  const CodeletPtr grainy = makeCodelet(codelet);
  for (const uint64_t range : {1u, 6u, 7u, 8u, 1000u})
  {
    TaskRequest request = requestOf(grainy);
    request.range = range;
    const TaskHandle task = runtime->submit(request);
    uint64_t next = 0;
    uint32_t slices = 0;
    while (next < range)
    {
      const FakeDevice::Start slice = runtime.device(0).serve();
      EXPECT_EQ(next, slice.begin);
      EXPECT_GT(slice.end, slice.begin);
      EXPECT_TRUE(slice.end % 7 == 0 || slice.end == range);
      next = slice.end;
      ++slices;
    }
    EXPECT_EQ(slices, task.wait().slices);
  }
}

TEST(RuntimeTest, TheDestructorEndsEverything)
{
  FakeRuntime runtime(1);
  std::atomic<int> shut_down{0};
  TaskRequest request = requestOf(fakeCodelet("work"));
  request.done = [&](const TaskResult& result) { shut_down += result.outcome == Outcome::SHUT_DOWN ? 1 : 0; };
  std::vector<TaskHandle> tasks;
  for (int i = 0; i < 10; ++i)
  {
    tasks.push_back(runtime->submit(request));
  }
  runtime.device(0).awaitStart();
  std::thread device(
      [&]
      {
        EXPECT_EQ(Outcome::SHUT_DOWN, tasks.back().wait().outcome);
        runtime.device(0).finish();
      });
  runtime.stop();
  device.join();
  EXPECT_EQ(Outcome::CANCELLED, tasks[0].wait().outcome);
  EXPECT_EQ(9, shut_down);
  tasks[0].cancel();  // the runtime is gone
}

TEST(RuntimeTest, TheDestructorWaitsForCallbacksThatStillUseTheRuntime)
{
  FakeRuntime runtime(1);
  Event in_callback;
  Event go_on;
  TaskHandle second;
  TaskRequest request = requestOf(fakeCodelet("work"));
  request.done = [&](const TaskResult&)
  {
    in_callback.set();
    go_on.wait();
    second = runtime->submit(requestOf(fakeCodelet("work")));
  };
  const TaskHandle queued = runtime->submit(requestOf(fakeCodelet("work")));
  runtime->submit(request);
  const TaskHandle last = runtime->submit(requestOf(fakeCodelet("work")));
  runtime.device(0).serve();
  runtime.device(0).awaitStart();
  std::thread device([&] { runtime.device(0).finish(); });
  ASSERT_TRUE(in_callback.wait());
  runtime.device(0).awaitStart();
  std::thread finisher(
      [&]
      {
        while (!runtime.device(0).cancelled())  // the only trace that the destructor leaves
        {
          std::this_thread::yield();
        }
        runtime.device(0).finish();
        go_on.set();
      });
  runtime->units();
  runtime.stop();
  device.join();
  finisher.join();
  ASSERT_TRUE(second.valid());
  EXPECT_EQ(Outcome::SHUT_DOWN, second.wait().outcome);
}

TEST(RuntimeTest, UnitsTellTheirState)
{
  FakeRuntime runtime(2, [](RuntimeOptions& options) { options.tuning.push_back({"fake1", 15.0, 2.0, 1.0}); });
  const CodeletPtr codelet = fakeCodelet("work");
  runtime.setTimes(codelet, {1.0, 9.0});
  runtime->submit(requestOf(codelet, "fake0"));
  runtime->submit(requestOf(codelet, "fake0"));
  const std::vector<UnitStatus> units = runtime->units();
  ASSERT_EQ(2u, units.size());
  EXPECT_EQ("fake0", units[0].name);
  EXPECT_EQ(UnitType::ACCELERATOR, units[0].type);
  EXPECT_EQ(std::vector<std::string>{"fake"}, units[0].executors);
  EXPECT_EQ(1u, units[0].queued);
  EXPECT_EQ(1u, units[0].running);
  EXPECT_NEAR(2.0, units[0].load_s, 0.5);
  EXPECT_EQ(0.0, units[1].load_s);
  EXPECT_EQ(15.0, units[1].active_power_w);
  EXPECT_EQ(2.0, units[1].idle_power_w);
  EXPECT_GE(units[0].utilisation, 0.0);
  EXPECT_LE(units[0].utilisation, 1.0);
  runtime.device(0).serve();
  runtime.device(0).serve();
  EXPECT_THROW(runtime->setUnitAvailable("gpu3", false), std::invalid_argument);
}

TEST(RuntimeTest, ImpossibleOptionsAreErrors)
{
  const auto impossible = [](const std::function<void(RuntimeOptions&)>& spoil)
  {
    RuntimeOptions options = nativeOptions();
    spoil(options);
    EXPECT_THROW(Runtime{options}, std::invalid_argument);
  };
  impossible([](RuntimeOptions& options) { options.cpu_units = {0}; });
  impossible([](RuntimeOptions& options) { options.cpu_units = {4096}; });
  impossible([](RuntimeOptions& options) { options.slice = 0us; });
  impossible([](RuntimeOptions& options) { options.pipeline = -1us; });
  impossible([](RuntimeOptions& options) { options.hang_timeout = 0ms; });
  impossible([](RuntimeOptions& options) { options.hang_timeout = std::chrono::milliseconds::max(); });
  impossible([](RuntimeOptions& options) { options.tuning = {{"cpu0", 0.0, 0.0, 0.5}}; });
  impossible([](RuntimeOptions& options) { options.tuning = {{"cpu0", INFINITY, 0.0, 1.0}}; });
  impossible([](RuntimeOptions& options) { options.tuning = {{"cpu99", 0.0, 0.0, 1.0}}; });
  EXPECT_THROW(Runtime{FakeRuntime::fakeOptions()}, std::runtime_error) << "no unit at all";
  EXPECT_THROW(parseQueueOrder("lifo"), std::invalid_argument);
  EXPECT_EQ(QueueOrder::FIFO, parseQueueOrder(toString(QueueOrder::FIFO)));
}

TEST(RuntimeTest, CustomUnitsNeedANameAndAnExecutor)
{
  for (const std::string name : {"", "two words", "a,b"})
  {
    std::vector<CustomUnit> units(1);
    units[0].name = name;
    units[0].executors.push_back(std::make_unique<FakeExecutor>(std::make_shared<FakeDevice>()));
    EXPECT_THROW(Runtime(FakeRuntime::fakeOptions(), std::move(units)), std::invalid_argument) << name;
  }
  std::vector<CustomUnit> empty(1);
  empty[0].name = "empty";
  EXPECT_THROW(Runtime(FakeRuntime::fakeOptions(), std::move(empty)), std::invalid_argument);
  std::vector<CustomUnit> null(1);
  null[0].name = "null";
  null[0].executors.push_back(nullptr);
  EXPECT_THROW(Runtime(FakeRuntime::fakeOptions(), std::move(null)), std::invalid_argument);
}

TEST(RuntimeTest, SharedIsOnePerProcessAndEndsWithItsLastUser)
{
  std::shared_ptr<Runtime> first = Runtime::shared(nativeOptions());
  EXPECT_EQ(first, Runtime::shared());
  const TaskHandle task = first->submit(requestOf(fakeCodelet("work")));
  EXPECT_TRUE(task.wait().ok());
  const std::weak_ptr<Runtime> alive = first;
  first.reset();
  EXPECT_TRUE(alive.expired());
}

}  // namespace
}  // namespace pi_runtime
