// Runtimes of several processes, and of one, that share their units by way of the arbiter.
#include <gtest/gtest.h>

#include <atomic>

#include <pi_runtime/stage.h>

#include "core/fake_executor.h"
#include "units/forked_users.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;

constexpr int TASKS = 300;

struct Use
{
  std::atomic<int> inside{0};
  std::atomic<int> intruders{0};
  std::atomic<int> runs{0};
};

class RuntimeProcesses : public UnitTest
{
protected:
  RuntimeOptions sharedOptions()
  {
    RuntimeOptions options = FakeRuntime::fakeOptions();
    options.native = true;
    options.cpu_units = {1};
    options.arbitration = true;
    options.arbitration_folder = folder_;
    return options;
  }

  /// Notes if two tasks are on the unit at once.
  static CodeletPtr watching(Use* use)
  {
    Codelet codelet;
    codelet.name = "watch";
    codelet.native = {{[use](const NativeCall&)
                       {
                         use->intruders += use->inside.fetch_add(1) != 0 ? 1 : 0;
                         for (int i = 0; i < 100; ++i)
                         {
                           std::this_thread::yield();
                         }
                         --use->inside;
                         ++use->runs;
                       }}};
    return makeCodelet(std::move(codelet));
  }

  static void useUp(Runtime& runtime, const CodeletPtr& codelet)
  {
    std::vector<TaskHandle> tasks;
    for (int i = 0; i < TASKS; ++i)
    {
      TaskRequest request = requestOf(codelet);
      if (i % 5 == 0)
      {
        request.deadline = 1ms;
      }
      tasks.push_back(runtime.submit(request));
      if (i % 16 == 0)
      {
        tasks.back().waitFor(LONG);
      }
    }
    for (const TaskHandle& task : tasks)
    {
      EXPECT_TRUE(task.waitFor(LONG));
      EXPECT_TRUE(task.wait().ok()) << task.wait().message;
    }
  }
};

TEST_F(RuntimeProcesses, UseAUnitByTurns)
{
  Shared<Use> use;
  const auto run = [&](Child& test)
  {
    Runtime runtime(sharedOptions());
    test.say('b');
    test.hear();
    useUp(runtime, watching(use.operator->()));
    test.say('e');
  };
  Child first(run);
  Child second(run);
  ASSERT_EQ('b', first.hear());
  ASSERT_EQ('b', second.hear());
  first.say('g');
  second.say('g');
  EXPECT_EQ('e', first.hear());
  EXPECT_EQ('e', second.hear());
  EXPECT_EQ(0, first.reap());
  EXPECT_EQ(0, second.reap());
  EXPECT_EQ(0, use->intruders);
  EXPECT_EQ(2 * TASKS, use->runs);
}

TEST_F(RuntimeProcesses, TwoRuntimesOfOneProcessDoSoToo)
{
  Use use;
  Runtime first(sharedOptions());
  Runtime second(sharedOptions());
  const CodeletPtr codelet = watching(&use);
  std::thread other([&] { useUp(first, codelet); });
  useUp(second, codelet);
  other.join();
  EXPECT_EQ(0, use.intruders);
  EXPECT_EQ(2 * TASKS, use.runs);
}

TEST_F(RuntimeProcesses, AKilledProcessDoesNotKeepTheUnit)
{
  Shared<Use> use;
  Child victim(
      [&](Child& test)
      {
        Runtime runtime(sharedOptions());
        Codelet codelet;
        codelet.name = "hold";
        codelet.native = {{[&](const NativeCall&)
                           {
                             test.say('h');
                             test.hear();
                           }}};
        runtime.submit(requestOf(makeCodelet(std::move(codelet)))).wait();
      });
  ASSERT_EQ('h', victim.hear());
  Runtime runtime(sharedOptions());
  const TaskHandle task = runtime.submit(requestOf(watching(use.operator->())));
  EXPECT_FALSE(task.ready());
  victim.killAndLeaveZombie();
  EXPECT_TRUE(task.waitFor(LONG));
  EXPECT_TRUE(task.wait().ok());
}

TEST_F(RuntimeProcesses, KnowFromTheStartWhatStreamsOfOthersStand)
{
  Child other(
      [&](Child& test)
      {
        Runtime runtime(sharedOptions());
        StreamRequest stream;
        stream.codelet = fakeCodelet("job");
        stream.period = 10ms;
        stream.wcet = 2ms;
        test.say(runtime.admit(stream).admitted() ? 'a' : 'r');
        test.hear();
      });
  ASSERT_EQ('a', other.hear());
  Runtime runtime(sharedOptions());
  EXPECT_NEAR(8e-3, runtime.units()[0].blocking_budget_s, 1e-9);
  StreamRequest stream;
  stream.codelet = fakeCodelet("long");
  stream.period = 1s;
  stream.wcet = 20ms;
  EXPECT_EQ("cpu0 must not be held longer than 8 ms for the streams of other processes", runtime.admit(stream).reason);
  other.say('e');
  EXPECT_EQ(0, other.reap());
}

TEST_F(RuntimeProcesses, SeeAndCountTheStreamsOfOthers)
{
  Child other(
      [&](Child& test)
      {
        const auto runtime = std::make_shared<Runtime>(sharedOptions());
        StreamRequest stream;
        stream.name = "front_end";
        stream.codelet = fakeCodelet("job");
        stream.period = 10ms;
        stream.wcet = 6ms;
        const Stage unreserved(runtime, {"detection"});
        test.say(runtime->admit(stream).admitted() ? 'a' : 'r');
        test.hear();
      });
  ASSERT_EQ('a', other.hear());
  Runtime runtime(sharedOptions());
  const std::vector<StreamStatus> streams = runtime.streams();
  ASSERT_EQ(2u, streams.size());
  EXPECT_EQ("detection", streams[0].name);
  EXPECT_EQ("", streams[0].unit);
  EXPECT_EQ("front_end", streams[1].name);
  EXPECT_EQ("cpu0", streams[1].unit);
  EXPECT_EQ(NO_STREAM, streams[1].id);
  EXPECT_EQ(other.pid(), streams[1].pid);
  EXPECT_DOUBLE_EQ(6e-3, streams[1].wcet_s);
  StreamRequest stream;
  stream.codelet = fakeCodelet("other");
  stream.period = 10ms;
  stream.wcet = 5ms;
  stream.deadline = 20ms;
  const Admission refused = runtime.admit(stream);
  EXPECT_NE(std::string::npos, refused.reason.find("cpu0 must not be held longer than 4 ms")) << refused.reason;
  stream.wcet = 3900us;
  EXPECT_TRUE(runtime.admit(stream).admitted());
  stream.wcet = 200us;
  EXPECT_NE(std::string::npos, runtime.admit(stream).reason.find("cpu0 would be used to 101 %"));
  other.say('e');
  EXPECT_EQ(0, other.reap());
  EXPECT_EQ(1u, runtime.streams().size());
}

TEST_F(RuntimeProcesses, TheDestructorDoesNotWaitForAUnitThatAnotherHolds)
{
  Use use;
  TaskHandle task;
  {
    Runtime blocker(sharedOptions());
    Event begun;
    Event go_on;
    Codelet codelet;
    codelet.name = "hold";
    codelet.native = {{[&](const NativeCall&)
                       {
                         begun.set();
                         go_on.wait();
                       }}};
    const TaskHandle held = blocker.submit(requestOf(makeCodelet(std::move(codelet))));
    ASSERT_TRUE(begun.wait());
    {
      Runtime runtime(sharedOptions());
      task = runtime.submit(requestOf(watching(&use)));
    }
    EXPECT_TRUE(task.ready());
    go_on.set();
  }
  EXPECT_EQ(Outcome::SHUT_DOWN, task.wait().outcome);
  EXPECT_EQ(0, use.runs);
}

}  // namespace
}  // namespace pi_runtime
