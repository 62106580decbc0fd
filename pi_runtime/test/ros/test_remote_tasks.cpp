// Tasks as messages, without a master: on one native unit, with codelets of the test's own.

#include <gtest/gtest.h>
#include "ros/remote_tasks.h"

#include <boost/make_shared.hpp>
#include <boost/weak_ptr.hpp>
#include <cmath>
#include <condition_variable>
#include <functional>
#include <future>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace pi_runtime
{
namespace
{

using Bytes = std::vector<uint8_t>;
constexpr size_t MEGABYTE = 1024 * 1024;

TaskArgument argument(uint8_t kind, const Bytes& data, const std::string& buffer = "", uint64_t bytes = 0)
{
  TaskArgument result;
  result.kind = kind;
  result.data = data;
  result.buffer = buffer;
  result.bytes = bytes;
  return result;
}
TaskArgument in(const Bytes& data, const std::string& buffer = "")
{
  return argument(TaskArgument::IN, data, buffer);
}
TaskArgument out(uint64_t bytes, const std::string& buffer = "")
{
  return argument(TaskArgument::OUT, {}, buffer, bytes);
}
TaskArgument inOut(const Bytes& data, const std::string& buffer = "")
{
  return argument(TaskArgument::IN_OUT, data, buffer);
}
TaskArgument value(uint8_t number)
{
  return argument(TaskArgument::VALUE, {number});
}

TaskPtr task(const std::string& codelet, const std::vector<TaskArgument>& arguments)
{
  const TaskPtr result = boost::make_shared<Task>();
  result->client_key = "key";
  result->codelet = codelet;
  result->arguments = arguments;
  return result;
}

GraphEdge edge(uint32_t predecessor, uint32_t successor)
{
  GraphEdge result;
  result.predecessor = predecessor;
  result.successor = successor;
  return result;
}

/// Holds the codelet "wait" until it is opened.
struct Gate
{
  std::mutex mutex;
  std::condition_variable changed;
  bool is_open = false;

  void open()
  {
    std::lock_guard<std::mutex> lock(mutex);
    is_open = true;
    changed.notify_all();
  }
  void wait(const NativeCall& call)
  {
    std::unique_lock<std::mutex> lock(mutex);
    // A cancellation notifies nobody: look for it now and then.
    while (!is_open && !call.cancelled())
    {
      changed.wait_for(lock, std::chrono::milliseconds(1));
    }
  }
};

class RemoteTasksTest : public testing::Test
{
protected:
  RemoteTasksTest() { restart(limits()); }
  ~RemoteTasksTest() override { gate_.open(); }

  static RemoteTasks::Limits limits() { return {8, MEGABYTE, 4, std::chrono::hours(1)}; }

  void restart(const RemoteTasks::Limits& limits)
  {
    if (!runtime_)
    {
      RuntimeOptions options;
      options.preemption = false;  // nothing of a batch delays a stream that interrupts it
      options.cpu_units = {1};
      options.opencl_cpu = options.opencl_gpu = false;
      options.arbitration = false;
      options.cache_folder.clear();
      runtime_ = std::make_shared<Runtime>(options);
      // "add": 0 in, 1 out or in/out of the same size, 2 value: 1 = 0 + 2, byte by byte
      add("add",
          [this](const NativeCall& call)
          {
            input_ = call.buffer<const uint8_t>(0);
            output_ = call.buffer<uint8_t>(1);
            for (size_t i = 0; i < call.bufferBytes(1); ++i)
            {
              output_[i] = static_cast<uint8_t>(input_[i] + call.value<uint8_t>(2));
            }
          });
      add("twice",
          [](const NativeCall& call)
          {
            for (size_t i = 0; i < call.bufferBytes(0); ++i)
            {
              call.buffer<uint8_t>(0)[i] *= 2;
            }
          });
      add("wait", [this](const NativeCall& call) { gate_.wait(call); });
      add("fail", [](const NativeCall&) { throw std::runtime_error("does not like it"); });
    }
    tasks_ = std::make_unique<RemoteTasks>(runtime_, &codelets_, &buffers_, limits);
  }

  void add(const std::string& name, NativeFunction function)
  {
    Codelet codelet;
    codelet.name = name;
    codelet.native = {NativeImplementation{std::move(function)}};
    codelets_.add({makeCodelet(codelet), "for this test", ""});
  }

  TaskReportConstPtr run(const TaskConstPtr& task)
  {
    std::promise<TaskReportConstPtr> promise;
    tasks_->run(task, [&promise](const TaskReportConstPtr& report) { promise.set_value(report); });
    return promise.get_future().get();
  }

  TaskReportConstPtr submitAndWait(const TaskConstPtr& task)
  {
    const RemoteTasks::EntryPtr entry = tasks_->submit(task);
    EXPECT_TRUE(tasks_->wait({entry}, std::chrono::nanoseconds(0)));
    return tasks_->query(entry->id).report;
  }

  template <typename Action>
  static std::string refusal(const Action& action)
  {
    try
    {
      action();
    }
    catch (const std::exception& error)
    {
      return error.what();
    }
    return "";
  }

  Gate gate_;
  const uint8_t* input_ = nullptr;  ///< where the last "add" worked
  uint8_t* output_ = nullptr;
  CodeletRegistry codelets_;
  KeptBuffers buffers_{MEGABYTE};
  std::shared_ptr<Runtime> runtime_;
  std::unique_ptr<RemoteTasks> tasks_;
};

TEST_F(RemoteTasksTest, WhatCannotRunIsRefusedInTheAnswerWithOneTextPerCause)
{
  const auto refusal = [this](const std::function<void(Task&)>& spoil)
  {
    const TaskPtr bad = task("add", {in({1}), out(1), value(1)});
    spoil(*bad);
    try
    {
      tasks_->submit(bad);
    }
    catch (const std::exception& error)
    {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_EQ("there is no unit \"gpu9\", there are cpu0", refusal([](Task& bad) { bad.unit = "gpu9"; }));
  EXPECT_EQ("size = nan of codelet add, must be finite and at least 0 (0: the range)",
            refusal([](Task& bad) { bad.size = std::nan(""); }));
  EXPECT_EQ("size = -1.000000 of codelet add, must be finite and at least 0 (0: the range)",
            refusal([](Task& bad) { bad.size = -1.0; }));
  EXPECT_EQ("stream = 77 of codelet add is not admitted; admit it first, or leave it 0",
            refusal([](Task& bad) { bad.stream = 77; }));
  EXPECT_EQ("accepted", refusal([](Task&) {}));
  const TaskPtr bad = task("add", {in({1}), out(1), value(1)});
  bad->unit = "gpu9";
  try
  {
    tasks_->submitGraph({task("add", {in({1}), out(1), value(1)}), bad}, {});
    ADD_FAILURE() << "accepted";
  }
  catch (const std::exception& error)
  {
    EXPECT_STREQ("task 1: there is no unit \"gpu9\", there are cpu0", error.what());
  }
  EXPECT_EQ(1u, runtime_->statistics().submitted) << "only the good one";
}

TEST_F(RemoteTasksTest, WhatWouldDelayStreamsIsRefusedInTheAnswer)
{
  StreamRequest stream;
  stream.name = "front_end";
  stream.codelet = codelets_.find("twice");
  stream.period = std::chrono::milliseconds(10);
  stream.wcet = std::chrono::milliseconds(9);
  ASSERT_TRUE(runtime_->admit(stream).admitted());
  runtime_->setEtcEntries({{"add", EtcTable::sizeBucket(1.0), "cpu0/native", {10, 0.005, 0.0}}});
  try
  {
    tasks_->submit(task("add", {in({1}), out(1), value(1)}));
    ADD_FAILURE() << "accepted";
  }
  catch (const std::exception& error)
  {
    EXPECT_EQ(0u, std::string(error.what()).find("it would delay admitted streams (cpu0 for 5 ms")) << error.what();
  }
}

TEST_F(RemoteTasksTest, RunATaskAndTellTheListener)
{
  const TaskReportConstPtr report = run(task("add", {in({1, 2, 3}), out(3), value(10)}));
  EXPECT_EQ("key", report->client_key);
  EXPECT_EQ(TaskReport::OK, report->outcome) << report->message;
  EXPECT_NE(0u, report->id);
  EXPECT_EQ("cpu0", report->unit);
  EXPECT_EQ("native", report->executor);
  EXPECT_LE(report->submitted_ns, report->started_ns);
  EXPECT_LE(report->started_ns, report->finished_ns);
  ASSERT_EQ(1u, report->outputs.size());
  EXPECT_EQ(TaskArgument::OUT, report->outputs[0].kind);
  EXPECT_EQ((Bytes{11, 12, 13}), report->outputs[0].data);
  EXPECT_EQ(0u, tasks_->keptReports()) << "the listener has it";
}

TEST_F(RemoteTasksTest, WorkInTheBytesOfTheMessagesThemselves)
{
  const TaskConstPtr message = task("add", {in(Bytes(5000, 1)), out(5000), value(1)});
  const TaskReportConstPtr report = run(message);
  EXPECT_EQ(message->arguments[0].data.data(), input_);
  EXPECT_EQ(report->outputs.at(0).data.data(), output_);
}

TEST_F(RemoteTasksTest, LetGoOfTheMessageWhenTheTaskHasEnded)
{
  TaskConstPtr message = task("add", {in(Bytes(5000, 1)), out(5000), value(1)});
  const boost::weak_ptr<const Task> watch = message;
  const RemoteTasks::EntryPtr entry = tasks_->submit(message);
  message.reset();
  ASSERT_TRUE(tasks_->wait({entry}, std::chrono::nanoseconds(0)));
  EXPECT_EQ(5000u, tasks_->memoryBytes()) << "the outputs";
  tasks_->handOver({entry});
  // The unit's thread may hold the task a moment longer.
  run(task("add", {in({1}), out(1), value(1)}));
  EXPECT_TRUE(watch.expired());
}

TEST_F(RemoteTasksTest, ChangeACopyOfInOutArguments)
{
  const TaskConstPtr message = task("twice", {inOut({1, 2, 3})});
  const TaskReportConstPtr report = run(message);
  ASSERT_EQ(1u, report->outputs.size());
  EXPECT_EQ(TaskArgument::IN_OUT, report->outputs[0].kind);
  EXPECT_EQ((Bytes{2, 4, 6}), report->outputs[0].data);
  EXPECT_EQ((Bytes{1, 2, 3}), message->arguments[0].data);
}

TEST_F(RemoteTasksTest, ChainTasksByKeptBuffers)
{
  TaskReportConstPtr report = run(task("add", {in({1, 2, 3}), out(3, "sum"), value(10)}));
  ASSERT_EQ(1u, report->outputs.size());
  EXPECT_EQ("sum", report->outputs[0].buffer);
  EXPECT_TRUE(report->outputs[0].data.empty());
  const uint8_t* const sum = output_;
  run(task("twice", {inOut({}, "sum")}));
  report = run(task("add", {in({}, "sum"), out(3), value(0)}));
  EXPECT_EQ(sum, input_);
  EXPECT_EQ((Bytes{22, 24, 26}), report->outputs.at(0).data);
  run(task("add", {in({}, "sum"), out(0, "sum2"), value(0)}));
  EXPECT_EQ(nullptr, buffers_.find("sum2")) << "nobody said how large it is";
}

TEST_F(RemoteTasksTest, UseAKeptBufferAgainIfItsSizeIsRight)
{
  run(task("add", {in({1, 2, 3}), out(3, "sum"), value(0)}));
  const BufferPtr first = buffers_.find("sum");
  run(task("add", {in({4, 5, 6}), out(3, "sum"), value(0)}));
  EXPECT_EQ(first, buffers_.find("sum"));
  run(task("add", {in({4, 5, 6}), out(0, "sum"), value(0)}));
  EXPECT_EQ(first, buffers_.find("sum"));
  run(task("add", {in({4, 5}), out(2, "sum"), value(0)}));
  EXPECT_EQ(2u, buffers_.find("sum")->bytes());
}

TEST_F(RemoteTasksTest, KeepDataThatComesWithAName)
{
  run(task("add", {in({1, 2, 3}, "input"), out(3), value(0)}));
  const TaskReportConstPtr report = run(task("add", {in({}, "input"), out(3), value(5)}));
  EXPECT_EQ((Bytes{6, 7, 8}), report->outputs.at(0).data);
}

TEST_F(RemoteTasksTest, TellTheListenerWhyATaskIsRefused)
{
  const TaskReportConstPtr report = run(task("subtract", {}));
  EXPECT_EQ(TaskReport::REFUSED, report->outcome);
  EXPECT_EQ("there is no codelet \"subtract\", there are add, fail, twice, wait", report->message);
  EXPECT_EQ("key", report->client_key);
  EXPECT_EQ(0u, report->id);
}

TEST_F(RemoteTasksTest, NameTheArgumentThatIsWrong)
{
  const auto problem = [this](const std::vector<TaskArgument>& arguments)
  { return run(task("add", arguments))->message; };
  EXPECT_EQ("add: argument 0 has no data; give data, or the name of a kept buffer", problem({in({})}));
  EXPECT_EQ("add: argument 0 there is no kept buffer \"x\"; give data, or submit the task that makes it first",
            problem({in({}, "x")}));
  EXPECT_EQ("add: argument 1 must have bytes, how many it is to get, and no data", problem({in({1}), out(0)}));
  EXPECT_EQ("add: argument 0 must have bytes, how many it is to get, and no data",
            problem({argument(TaskArgument::OUT, {1}, "", 1)}));
  EXPECT_EQ("add: argument 0 kind = 9, must be IN (0), OUT (1), IN_OUT (2) or VALUE (3)", problem({argument(9, {1})}));
  EXPECT_EQ("add: argument 0 is a value and cannot be kept as buffer \"x\"",
            problem({argument(TaskArgument::VALUE, {1}, "x")}));
  EXPECT_NE(std::string::npos, problem({argument(TaskArgument::VALUE, Bytes(33, 0))}).find("add: argument 0 "));
  EXPECT_EQ(0u, tasks_->memoryBytes());
}

TEST_F(RemoteTasksTest, RefuseNegativeDeadlines)
{
  const TaskPtr message = task("add", {in({1}), out(1), value(0)});
  message->deadline = ros::Duration(-1.0);
  EXPECT_EQ("deadline = -1.000000 s, must be at least 0", run(message)->message);
}

TEST_F(RemoteTasksTest, PassOnWhatTheRuntimeRefuses)
{
  const TaskPtr message = task("add", {in({1}), out(1), value(0)});
  message->unit = "gpu7";
  const TaskReportConstPtr report = run(message);
  EXPECT_EQ(TaskReport::REFUSED, report->outcome);
  EXPECT_NE(std::string::npos, report->message.find("gpu7")) << report->message;
  EXPECT_TRUE(report->outputs.empty());
}

TEST_F(RemoteTasksTest, ReportFailuresWithoutOutputs)
{
  const TaskReportConstPtr report = run(task("fail", {out(10)}));
  EXPECT_EQ(TaskReport::EXECUTION_FAILED, report->outcome);
  EXPECT_NE(std::string::npos, report->message.find("does not like it"));
  EXPECT_TRUE(report->outputs.empty());
}

TEST_F(RemoteTasksTest, KeepReportsUntilTheyAreHandedOver)
{
  const RemoteTasks::EntryPtr entry = tasks_->submit(task("add", {in({1}), out(1), value(1)}));
  ASSERT_TRUE(tasks_->wait({entry}, std::chrono::nanoseconds(0)));
  for (int time = 0; time < 2; ++time)
  {
    const RemoteTasks::Answer answer = tasks_->query(entry->id);
    ASSERT_TRUE(answer.known);
    ASSERT_NE(nullptr, answer.report);
    EXPECT_EQ((Bytes{2}), answer.report->outputs.at(0).data);
  }
  EXPECT_NE(nullptr, tasks_->handOver({entry}).at(0));
  EXPECT_FALSE(tasks_->query(entry->id).known);
  EXPECT_EQ(0u, tasks_->keptReports());
}

TEST_F(RemoteTasksTest, ForgetTheOldestReportsFirst)
{
  std::vector<RemoteTasks::EntryPtr> entries;
  for (int i = 0; i < 6; ++i)
  {
    entries.push_back(tasks_->submit(task("add", {in({1}), out(1), value(1)})));
    ASSERT_TRUE(tasks_->wait({entries.back()}, std::chrono::nanoseconds(0)));
  }
  EXPECT_EQ(4u, tasks_->keptReports());
  EXPECT_FALSE(tasks_->query(entries[1]->id).known);
  EXPECT_TRUE(tasks_->query(entries[2]->id).known);
  EXPECT_NE(nullptr, tasks_->handOver({entries[0]}).at(0)) << "whoever waited for it gets it nevertheless";
}

TEST_F(RemoteTasksTest, ForgetReportsAfterTheirTime)
{
  restart({8, MEGABYTE, 4, std::chrono::nanoseconds(1)});
  const RemoteTasks::EntryPtr entry = tasks_->submit(task("add", {in({1}), out(1), value(1)}));
  ASSERT_TRUE(tasks_->wait({entry}, std::chrono::nanoseconds(0)));
  tasks_->expire();
  EXPECT_EQ(0u, tasks_->keptReports());
  EXPECT_FALSE(tasks_->query(entry->id).known);
}

TEST_F(RemoteTasksTest, RefuseMoreThanTheyMayHaveOpen)
{
  restart({2, MEGABYTE, 4, std::chrono::hours(1)});
  const RemoteTasks::EntryPtr first = tasks_->submit(task("wait", {}));
  const RemoteTasks::EntryPtr second = tasks_->submit(task("wait", {}));
  EXPECT_EQ(2u, tasks_->openTasks());
  EXPECT_EQ("2 tasks are open, with 1 more there would be more than max_tasks = 2; wait for some",
            refusal([this] { tasks_->submit(task("wait", {})); }));
  EXPECT_EQ(2u, tasks_->openTasks());
  gate_.open();
  ASSERT_TRUE(tasks_->wait({first, second}, std::chrono::nanoseconds(0)));
  EXPECT_EQ(0u, tasks_->openTasks());
  EXPECT_EQ("", refusal([this] { tasks_->submit(task("wait", {})); }));
}

TEST_F(RemoteTasksTest, RefuseArgumentsThatNeedTooMuchMemory)
{
  const RemoteTasks::EntryPtr open = tasks_->submit(task("wait", {out(MEGABYTE - 100)}));
  const std::string problem = refusal([this] { tasks_->submit(task("wait", {out(101)})); });
  EXPECT_NE(std::string::npos, problem.find("need 101 bytes")) << problem;
  EXPECT_NE(std::string::npos, problem.find("max_task_memory_mb")) << problem;
  EXPECT_EQ("", refusal([this] { tasks_->submit(task("wait", {out(100)})); }));
  EXPECT_NE("", refusal([this] { tasks_->submit(task("wait", {out(UINT64_MAX)})); }));
}

TEST_F(RemoteTasksTest, GiveUpKeptReportsBeforeTheyRefuseMemory)
{
  gate_.open();
  RemoteTasks::EntryPtr kept = tasks_->submit(task("wait", {out(MEGABYTE)}));
  ASSERT_TRUE(tasks_->wait({kept}, std::chrono::nanoseconds(0)));
  EXPECT_EQ(MEGABYTE, tasks_->memoryBytes());
  const uint64_t id = kept->id;
  kept.reset();
  EXPECT_NE("", refusal([this] { tasks_->submit(task("wait", {out(MEGABYTE + 1)})); }));
  EXPECT_TRUE(tasks_->query(id).known) << "not for one that never fits";
  EXPECT_EQ("", refusal([this] { tasks_->submit(task("wait", {out(1)})); }));
  EXPECT_FALSE(tasks_->query(id).known);
}

TEST_F(RemoteTasksTest, CancelWhatHasNotBegun)
{
  const RemoteTasks::EntryPtr running = tasks_->submit(task("wait", {}));
  const RemoteTasks::EntryPtr queued = tasks_->submit(task("add", {in({1}), out(1), value(1)}));
  EXPECT_TRUE(tasks_->cancel(queued->id));
  ASSERT_TRUE(tasks_->wait({queued}, std::chrono::nanoseconds(0)));
  EXPECT_EQ(TaskReport::CANCELLED, tasks_->query(queued->id).report->outcome);
  EXPECT_FALSE(tasks_->cancel(queued->id));
  EXPECT_FALSE(tasks_->cancel(12345678));
  EXPECT_EQ(nullptr, tasks_->query(running->id).report);
}

TEST_F(RemoteTasksTest, WaitNoLongerThanTheTimeout)
{
  const RemoteTasks::EntryPtr entry = tasks_->submit(task("wait", {}));
  EXPECT_FALSE(tasks_->wait({entry}, std::chrono::milliseconds(1)));
  EXPECT_TRUE(tasks_->query(entry->id).known);
  EXPECT_EQ(nullptr, tasks_->handOver({entry}).at(0)) << "not ended";
  gate_.open();
  EXPECT_TRUE(tasks_->wait({entry}, std::chrono::hours(1)));
}

TEST_F(RemoteTasksTest, EndAllWaitsWhenTheyAreClosed)
{
  const RemoteTasks::EntryPtr entry = tasks_->submit(task("wait", {}));
  auto waiting = std::async(std::launch::async, [&] { return tasks_->wait({entry}, std::chrono::nanoseconds(0)); });
  tasks_->close();
  EXPECT_FALSE(waiting.get());
  EXPECT_EQ("the runtime node ends", refusal([this] { tasks_->submit(task("wait", {})); }));
}

TEST_F(RemoteTasksTest, CancelWhatIsOpenAtTheirEnd)
{
  const TaskPtr message = task("wait", {});
  tasks_->submit(message);
  tasks_->submit(message);
  tasks_.reset();
  EXPECT_EQ(0u, runtime_->units().at(0).queued);
  runtime_.reset();  // would wait for ever for a task that nobody has cancelled
}

TEST_F(RemoteTasksTest, RunGraphsInTheOrderOfTheirEdges)
{
  // (1 + 3) * 2 + 5, through one buffer
  const std::vector<TaskConstPtr> tasks = {task("add", {in({1}), out(1, "x"), value(3)}),
                                           task("add", {in({}, "x"), out(1), value(5)}),
                                           task("twice", {inOut({}, "x")})};
  const std::vector<RemoteTasks::EntryPtr> entries = tasks_->submitGraph(tasks, {edge(0, 2), edge(2, 1)});
  ASSERT_TRUE(tasks_->wait(entries, std::chrono::nanoseconds(0)));
  const std::vector<TaskReportConstPtr> reports = tasks_->handOver(entries);
  EXPECT_EQ((Bytes{13}), reports.at(1)->outputs.at(0).data);
  EXPECT_EQ(entries[1]->id, reports.at(1)->id);
}

TEST_F(RemoteTasksTest, RefuseGraphsAsAWhole)
{
  const std::vector<TaskConstPtr> tasks = {task("add", {in({1}), out(1, "x"), value(3)}), task("fial", {})};
  EXPECT_EQ("task 1: there is no codelet \"fial\", there are add, fail, twice, wait",
            refusal([&] { tasks_->submitGraph(tasks, {}); }));
  const std::vector<TaskConstPtr> loop = {tasks[0], tasks[0]};
  EXPECT_NE("", refusal([&] { tasks_->submitGraph(loop, {edge(0, 1), edge(1, 0)}); }));
  EXPECT_NE("", refusal([&] { tasks_->submitGraph(loop, {edge(0, 2)}); }));
  EXPECT_EQ("the graph has no tasks, must have at least one", refusal([&] { tasks_->submitGraph({}, {}); }));
  EXPECT_EQ(nullptr, buffers_.find("x"));
  EXPECT_EQ(0u, buffers_.bytes());
  EXPECT_EQ(0u, tasks_->openTasks());
  EXPECT_EQ(0u, tasks_->memoryBytes());
}

TEST_F(RemoteTasksTest, ServeManyThreads)
{
  constexpr int THREADS = 4;
  constexpr int TASKS = 100;
  restart({4 * THREADS, MEGABYTE, 4, std::chrono::hours(1)});
  gate_.open();
  std::vector<std::thread> threads;
  std::vector<int> wrong(THREADS, 0);
  for (int thread = 0; thread < THREADS; ++thread)
  {
    threads.emplace_back(
        [this, &wrong, thread]
        {
          const std::string buffer = "of thread " + std::to_string(thread);
          for (int i = 0; i < TASKS; ++i)
          {
            const auto number = static_cast<uint8_t>(i);
            const RemoteTasks::EntryPtr made = tasks_->submit(task("add", {in({number}), out(1, buffer), value(1)}));
            tasks_->cancel(tasks_->submit(task("wait", {}))->id);
            wrong[thread] += !tasks_->wait({made}, std::chrono::nanoseconds(0));
            const TaskReportConstPtr read = run(task("add", {in({}, buffer), out(1), value(1)}));
            wrong[thread] += read->outputs.at(0).data != Bytes{static_cast<uint8_t>(number + 2)};
            wrong[thread] += tasks_->handOver({made}).at(0)->outcome != TaskReport::OK;
            tasks_->expire();
          }
        });
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  EXPECT_EQ(std::vector<int>(THREADS, 0), wrong);
  EXPECT_EQ(size_t{THREADS}, buffers_.names().size());
}

}  // namespace
}  // namespace pi_runtime
