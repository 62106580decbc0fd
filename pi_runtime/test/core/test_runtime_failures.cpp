// What the runtime does when units, programs and functions fail.
#include <gtest/gtest.h>

#include <cmath>

#include "core/fake_executor.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;

TEST(RuntimeFailures, ATaskWhoseUnitFailsIsRunElsewhereAndOneWarningIsSaid)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("work");
  runtime.setTimes(codelet, {1e-3, 2e-3});
  const TaskHandle first = runtime->submit(requestOf(codelet));
  const TaskHandle second = runtime->submit(requestOf(codelet));
  runtime.device(0).awaitStart();
  runtime.device(0).fail(Outcome::UNIT_FAILED, "the cable is loose");
  runtime.device(1).serve();
  runtime.device(1).serve();
  EXPECT_TRUE(first.wait().ok()) << first.wait().message;
  EXPECT_EQ("fake1", first.wait().unit);
  EXPECT_TRUE(second.wait().ok());
  EXPECT_EQ(1u, runtime.logged("the cable is loose"));
  EXPECT_TRUE(runtime->units()[0].failed);
  EXPECT_EQ("the cable is loose", runtime->units()[0].failure);
  EXPECT_EQ(1u, runtime->units()[0].failures);
}

TEST(RuntimeFailures, ATaskWithHalfWrittenBuffersIsNotRepeated)
{
  FakeRuntime runtime(2);
  TaskRequest request = requestOf(fakeCodelet("work"));
  request.arguments = {Argument::inOut(Buffer::allocate(16))};
  const TaskHandle task = runtime->submit(std::move(request));
  const size_t unit = runtime.device(0).running() == 1 ? 0 : 1;
  runtime.device(unit).fail(Outcome::UNIT_FAILED, "gone");
  EXPECT_EQ(Outcome::UNIT_FAILED, task.wait().outcome);
  EXPECT_NE(std::string::npos, task.wait().message.find("half written")) << task.wait().message;
  EXPECT_EQ(0u, runtime.device(1 - unit).started());
}

TEST(RuntimeFailures, WithoutAnyUnitLeftTasksSayWhichUnitsAreOutAndWhy)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("work");
  const TaskHandle task = runtime->submit(requestOf(codelet, "fake0"));
  runtime.device(0).fail(Outcome::UNIT_FAILED, "burnt");
  EXPECT_EQ(Outcome::UNIT_FAILED, task.wait().outcome);
  runtime->setUnitAvailable("fake1", false);
  const TaskHandle later = runtime->submit(requestOf(codelet));
  EXPECT_EQ(Outcome::UNIT_FAILED, later.wait().outcome);
  EXPECT_NE(std::string::npos, later.wait().message.find("fake0 is out: burnt")) << later.wait().message;
  EXPECT_NE(std::string::npos, later.wait().message.find("fake1 is out: taken out by request"));
}

TEST(RuntimeFailures, AUnitBroughtBackIsUsedAgain)
{
  FakeRuntime runtime(1);
  const CodeletPtr codelet = fakeCodelet("work");
  const TaskHandle lost = runtime->submit(requestOf(codelet));
  runtime.device(0).fail(Outcome::UNIT_FAILED, "gone");
  EXPECT_EQ(Outcome::UNIT_FAILED, lost.wait().outcome);
  runtime->setUnitAvailable("fake0", true);
  const TaskHandle task = runtime->submit(requestOf(codelet));
  runtime.device(0).finish();
  EXPECT_TRUE(task.wait().ok());
}

TEST(RuntimeFailures, SeveralTasksInFlightOnAFailingUnitAllGoElsewhere)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("tiny");
  runtime.setTimes(codelet, {1e-6, 1.0});
  std::vector<TaskHandle> tasks;
  for (int i = 0; i < 3; ++i)
  {
    tasks.push_back(runtime->submit(requestOf(codelet)));
  }
  ASSERT_EQ(3u, runtime.device(0).running()) << "short tasks are enqueued behind each other";
  for (int i = 0; i < 3; ++i)
  {
    runtime.device(0).fail(Outcome::UNIT_FAILED, "gone");
  }
  for (const TaskHandle& task : tasks)
  {
    runtime.device(1).serve();
    EXPECT_TRUE(task.waitFor(LONG_WAIT));
    EXPECT_TRUE(task.wait().ok());
  }
  EXPECT_EQ(1u, runtime.logged("is taken out"));
}

TEST(RuntimeFailures, ACancelledTaskIsNotRepeatedWhenItsUnitFails)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("work");
  runtime.setTimes(codelet, {1e-3, 1.0});
  const TaskHandle task = runtime->submit(requestOf(codelet));
  task.cancel();
  runtime.device(0).fail(Outcome::UNIT_FAILED, "gone");
  EXPECT_EQ(Outcome::CANCELLED, task.wait().outcome);
  EXPECT_EQ(0u, runtime.device(1).started());
}

TEST(RuntimeFailures, FailedExecutionsAreReportedWithTheirText)
{
  FakeRuntime runtime(2);
  const TaskHandle task = runtime->submit(requestOf(fakeCodelet("work"), "fake1"));
  ExecutionReport report;
  report.outcome = Outcome::EXECUTION_FAILED;
  report.message = "argument 3 is too short";
  report.opencl_code = -51;
  runtime.device(1).finish(report);
  EXPECT_EQ(Outcome::EXECUTION_FAILED, task.wait().outcome);
  EXPECT_EQ("argument 3 is too short", task.wait().message);
  EXPECT_EQ(-51, task.wait().opencl_code);
  EXPECT_FALSE(runtime->units()[1].failed) << "the unit is not to blame";
}

TEST(RuntimeFailures, AProgramThatDoesNotBuildIsTriedOnceHoweverManyTasksWait)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("work");
  runtime.setTimes(codelet, {1e-3, 1.0});
  std::vector<TaskHandle> tasks;
  for (int i = 0; i < 20; ++i)
  {
    tasks.push_back(runtime->submit(requestOf(codelet)));
  }
  runtime.device(0).awaitStart();
  runtime.device(0).fail(Outcome::BUILD_FAILED, "line 1: syntax error");
  for (const TaskHandle& task : tasks)
  {
    runtime.device(1).serve();
    EXPECT_TRUE(task.waitFor(LONG_WAIT));
  }
  for (const TaskHandle& task : tasks)
  {
    EXPECT_TRUE(task.wait().ok()) << task.wait().message;
  }
  EXPECT_EQ(1u, runtime.device(0).started());
  EXPECT_EQ(1u, runtime.logged("does not build"));
  EXPECT_FALSE(runtime->units()[0].failed);
}

TEST(RuntimeFailures, WhereNothingBuildsTheTaskHasTheLog)
{
  FakeRuntime runtime(1);
  const CodeletPtr codelet = fakeCodelet("work");
  const TaskHandle task = runtime->submit(requestOf(codelet));
  runtime.device(0).fail(Outcome::BUILD_FAILED, "line 1: syntax error");
  EXPECT_EQ(Outcome::BUILD_FAILED, task.wait().outcome);
  EXPECT_EQ("line 1: syntax error", task.wait().message);
  EXPECT_EQ(Outcome::BUILD_FAILED, runtime->submit(requestOf(codelet)).wait().outcome);
  EXPECT_EQ(1u, runtime.device(0).started());
  EXPECT_TRUE(std::isinf(runtime->predict(codelet, 1.0, "fake0"))) << "it cannot run there";
}

TEST(RuntimeFailures, AHangingUnitIsGivenUpAndComesBackWhenItAnswers)
{
  FakeRuntime runtime(2, [](RuntimeOptions& options) { options.hang_timeout = 50ms; });
  const CodeletPtr codelet = fakeCodelet("work");
  runtime.setTimes(codelet, {1e-3, 1.0});
  const TaskHandle hanging = runtime->submit(requestOf(codelet));
  const TaskHandle waiting = runtime->submit(requestOf(codelet));
  runtime.device(0).awaitStart();
  ASSERT_TRUE(hanging.waitFor(LONG_WAIT));
  EXPECT_EQ(Outcome::UNIT_FAILED, hanging.wait().outcome);
  EXPECT_NE(std::string::npos, hanging.wait().message.find("hangs")) << hanging.wait().message;
  EXPECT_TRUE(runtime.device(0).cancelled());
  runtime.device(1).serve();
  EXPECT_EQ("fake1", waiting.wait().unit);
  EXPECT_TRUE(runtime->units()[0].failed);
  runtime->setUnitAvailable("fake0", true);
  EXPECT_TRUE(runtime->units()[0].failed) << "it still hangs";
  runtime.device(0).finish();
  ASSERT_TRUE(runtime.awaitLog("answers again"));
  EXPECT_FALSE(runtime->units()[0].failed);
  EXPECT_EQ(Outcome::UNIT_FAILED, hanging.wait().outcome) << "what was said stays said";
  const TaskHandle next = runtime->submit(requestOf(codelet));
  runtime.device(0).serve();
  EXPECT_EQ("fake0", next.wait().unit);
}

TEST(RuntimeFailures, TheDestructorLeavesAHangingUnitBehind)
{
  FakeRuntime runtime(1, [](RuntimeOptions& options) { options.hang_timeout = 50ms; });
  const std::shared_ptr<FakeDevice> device = runtime.sharedDevice(0);
  const TaskHandle running = runtime->submit(requestOf(fakeCodelet("work")));
  const TaskHandle queued = runtime->submit(requestOf(fakeCodelet("work")));
  device->awaitStart();
  runtime.stop();
  EXPECT_TRUE(running.ready());
  EXPECT_TRUE(queued.ready());
  EXPECT_EQ(Outcome::SHUT_DOWN, queued.wait().outcome);
  const size_t lines = runtime.log().size();
  device->finish();  // comes back to an object that nobody else knows
  EXPECT_EQ(lines, runtime.log().size()) << "nobody is there to be told";
}

TEST(RuntimeFailures, ATakenOutUnitGivesTheRestOfASlicedTaskAway)
{
  FakeRuntime runtime(2, [](RuntimeOptions& options) { options.stealing = false; });
  const CodeletPtr codelet = fakeCodelet("long", true);
  runtime.setTimes(codelet, {10e-3, 100e-3}, 64);
  TaskRequest request = requestOf(codelet);
  request.range = 64;
  const TaskHandle task = runtime->submit(std::move(request));
  const FakeDevice::Start first = runtime.device(0).awaitStart();
  EXPECT_EQ(0u, first.begin);
  EXPECT_LT(first.end, 64u);
  runtime->setUnitAvailable("fake0", false);
  runtime.device(0).finish();
  uint64_t next = first.end;
  while (next != 64)
  {
    const FakeDevice::Start slice = runtime.device(1).serve();
    EXPECT_EQ(next, slice.begin);
    next = slice.end;
  }
  EXPECT_TRUE(task.wait().ok());
  EXPECT_EQ("fake1", task.wait().unit);
}

TEST(RuntimeFailures, LogCallbacksMayAskTheRuntime)
{
  Event told;
  Runtime* asked = nullptr;
  FakeRuntime runtime(2,
                      [&](RuntimeOptions& options)
                      {
                        options.log = [&](LogLevel, const std::string&)
                        {
                          asked->units();
                          told.set();
                        };
                      });
  asked = runtime.operator->();
  runtime->submit(requestOf(fakeCodelet("work"), "fake0"));
  runtime.device(0).fail(Outcome::UNIT_FAILED, "gone");
  EXPECT_TRUE(told.wait());
}

TEST(RuntimeFailures, AThrowingDoneCallbackIsLoggedAndHarmsNothing)
{
  FakeRuntime runtime(1);
  TaskRequest request = requestOf(fakeCodelet("work"));
  request.done = [](const TaskResult&) { throw std::runtime_error("the caller's mistake"); };
  const TaskHandle task = runtime->submit(std::move(request));
  runtime.device(0).finish();
  EXPECT_TRUE(task.wait().ok());
  EXPECT_TRUE(runtime.awaitLog("the caller's mistake"));
}

}  // namespace
}  // namespace pi_runtime
