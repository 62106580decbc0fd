// In which order units take tasks, and what streams with deadlines are spared.
#include <gtest/gtest.h>

#include <cmath>

#include "core/fake_executor.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;

TaskRequest named(const std::string& name, std::optional<std::chrono::nanoseconds> deadline = std::nullopt,
                  int priority = 0)
{
  TaskRequest request = requestOf(fakeCodelet(name));
  request.deadline = deadline;
  request.priority = priority;
  return request;
}

StreamRequest streamOf(const CodeletPtr& codelet, std::chrono::nanoseconds period, std::chrono::nanoseconds wcet)
{
  StreamRequest request;
  request.name = codelet->name;
  request.codelet = codelet;
  request.period = period;
  request.wcet = wcet;
  return request;
}

/// What runs on the first fake, one after the other, until nothing is left of `count` tasks.
std::string orderOf(FakeRuntime& runtime, size_t count)
{
  std::string order;
  for (size_t i = 0; i < count; ++i)
  {
    order += runtime.device(0).serve().codelet + " ";
  }
  return order;
}

TEST(RuntimeDeadlines, GoFirstByDeadlineThenPriorityThenAsSubmitted)
{
  FakeRuntime runtime(1);
  runtime->submit(named("first"));  // starts at once
  for (const TaskRequest& request :
       {named("plain1"), named("high", std::nullopt, 5), named("plain2"), named("late", 20s), named("soon", 10s),
        named("low", std::nullopt, -5), named("never", std::chrono::nanoseconds::max(), 6)})
  {
    runtime->submit(request);
  }
  EXPECT_EQ("first soon late never high plain1 plain2 low ", orderOf(runtime, 8));
}

TEST(RuntimeDeadlines, FifoIgnoresThem)
{
  FakeRuntime runtime(1, [](RuntimeOptions& options) { options.queue_order = QueueOrder::FIFO; });
  runtime->submit(named("first"));
  runtime->submit(named("plain"));
  runtime->submit(named("urgent", 1s, 7));
  EXPECT_EQ("first plain urgent ", orderOf(runtime, 3));
  runtime->submit(named("first"));
  runtime->submitBatch({named("a"), named("b", 2s), named("c", 1s), named("d")});
  EXPECT_EQ("first a b c d ", orderOf(runtime, 5)) << "a batch as well";
}

TEST(RuntimeDeadlines, ABatchIsPutBehindThem)
{
  FakeRuntime runtime(1);
  runtime->submit(named("first"));
  runtime->submitBatch({named("plain"), named("second", 20s), named("one", 10s)});
  EXPECT_EQ("first one second plain ", orderOf(runtime, 4));
}

TEST(RuntimeDeadlines, AMissIsCounted)
{
  FakeRuntime runtime(1);
  const TaskHandle late = runtime->submit(named("late", -1ns));
  const TaskHandle early = runtime->submit(named("early", 100s));
  runtime.device(0).serve();
  runtime.device(0).serve();
  EXPECT_TRUE(late.wait().missedDeadline());
  EXPECT_FALSE(early.wait().missedDeadline());
  EXPECT_EQ(1u, runtime->statistics().missed_deadlines);
  EXPECT_EQ(1u, runtime->units()[0].missed_deadlines);
  EXPECT_EQ(2u, runtime->units()[0].deadline_tasks);
}

TEST(RuntimeDeadlines, AnUrgentTaskGoesWhereItEndsFirstAheadOfTheQueue)
{
  FakeRuntime runtime(2);
  const CodeletPtr batch = fakeCodelet("batch");
  const CodeletPtr urgent = fakeCodelet("urgent");
  runtime.setTimes(batch, {1.0, 1.0});
  runtime.setTimes(urgent, {10e-3, 20e-3});
  const std::vector<TaskHandle> running = runtime->submitBatch({requestOf(batch, "fake0"), requestOf(batch, "fake0")});
  TaskRequest request = requestOf(urgent);
  request.deadline = 5s;
  const TaskHandle task = runtime->submit(request);
  EXPECT_EQ("urgent", runtime.device(1).serve().codelet) << "fake0 is busy for a second";
  EXPECT_TRUE(task.wait().ok());
  runtime.device(0).serve();
  runtime.device(0).serve();
}

TEST(RuntimeStreams, LongBatchTasksStayAwayFromTheirUnit)
{
  FakeRuntime runtime(2);
  const CodeletPtr job = fakeCodelet("job");
  const CodeletPtr batch = fakeCodelet("batch");
  runtime.setTimes(batch, {20e-3, 100e-3});
  StreamRequest request = streamOf(job, 10ms, 2ms);
  const Admission stream = runtime->admit(request);
  ASSERT_TRUE(stream.admitted()) << stream.reason;
  ASSERT_EQ("fake0", runtime->streams()[0].unit);
  EXPECT_NEAR(8e-3, runtime->units()[0].blocking_budget_s, 1e-9);
  EXPECT_TRUE(std::isinf(runtime->units()[1].blocking_budget_s));
  const TaskHandle task = runtime->submit(requestOf(batch));
  EXPECT_EQ("batch", runtime.device(1).serve().codelet);
  EXPECT_EQ("fake1", task.wait().unit);
  for (const TaskHandle& more : runtime->submitBatch({requestOf(batch), requestOf(batch)}))
  {
    runtime.device(1).serve();
    EXPECT_TRUE(more.wait().ok());
  }
  EXPECT_EQ(0u, runtime.device(0).started());
  runtime->retire(stream.id);
  EXPECT_TRUE(std::isinf(runtime->units()[0].blocking_budget_s));
  runtime->submit(requestOf(batch));
  EXPECT_EQ("batch", runtime.device(0).serve().codelet) << "the unit is free again";
}

TEST(RuntimeStreams, ABatchTaskThatWouldDelayThemEverywhereIsRefusedWithTheFigures)
{
  FakeRuntime runtime(1);
  const CodeletPtr batch = fakeCodelet("batch");
  runtime.setTimes(batch, {20e-3});
  ASSERT_TRUE(runtime->admit(streamOf(fakeCodelet("job"), 10ms, 2ms)).admitted());
  const TaskHandle refused = runtime->submit(requestOf(batch));
  EXPECT_EQ(Outcome::REFUSED, refused.wait().outcome);
  EXPECT_NE(std::string::npos, refused.wait().message.find("fake0 for 20 ms where they stand 8 ms"))
      << refused.wait().message;
  EXPECT_NE(std::string::npos, refused.wait().message.find("make the codelet sliceable"));
}

TEST(RuntimeStreams, QueuedTasksLeaveAUnitThatAStreamIsAdmittedOn)
{
  FakeRuntime runtime(2, [](RuntimeOptions& options) { options.stealing = false; });
  const CodeletPtr batch = fakeCodelet("batch");
  const CodeletPtr job = fakeCodelet("job");
  runtime.setTimes(batch, {20e-3, 1.0});
  runtime.setTimes(job, {1e-3, 5e-3});
  const TaskHandle running = runtime->submit(requestOf(batch));
  const TaskHandle queued = runtime->submit(requestOf(batch));
  StreamRequest request = streamOf(job, 10ms, 0ms);
  ASSERT_TRUE(runtime->admit(request).admitted());
  ASSERT_EQ("fake0", runtime->streams()[0].unit) << "the faster one";
  runtime.device(1).serve();
  EXPECT_EQ("fake1", queued.wait().unit);
  runtime.device(0).serve();
  EXPECT_TRUE(running.wait().ok());
}

TEST(RuntimeStreams, SliceableTasksRunBetweenTheirJobs)
{
  FakeRuntime runtime(1);
  const CodeletPtr batch = fakeCodelet("batch", true);
  const CodeletPtr job = fakeCodelet("job");
  constexpr uint64_t RANGE = 1000;
  runtime.setTimes(batch, {100e-3}, RANGE);
  const Admission stream = runtime->admit(streamOf(job, 5ms, 2ms));
  ASSERT_TRUE(stream.admitted()) << stream.reason;
  TaskRequest long_task = requestOf(batch);
  long_task.range = RANGE;
  const TaskHandle task = runtime->submit(long_task);
  TaskRequest job_request = requestOf(job);
  job_request.stream = stream.id;
  uint64_t next = 0;
  uint32_t slices = 0;
  while (next < RANGE)
  {
    const FakeDevice::Start slice = runtime.device(0).awaitStart();
    ASSERT_EQ("batch", slice.codelet);
    EXPECT_EQ(next, slice.begin);
    if (slices == 0)
    {
      EXPECT_LE(slice.end - slice.begin, 30u) << "100 ms for 1000, and only 3 ms are free";
    }
    next = slice.end;
    ++slices;
    const TaskHandle urgent = runtime->submit(job_request);
    runtime.device(0).finish();
    EXPECT_EQ("job", runtime.device(0).serve().codelet) << "it waits for no more than a slice";
    EXPECT_TRUE(urgent.wait().ok());
  }
  EXPECT_TRUE(task.wait().ok());
  EXPECT_EQ(slices, task.wait().slices);
  EXPECT_EQ(slices, runtime->streams()[0].jobs);
}

TEST(RuntimeStreams, AdmissionCountsWhatIsThereAlready)
{
  FakeRuntime runtime(1);
  const CodeletPtr job = fakeCodelet("job");
  EXPECT_TRUE(runtime->admit(streamOf(job, 10ms, 4ms)).admitted());
  EXPECT_TRUE(runtime->admit(streamOf(job, 20ms, 4ms)).admitted());
  const Admission full = runtime->admit(streamOf(job, 10ms, 5ms));
  EXPECT_FALSE(full.admitted());
  EXPECT_NE(std::string::npos, full.reason.find("fake0 would be used to 110 %")) << full.reason;
  const Admission blocking = runtime->admit(streamOf(job, 1000ms, 7ms));
  EXPECT_FALSE(blocking.admitted()) << "10 - 4 ms are free in front of the first deadline";
  EXPECT_TRUE(runtime->admit(streamOf(job, 1000ms, 6ms)).admitted());
  EXPECT_NEAR(6e-3, runtime->units()[0].blocking_budget_s, 1e-9) << "up to the first deadline, less the job before it";
}

TEST(RuntimeStreams, RefusalsNameEveryUnitAndWhatToDo)
{
  const auto no_jobs = [](const Codelet& codelet) { return codelet.name != "job"; };
  FakeRuntime runtime(3, nullptr, {no_jobs});
  runtime->setUnitAvailable("fake2", false);
  const Admission unknown = runtime->admit(streamOf(fakeCodelet("job"), 10ms, 0ms));
  EXPECT_FALSE(unknown.admitted());
  EXPECT_EQ(
      "fake0 cannot run it; nothing is known of its run time on fake1 (calibrate() it, or give wcet); "
      "fake2 is out: taken out by request",
      unknown.reason);
  for (StreamRequest wrong : {StreamRequest(), streamOf(fakeCodelet("job"), 0ms, 1ms),
                              streamOf(fakeCodelet("job"), 10ms, -1ms), streamOf(fakeCodelet("job"), -1ms, 1ms)})
  {
    EXPECT_NE(std::string::npos, runtime->admit(wrong).reason.find("needs a codelet")) << wrong.period.count();
  }
  StreamRequest wrong = streamOf(fakeCodelet("job"), 10ms, 1ms);
  wrong.size = std::nan("");
  EXPECT_FALSE(runtime->admit(wrong).admitted());
}

TEST(RuntimeStreams, TheirLongestTimeComesFromTheTableIfNotGiven)
{
  FakeRuntime runtime(1);
  const CodeletPtr job = fakeCodelet("job");
  EtcTable::Cell cell;
  cell.count = 5;
  cell.mean_s = 2e-3;
  cell.variance_s2 = 1e-6 * 0.25;  // deviation 0.5 ms
  runtime->setEtcEntries({{"job", 0, "fake0/fake", cell}});
  ASSERT_TRUE(runtime->admit(streamOf(job, 10ms, 0ms)).admitted());
  EXPECT_NEAR(3.5e-3, runtime->streams()[0].wcet_s, 1e-12);
}

TEST(RuntimeStreams, JobsTakeTheirDeadlineFromThem)
{
  FakeRuntime runtime(1);
  const CodeletPtr job = fakeCodelet("job");
  StreamRequest request = streamOf(job, 10ms, 1ms);
  request.deadline = 7ms;
  const Admission stream = runtime->admit(request);
  TaskRequest task = requestOf(job);
  task.stream = stream.id;
  const TaskHandle done = runtime->submit(task);
  task.deadline = 3ms;
  const TaskHandle own = runtime->submit(task);
  runtime.device(0).serve();
  runtime.device(0).serve();
  EXPECT_EQ(7000000, done.wait().deadline_ns - done.wait().submitted_ns);
  EXPECT_EQ(3000000, own.wait().deadline_ns - own.wait().submitted_ns);
  const StreamStatus status = runtime->streams()[0];
  EXPECT_EQ(2u, status.jobs);
  EXPECT_GE(status.max_s, status.p50_s);
  EXPECT_GT(status.p50_s, 0.0);
  runtime->retire(stream.id);
  EXPECT_TRUE(runtime->streams().empty());
  EXPECT_EQ(Outcome::REFUSED, runtime->submit(task).wait().outcome) << "it is not admitted any more";
}

TEST(RuntimeStreams, WhoTakesLongerThanAdmittedWaitsAndNotTheOthers)
{
  FakeRuntime runtime(1);
  const CodeletPtr greedy = fakeCodelet("greedy");
  const CodeletPtr modest = fakeCodelet("modest");
  const Admission first = runtime->admit(streamOf(greedy, 10s, 1us));
  const Admission second = runtime->admit(streamOf(modest, 20s, 1ms));
  ASSERT_TRUE(first.admitted() && second.admitted());
  TaskRequest job = requestOf(greedy);
  job.stream = first.id;
  TaskRequest other = requestOf(modest);
  other.stream = second.id;
  runtime->submit(job);
  EXPECT_EQ("greedy", runtime.device(0).awaitStart().codelet);
  const auto begin = std::chrono::steady_clock::now();
  runtime->submit(job);    // due in 10 s, were it not for the first one
  runtime->submit(other);  // due in 20 s
  while (std::chrono::steady_clock::now() - begin < 10us)
  {
  }
  runtime.device(0).finish();  // ten times what it was admitted with
  EXPECT_EQ("modest", runtime.device(0).serve().codelet);
  EXPECT_EQ("greedy", runtime.device(0).serve().codelet) << "later, but not never";
}

TEST(RuntimeStreams, ATimeBelowThatOfTheTableIsWarnedOf)
{
  FakeRuntime runtime(1);
  const CodeletPtr job = fakeCodelet("job");
  runtime.setTimes(job, {8e-3});
  EXPECT_TRUE(runtime->admit(streamOf(job, 100ms, 10ms)).admitted());
  EXPECT_EQ(0u, runtime.log().size());
  EXPECT_TRUE(runtime->admit(streamOf(job, 100ms, 5ms)).admitted());
  EXPECT_EQ(1u, runtime.logged("wcet = 5 ms, but takes 8 ms on unit fake0"));
}

TEST(RuntimeStreams, SlicesAreMadeShorterToGetOneAdmitted)
{
  FakeRuntime runtime(1, [](RuntimeOptions& options) { options.slice = 5ms; });
  const CodeletPtr quick = fakeCodelet("quick");
  const CodeletPtr sliced = fakeCodelet("sliced", true);
  ASSERT_TRUE(runtime->admit(streamOf(quick, 4ms, 1ms)).admitted());
  const Admission admission = runtime->admit(streamOf(sliced, 100ms, 20ms));
  EXPECT_TRUE(admission.admitted()) << "in slices of 2.5 ms: " << admission.reason;
  EXPECT_FALSE(runtime->admit(streamOf(fakeCodelet("whole"), 100ms, 20ms)).admitted());
}

TEST(RuntimeStreams, WhatNothingIsKnownOfRunsWhereNothingCanBeLate)
{
  FakeRuntime runtime(2);
  const Admission stream = runtime->admit(streamOf(fakeCodelet("job"), 10ms, 2ms));
  ASSERT_TRUE(stream.admitted());
  ASSERT_EQ("fake0", runtime->streams()[0].unit);
  for (int i = 0; i < 4; ++i)
  {
    runtime->submit(requestOf(fakeCodelet("unknown" + std::to_string(i))));
    runtime.device(1).serve();
  }
  EXPECT_EQ(0u, runtime.device(0).started());
}

TEST(RuntimeStreams, MoveToAUnitThatCanRunThemWhenTheirsFails)
{
  const auto no_jobs = [](const Codelet& codelet) { return codelet.name != "job"; };
  FakeRuntime runtime(3, [](RuntimeOptions& options) { options.stealing = false; }, {nullptr, no_jobs, nullptr});
  const CodeletPtr job = fakeCodelet("job");
  const CodeletPtr batch = fakeCodelet("batch");
  runtime.setTimes(batch, {20e-3, 1.0, 20e-3});
  runtime.setTimes(job, {1e-3, 1e-3, 3e-3});
  ASSERT_TRUE(runtime->admit(streamOf(job, 10ms, 0ms)).admitted());
  ASSERT_EQ("fake0", runtime->streams()[0].unit);
  runtime->submit(requestOf(batch, "fake2"));
  runtime.device(2).awaitStart();
  const TaskHandle queued = runtime->submit(requestOf(batch));
  EXPECT_EQ(1u, runtime->units()[2].queued);
  runtime->setUnitAvailable("fake0", false);
  EXPECT_EQ("fake2", runtime->streams()[0].unit) << "fake1 cannot run its jobs";
  EXPECT_NEAR(3e-3, runtime->streams()[0].wcet_s, 1e-12) << "by what is known of the new unit";
  EXPECT_EQ("batch", runtime.device(1).serve().codelet) << "what waited there would delay it";
  EXPECT_EQ("fake1", queued.wait().unit);
  EXPECT_EQ(1u, runtime.logged("now has its place on unit fake2"));
  runtime.device(2).finish();
}

TEST(RuntimeStreams, WithoutAPlaceGetOneWhenAUnitComesBack)
{
  FakeRuntime runtime(1);
  const CodeletPtr job = fakeCodelet("job");
  const Admission stream = runtime->admit(streamOf(job, 10ms, 1ms));
  runtime->setUnitAvailable("fake0", false);
  EXPECT_EQ("", runtime->streams()[0].unit);
  EXPECT_EQ(1u, runtime.logged("has lost its place"));
  TaskRequest request = requestOf(job);
  request.stream = stream.id;
  EXPECT_EQ(Outcome::UNIT_FAILED, runtime->submit(request).wait().outcome);
  EXPECT_EQ(1u, runtime->streams()[0].missed) << "a job that cannot run is a miss";
  runtime->setUnitAvailable("fake0", true);
  EXPECT_EQ("fake0", runtime->streams()[0].unit);
  EXPECT_NEAR(9e-3, runtime->units()[0].blocking_budget_s, 1e-9);
}

TEST(RuntimeStreams, ShortTasksAreNotPiledUpBeyondWhatTheyStand)
{
  FakeRuntime runtime(1);
  const CodeletPtr tiny = fakeCodelet("tiny");
  runtime.setTimes(tiny, {80e-6});
  ASSERT_TRUE(runtime->admit(streamOf(fakeCodelet("job"), 1ms, 900us)).admitted());
  const TaskHandle first = runtime->submit(requestOf(tiny));
  const TaskHandle second = runtime->submit(requestOf(tiny));
  EXPECT_EQ(1u, runtime.device(0).running()) << "two of 80 us exceed the 100 us that are free";
  runtime.device(0).serve();
  runtime.device(0).serve();
  EXPECT_TRUE(second.wait().ok());
}

TEST(RuntimeStreams, UrgentTasksOfABatchDoNotWaitForItsPlan)
{
  FakeRuntime runtime(1, [](RuntimeOptions& options) { options.inter_core.budget = std::chrono::hours(1); });
  const std::vector<TaskHandle> tasks = runtime->submitBatch({named("plain"), named("urgent", 10s)});
  EXPECT_EQ("urgent", runtime.device(0).serve().codelet);
  EXPECT_EQ("plain", runtime.device(0).serve().codelet);
}

}  // namespace
}  // namespace pi_runtime
