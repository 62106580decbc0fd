// Tasks that depend on each other.
#include <gtest/gtest.h>

#include <random>
#include <thread>

#include "core/fake_executor.h"

namespace pi_runtime
{
namespace
{

using Edge = GraphRequest::Edge;

/// Native functions that note when each node begins and ends, on two CPU units.
class RuntimeGraphs : public testing::Test
{
protected:
  struct Times
  {
    std::atomic<int> begin{-1};
    std::atomic<int> end{-1};
  };

  static RuntimeOptions nativeOptions()
  {
    RuntimeOptions options = FakeRuntime::fakeOptions();
    options.native = true;
    return options;
  }

  TaskRequest node(Times* times)
  {
    Codelet codelet;
    codelet.name = "node";
    codelet.native = {{[this](const NativeCall& call)
                       {
                         Times* const own = call.value<Times*>(0);
                         own->begin = clock_++;
                         own->end = clock_++;
                       }}};
    if (!codelet_)
    {
      codelet_ = makeCodelet(codelet);
    }
    TaskRequest request = requestOf(codelet_);
    request.arguments = {Argument::value(times)};
    return request;
  }

  /// Runs a random graph and looks at the order.
  void runRandomGraph(Runtime& runtime, std::mt19937& random, uint32_t nodes, bool barrier)
  {
    std::vector<Times> times(nodes);
    GraphRequest graph;
    for (uint32_t i = 0; i < nodes; ++i)
    {
      graph.tasks.push_back(node(&times[i]));
    }
    std::vector<uint32_t> level(nodes, 0);
    for (uint32_t to = 1; to < nodes; ++to)
    {
      for (uint32_t from = 0; from < to; ++from)
      {
        if (random() % nodes < 2)
        {
          graph.edges.push_back({from, to, 0.0});
          level[to] = std::max(level[to], level[from] + 1);
        }
      }
    }
    const std::vector<Edge> edges = graph.edges;
    for (const TaskHandle& task : runtime.submitGraph(std::move(graph)))
    {
      ASSERT_TRUE(task.waitFor(LONG_WAIT));
      EXPECT_TRUE(task.wait().ok()) << task.wait().message;
    }
    for (const Edge& edge : edges)
    {
      EXPECT_LT(times[edge.from].end, times[edge.to].begin) << edge.from << " -> " << edge.to;
    }
    for (uint32_t a = 0; barrier && a < nodes; ++a)
    {
      for (uint32_t b = 0; b < nodes; ++b)
      {
        if (level[a] < level[b])
        {
          EXPECT_LT(times[a].end, times[b].begin) << "levels " << level[a] << " and " << level[b];
        }
      }
    }
  }

  std::atomic<int> clock_{0};
  CodeletPtr codelet_;
};

GraphRequest chainOf(const CodeletPtr& codelet, uint32_t nodes)
{
  GraphRequest graph;
  for (uint32_t i = 0; i < nodes; ++i)
  {
    graph.tasks.push_back(requestOf(codelet));
    if (i > 0)
    {
      graph.edges.push_back({i - 1, i, 0.0});
    }
  }
  return graph;
}

TEST_F(RuntimeGraphs, RespectTheirEdgesUnderEveryPolicy)
{
  std::mt19937 random(7);
  for (const InnerCorePolicy policy : {InnerCorePolicy::HEFT, InnerCorePolicy::LOOKAHEAD, InnerCorePolicy::LEVELS})
  {
    RuntimeOptions options = nativeOptions();
    options.inner_core.policy = policy;
    options.inner_core.level_barrier = true;
    Runtime runtime(options);
    for (int round = 0; round < 20; ++round)
    {
      runRandomGraph(runtime, random, 1 + random() % 40, policy == InnerCorePolicy::LEVELS);
    }
  }
}

TEST_F(RuntimeGraphs, AnEmptyGraphIsNoError)
{
  Runtime runtime(nativeOptions());
  EXPECT_TRUE(runtime.submitGraph(GraphRequest()).empty());
}

TEST_F(RuntimeGraphs, ACycleIsRefusedAndNothingIsSubmitted)
{
  Runtime runtime(nativeOptions());
  Times times;
  GraphRequest graph;
  graph.tasks = {node(&times), node(&times)};
  graph.edges = {{0, 1, 0.0}, {1, 0, 0.0}};
  EXPECT_THROW(runtime.submitGraph(graph), std::invalid_argument);
  graph.edges = {{0, 5, 0.0}};
  EXPECT_THROW(runtime.submitGraph(graph), std::invalid_argument);
  EXPECT_EQ(0u, runtime.statistics().submitted);
}

TEST_F(RuntimeGraphs, AFailureCancelsWhatDependsOnItAndNothingElse)
{
  FakeRuntime runtime(1);
  runtime.device(0).serveAll(
      [](const FakeDevice::Start& start)
      {
        ExecutionReport report;
        report.outcome = start.codelet == "bad" ? Outcome::EXECUTION_FAILED : Outcome::OK;
        return report;
      });
  GraphRequest graph;
  graph.tasks.assign(5, requestOf(fakeCodelet("good")));
  graph.tasks[1] = requestOf(fakeCodelet("bad"));
  graph.edges = {{0, 1, 0.0}, {1, 2, 0.0}, {0, 3, 0.0}};
  const std::vector<TaskHandle> tasks = runtime->submitGraph(std::move(graph));
  const Outcome expected[] = {Outcome::OK, Outcome::EXECUTION_FAILED, Outcome::CANCELLED, Outcome::OK, Outcome::OK};
  for (size_t i = 0; i < tasks.size(); ++i)
  {
    ASSERT_TRUE(tasks[i].waitFor(LONG_WAIT));
    EXPECT_EQ(expected[i], tasks[i].wait().outcome) << i;
  }
  EXPECT_NE(std::string::npos, tasks[2].wait().message.find("sub-task 1")) << tasks[2].wait().message;
}

TEST_F(RuntimeGraphs, AFailureAtTheHeadOfALongChainEndsItWithoutRecursion)
{
  constexpr uint32_t NODES = 20000;
  FakeRuntime runtime(1);
  std::atomic<uint32_t> done{0};
  GraphRequest graph = chainOf(fakeCodelet("node"), NODES);
  for (TaskRequest& task : graph.tasks)
  {
    task.done = [&done](const TaskResult&) { ++done; };
  }
  const std::vector<TaskHandle> tasks = runtime->submitGraph(std::move(graph));
  runtime.device(0).fail(Outcome::EXECUTION_FAILED, "broken");
  for (const TaskHandle& task : tasks)
  {
    ASSERT_TRUE(task.waitFor(LONG_WAIT));
  }
  EXPECT_EQ(Outcome::CANCELLED, tasks.back().wait().outcome);
  runtime.stop();
  EXPECT_EQ(NODES, done);
}

TEST_F(RuntimeGraphs, ALongChainRunsToItsEnd)
{
  constexpr uint32_t NODES = 20000;
  FakeRuntime runtime(1);
  runtime.device(0).serveAll([](const FakeDevice::Start&) { return ExecutionReport(); });
  const std::vector<TaskHandle> tasks = runtime->submitGraph(chainOf(fakeCodelet("node"), NODES));
  EXPECT_TRUE(tasks.back().waitFor(LONG_WAIT));
  EXPECT_TRUE(tasks.back().wait().ok());
}

TEST_F(RuntimeGraphs, ARefusedNodeCancelsItsSuccessorsOnly)
{
  const auto only_fast = [](const Codelet& codelet) { return codelet.name == "fast"; };
  FakeRuntime runtime(1, nullptr, {only_fast});
  GraphRequest graph;
  graph.tasks = {requestOf(fakeCodelet("odd")), requestOf(fakeCodelet("fast")), requestOf(fakeCodelet("fast"))};
  graph.tasks.push_back(TaskRequest());  // no codelet
  graph.tasks.push_back(requestOf(fakeCodelet("fast")));
  graph.edges = {{0, 1, 0.0}, {3, 4, 0.0}};
  const std::vector<TaskHandle> tasks = runtime->submitGraph(std::move(graph));
  runtime.device(0).serve();
  const Outcome expected[] = {Outcome::REFUSED, Outcome::CANCELLED, Outcome::OK, Outcome::REFUSED, Outcome::CANCELLED};
  for (size_t i = 0; i < tasks.size(); ++i)
  {
    EXPECT_TRUE(tasks[i].waitFor(LONG_WAIT));
    EXPECT_EQ(expected[i], tasks[i].wait().outcome) << i << " " << tasks[i].wait().message;
  }
}

TEST_F(RuntimeGraphs, ANodeCanBeCancelledBeforeItsPredecessorsEnd)
{
  FakeRuntime runtime(1);
  const std::vector<TaskHandle> tasks = runtime->submitGraph(chainOf(fakeCodelet("node"), 4));
  tasks[2].cancel();
  EXPECT_EQ(Outcome::CANCELLED, tasks[2].wait().outcome);
  EXPECT_EQ(Outcome::CANCELLED, tasks[3].wait().outcome);
  runtime.device(0).serve();
  runtime.device(0).serve();
  EXPECT_TRUE(tasks[1].wait().ok());
}

TEST_F(RuntimeGraphs, ACancelledNodeDoesNotHoldTheBarrier)
{
  FakeRuntime runtime(1,
                      [](RuntimeOptions& options)
                      {
                        options.inner_core.policy = InnerCorePolicy::LEVELS;
                        options.inner_core.level_barrier = true;
                      });
  GraphRequest graph;
  graph.tasks.assign(3, requestOf(fakeCodelet("node")));
  graph.tasks[0].priority = 1;  // the first to run
  graph.edges = {{0, 2, 0.0}};
  const std::vector<TaskHandle> tasks = runtime->submitGraph(std::move(graph));
  tasks[1].cancel();
  runtime.device(0).serve();
  runtime.device(0).serve();
  EXPECT_TRUE(tasks[0].wait().ok());
  EXPECT_EQ(Outcome::CANCELLED, tasks[1].wait().outcome);
  EXPECT_TRUE(tasks[2].wait().ok());
}

TEST_F(RuntimeGraphs, TheDestructorEndsNodesThatOnlyTheBarrierHolds)
{
  FakeRuntime runtime(2,
                      [](RuntimeOptions& options)
                      {
                        options.inner_core.policy = InnerCorePolicy::LEVELS;
                        options.inner_core.level_barrier = true;
                      });
  GraphRequest graph;
  graph.tasks = {requestOf(fakeCodelet("a"), "fake0"), requestOf(fakeCodelet("b"), "fake1"),
                 requestOf(fakeCodelet("c"))};
  graph.edges = {{0, 2, 0.0}};
  const std::vector<TaskHandle> tasks = runtime->submitGraph(std::move(graph));
  runtime.device(0).serve();  // its successor now waits for the other one of the level
  runtime.device(1).awaitStart();
  std::thread finisher(
      [&]
      {
        while (!runtime.device(1).cancelled())  // the only trace that the destructor leaves
        {
          std::this_thread::yield();
        }
        runtime.device(1).finish();
      });
  runtime.stop();
  finisher.join();
  EXPECT_TRUE(tasks[0].wait().ok());
  EXPECT_EQ(Outcome::CANCELLED, tasks[1].wait().outcome);
  ASSERT_TRUE(tasks[2].ready());
  EXPECT_EQ(Outcome::SHUT_DOWN, tasks[2].wait().outcome);
}

TEST_F(RuntimeGraphs, GiveTheirMemoryBackWhenTheyHaveEnded)
{
  FakeRuntime runtime(1);
  runtime.device(0).serveAll([](const FakeDevice::Start&) { return ExecutionReport(); });
  auto owned = std::make_shared<int>(0);
  const std::weak_ptr<int> alive = owned;
  GraphRequest graph = chainOf(fakeCodelet("node"), 3);
  graph.tasks[0].arguments = {Argument::in(Buffer::wrap(owned.get(), sizeof(int), owned))};
  owned.reset();
  {
    const std::vector<TaskHandle> tasks = runtime->submitGraph(std::move(graph));
    ASSERT_TRUE(tasks.back().waitFor(LONG_WAIT));
    EXPECT_FALSE(alive.expired()) << "held by its handle";
  }
  runtime.stop();
  EXPECT_TRUE(alive.expired());
}

TEST_F(RuntimeGraphs, PlannedNodesMoveWhenTheirUnitFails)
{
  FakeRuntime runtime(2);
  const CodeletPtr codelet = fakeCodelet("node");
  runtime.setTimes(codelet, {1e-3, 50e-3});
  const std::vector<TaskHandle> tasks = runtime->submitGraph(chainOf(codelet, 3));
  runtime.device(0).serve();
  runtime.device(0).awaitStart();
  runtime.device(0).fail(Outcome::UNIT_FAILED, "gone");
  runtime.device(1).serve();
  runtime.device(1).serve();
  EXPECT_TRUE(tasks[2].wait().ok());
  EXPECT_EQ("fake1", tasks[2].wait().unit);
}

}  // namespace
}  // namespace pi_runtime
