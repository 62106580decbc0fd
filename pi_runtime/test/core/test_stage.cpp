// Heavy stages of services: run once whatever happens, measured, and with reserved capacity where there is some.
#include <gtest/gtest.h>
#include <pi_runtime/stage.h>

#include <ctime>
#include <thread>

#include "core/fake_executor.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;

class StageTest : public testing::Test
{
protected:
  static RuntimeOptions oneUnit()
  {
    RuntimeOptions options = FakeRuntime::fakeOptions();
    options.native = true;
    options.cpu_units = {1};
    return options;
  }
  StreamStatus streamOf(const std::string& name) const
  {
    for (const StreamStatus& stream : runtime_->streams())
    {
      if (stream.name == name)
      {
        return stream;
      }
    }
    ADD_FAILURE() << "there is no stream " << name;
    return StreamStatus();
  }
  /// Uses the processor for so long, whoever else wants it.
  static void work(std::chrono::nanoseconds time)
  {
    const auto cpu = []
    {
      timespec now{};
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
      return std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec);
    };
    const auto end = cpu() + time;
    while (cpu() < end)
    {
    }
  }
  /// A task that keeps the unit until the end of the object.
  class Blocker
  {
  public:
    explicit Blocker(Runtime* runtime)
    {
      Codelet codelet;
      codelet.name = "blocker";
      codelet.native = {{[this](const NativeCall&)
                         {
                           begun_.set();
                           go_on_.wait();
                         }}};
      task_ = runtime->submit(requestOf(makeCodelet(std::move(codelet))));
      EXPECT_TRUE(begun_.wait());
    }
    ~Blocker()
    {
      go_on_.set();
      task_.wait();
    }

  private:
    Event begun_;
    Event go_on_;
    TaskHandle task_;
  };

  const std::shared_ptr<Runtime> runtime_ = std::make_shared<Runtime>(oneUnit());
};

TEST_F(StageTest, IsAPlainCallWithoutARuntime)
{
  Stage stage(nullptr, {"work"});
  std::thread::id thread;
  stage.run([&] { thread = std::this_thread::get_id(); });
  EXPECT_EQ(std::this_thread::get_id(), thread);
  EXPECT_EQ("not used: plain calls", stage.status().text());
  EXPECT_THROW(stage.run([] { throw std::range_error("broken"); }), std::range_error);
}

TEST_F(StageTest, RunsOnTheUnitAndPassesExceptionsThrough)
{
  Stage stage(runtime_, {"work", 1s, 0ms, 1ms});
  std::thread::id thread;
  stage.run([&] { thread = std::this_thread::get_id(); });
  EXPECT_NE(std::this_thread::get_id(), thread);
  EXPECT_EQ("cpu0", stage.status().ran_on);
  EXPECT_THROW(stage.run([] { throw std::range_error("broken"); }), std::range_error);
  int runs = 0;
  stage.run([&] { ++runs; });
  EXPECT_EQ(1, runs) << "an exception does not stop the stage";
  EXPECT_EQ(3u, stage.status().stream.jobs);
  EXPECT_EQ(0u, stage.status().plain);
}

TEST_F(StageTest, RefusesANameThatIsNoWord)
{
  EXPECT_THROW(Stage(runtime_, {""}), std::invalid_argument);
  EXPECT_THROW(Stage(runtime_, {"front end"}), std::invalid_argument);
  EXPECT_THROW(Stage(runtime_, {"front_end", -1ms}), std::invalid_argument);
}

TEST_F(StageTest, ReservesWhatItMeasuredAndMoreWhenRunsTakeLonger)
{
  Stage stage(runtime_, {"work", 1s});
  std::thread::id thread;
  stage.run([&] { thread = std::this_thread::get_id(); });
  EXPECT_EQ(std::this_thread::get_id(), thread) << "without capacity it would wait behind everything";
  EXPECT_EQ(0u, stage.status().plain) << "it was not late";
  EXPECT_EQ("", stage.status().stream.unit);
  EXPECT_EQ("nothing reserved: its times are measured first", stage.status().text());
  for (int run = 0; run < 10; ++run)
  {
    stage.run([] { work(2ms); });
  }
  StreamStatus stream = stage.status().stream;
  EXPECT_EQ("cpu0", stream.unit);
  EXPECT_GE(stream.wcet_s, 2e-3);
  EXPECT_DOUBLE_EQ(1.0, stream.period_s);
  EXPECT_EQ(3u, stream.jobs) << "eight runs are measured first";
  const double before_s = stream.wcet_s;
  stage.run([before_s] { work(std::chrono::nanoseconds(static_cast<int64_t>(2e9 * before_s))); });
  stream = stage.status().stream;
  EXPECT_GE(stream.wcet_s, 2.0 * before_s);
  EXPECT_EQ("cpu0", stream.unit);
  EXPECT_EQ(4u, stream.jobs) << "keeps its statistics";
}

TEST_F(StageTest, MeasuresItsPeriod)
{
  Stage stage(runtime_, {"work"});
  for (int run = 0; run < 16; ++run)
  {
    stage.run([] {});
    std::this_thread::sleep_for(20ms);  // the period that is to be measured
  }
  const StreamStatus stream = stage.status().stream;
  EXPECT_EQ("cpu0", stream.unit) << stage.status().text();
  EXPECT_GE(stream.period_s, 20e-3);
  EXPECT_EQ(stream.period_s, stream.deadline_s);
}

TEST_F(StageTest, SaysWhichFigureIsMissing)
{
  const Stage first(runtime_, {"first", 10ms, 0ms, 6ms});
  Stage second(runtime_, {"second", 10ms, 0ms, 4ms});
  EXPECT_EQ("6 ms of every 10 ms reserved on cpu0", first.status().text());
  const std::string text = second.status().text();
  EXPECT_NE(std::string::npos, text.find("nothing reserved: cpu0 would be used to 100 %")) << text;
  EXPECT_NE(std::string::npos, text.find(" would fit, instead of 10 ms")) << text;
  int runs = 0;
  second.run([&] { ++runs; });
  EXPECT_EQ(1, runs);
}

TEST_F(StageTest, ThePeriodThatWouldFitDoes)
{
  const Stage first(runtime_, {"first", 10ms, 0ms, 4ms});
  StreamRequest request;
  request.name = "second";
  request.codelet = fakeCodelet("second", true);
  request.period = 10ms;
  request.wcet = 8ms;
  const Admission refused = runtime_->admit(request);
  EXPECT_FALSE(refused.admitted());
  EXPECT_GT(refused.shortest_period, 13ms);
  request.period = refused.shortest_period;
  EXPECT_TRUE(runtime_->admit(request).admitted());
}

TEST_F(StageTest, KeepsWhatItHasIfMoreDoesNotFit)
{
  StreamRequest request;
  request.name = "work";
  request.codelet = fakeCodelet("work");
  request.period = 10ms;
  request.wcet = 4ms;
  const StreamId id = runtime_->admit(request).id;
  request.wcet = 12ms;
  const Admission more = runtime_->amend(id, request);
  EXPECT_EQ("cpu0", more.unit);
  EXPECT_NE(std::string::npos, more.reason.find("it keeps 4 ms of every 10 ms")) << more.reason;
  EXPECT_DOUBLE_EQ(4e-3, streamOf("work").wcet_s);
  request.wcet = 5ms;
  EXPECT_EQ("", runtime_->amend(id, request).reason);
  EXPECT_DOUBLE_EQ(5e-3, streamOf("work").wcet_s);
  runtime_->retire(id);
  EXPECT_NE(std::string::npos, runtime_->amend(id, request).reason.find("is not admitted"));
}

TEST_F(StageTest, IsDoneOnceByTheCallerIfNoUnitBeginsByTheDeadline)
{
  Stage stage(runtime_, {"work", 1s, 30ms, 1ms});
  int runs = 0;
  std::thread::id thread;
  {
    const Blocker blocker(runtime_.get());
    stage.run(
        [&]
        {
          ++runs;
          thread = std::this_thread::get_id();
        });
    EXPECT_EQ(std::this_thread::get_id(), thread);
    EXPECT_EQ(1u, stage.status().plain);
  }
  stage.run([&] { ++runs; });
  EXPECT_EQ(2, runs);
  EXPECT_EQ(1u, stage.status().stream.missed);
}

TEST_F(StageTest, IsDoneByTheCallerIfTheUnitIsOut)
{
  Stage stage(runtime_, {"work", 1s, 30ms, 1ms});
  runtime_->setUnitAvailable("cpu0", false);
  int runs = 0;
  stage.run([&] { ++runs; });
  EXPECT_EQ(1, runs);
  EXPECT_EQ(1u, stage.status().plain);
}

TEST_F(StageTest, LetsMoreUrgentWorkInWhereItYields)
{
  Stage stage(runtime_, {"long", 10s, 0ms, 50ms});
  std::string order;
  Codelet urgent;
  urgent.name = "urgent";
  urgent.native = {{[&](const NativeCall&) { order += "urgent "; }}};
  TaskRequest request = requestOf(makeCodelet(std::move(urgent)));
  request.deadline = 1ms;
  TaskHandle handle;
  stage.run(
      [&]
      {
        for (int part = 0; part < 3; ++part)
        {
          order += "part" + std::to_string(part) + " ";
          work(2ms);
          if (part == 0)
          {
            handle = runtime_->submit(request);
          }
          Stage::yield();
        }
      });
  handle.wait();
  EXPECT_EQ("part0 urgent part1 part2 ", order);
  EXPECT_GE(stage.status().piece_s, 2e-3);
  EXPECT_LT(stage.status().piece_s, 6e-3) << "a part, not the run";
  EXPECT_GE(stage.status().cpu_s, 6e-3);
  Stage::yield();  // outside of runs it does nothing
}

TEST_F(StageTest, YieldsToStagesOfTheSameProcessAndToNoneThatIsLater)
{
  Stage outer(runtime_, {"outer", 10s, 5s, 50ms});
  Stage urgent(runtime_, {"urgent", 10s, 1s, 1ms});
  Stage later(runtime_, {"later", 10s, 8s, 1ms});
  std::string order;
  std::vector<std::thread> callers;
  outer.run(
      [&]
      {
        callers.emplace_back([&] { later.run([&] { order += "later "; }); });
        callers.emplace_back([&] { urgent.run([&] { order += "urgent "; }); });
        while (runtime_->units()[0].queued < 2)
        {
          std::this_thread::yield();
        }
        work(1ms);
        Stage::yield();
        order += "outer ";
      });
  for (std::thread& caller : callers)
  {
    caller.join();
  }
  EXPECT_EQ("urgent outer later ", order);
  EXPECT_EQ(0u, urgent.status().plain + later.status().plain);
}

TEST_F(StageTest, ARunWithinARunIsAPlainCall)
{
  Stage outer(runtime_, {"outer"});
  Stage inner(runtime_, {"inner"});
  std::thread::id threads[2];
  outer.run(
      [&]
      {
        threads[0] = std::this_thread::get_id();
        inner.run([&] { threads[1] = std::this_thread::get_id(); });
      });
  EXPECT_EQ(threads[0], threads[1]);
  EXPECT_EQ(0u, inner.status().stream.jobs);
}

TEST_F(StageTest, WithoutCapacityRunsBehindThoseThatHaveSome)
{
  Stage without(runtime_, {"without", 10ms, 5s, 20ms});
  StreamRequest with;
  with.name = "with";
  with.period = 20s;
  with.wcet = 1ms;
  std::string order;
  Codelet codelet;
  codelet.name = "with";
  codelet.native = {{[&](const NativeCall&) { order += "with "; }}};
  with.codelet = makeCodelet(std::move(codelet));
  TaskRequest job = requestOf(with.codelet);
  job.stream = runtime_->admit(with).id;
  ASSERT_NE(NO_STREAM, job.stream);
  auto blocker = std::make_unique<Blocker>(runtime_.get());
  std::thread caller([&] { without.run([&] { order += "without "; }); });
  while (runtime_->units()[0].queued < 1)
  {
    std::this_thread::yield();
  }
  const TaskHandle handle = runtime_->submit(job);
  blocker.reset();
  caller.join();
  handle.wait();
  EXPECT_EQ("with without ", order);
}

TEST_F(StageTest, GivesItsCapacityBack)
{
  {
    const Stage stage(runtime_, {"work", 10ms, 0ms, 4ms});
    EXPECT_EQ(1u, runtime_->streams().size());
  }
  EXPECT_TRUE(runtime_->streams().empty());
}

}  // namespace
}  // namespace pi_runtime
