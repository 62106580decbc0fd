// The vehicle's side against nodes that answer by script, over loopback.

#include <gtest/gtest.h>
#include <pi_node/durations.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "client/fake_edge_node.h"
#include "client/offload_client.h"

namespace pi_offload
{
namespace
{

using Behaviour = FakeEdgeNode::Behaviour;
using How = Outcome::How;
using Type = OffloadRequest::Type;

constexpr double TIMEOUT_S = 30.0;  ///< longest that a test waits for what must come

struct Ended
{
  Outcome outcome;
  std::optional<OffloadReply> reply;
};

/// A vehicle whose own detector and recogniser are done at once, or when the test says so.
class Vehicle
{
public:
  explicit Vehicle(OffloadClientOptions options = usual())
  {
    OffloadClient::Callbacks callbacks;
    callbacks.run_local = [this](const Task& task)
    {
      ++local_begun;
      if (hold_local)
      {
        return;
      }
      client->engine().onLocalDone(task.id, 0.1, pi_node::monotonicNs());
    };
    callbacks.deliver = [this](const Outcome& outcome, const OffloadReply* reply)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      ended_[outcome.task.id].push_back(
          {outcome, reply != nullptr ? std::optional<OffloadReply>(*reply) : std::nullopt});
      changed_.notify_all();
    };
    callbacks.log = [this](bool, const std::string& text)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      logged_.push_back(text);
      changed_.notify_all();
    };
    client = std::make_unique<OffloadClient>(options, callbacks);
    client->setClassesKnown(true);
    client->start();
  }
  ~Vehicle() { client->stop(); }

  /// Loaded computers must not change what comes out.
  static OffloadClientOptions usual()
  {
    OffloadClientOptions options;
    options.vehicle = "van";
    options.engine.advertisement_valid_s = 60.0;
    options.engine.probe_period_s = 0.05;
    options.engine.probe_period_far_s = 0.05;
    options.link.reconnect_s = 0.02;
    options.link.max_reconnect_s = 0.05;
    options.unanswered_s = 60.0;
    return options;
  }

  void add(const std::string& id, const FakeEdgeNode& node) { add(id, node.address()); }
  void add(const std::string& id, const std::string& address)
  {
    NodeDescription description;
    description.id = id;
    description.address = address;
    description.range_m = std::numeric_limits<double>::infinity();
    client->call([&](int64_t now_ns) { client->setNode(description, now_ns); });
  }
  /// Until the engine would use the node.
  bool waitUntilUsed(const std::string& id, TaskKind kind = TaskKind::DETECTION)
  {
    return until(
        [&]
        {
          return client->call(
              [&](int64_t now_ns)
              {
                const Decision decision = client->engine().decide(kind, 2000, 20.0, now_ns);
                return decision.node >= 0 &&
                       client->engine().nodes(now_ns).at(static_cast<size_t>(decision.node)).description.id == id;
              });
        });
  }
  bool waitUntilLink(const std::string& id, bool up)
  {
    return until([&] { return client->call([&](int64_t) { return client->links()[id].up == up; }); });
  }
  template <typename Condition>
  bool until(const Condition& condition)
  {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(TIMEOUT_S);
    std::unique_lock<std::mutex> lock(mutex_);
    while (std::chrono::steady_clock::now() < end)
    {
      lock.unlock();
      const bool holds = condition();
      lock.lock();
      if (holds)
      {
        return true;
      }
      changed_.wait_for(lock, std::chrono::milliseconds(10));
    }
    return false;
  }

  uint64_t show(double deadline_s = 20.0)
  {
    static const std::vector<uint8_t> PIXELS(64 * 48, 50);
    TaskData data;
    data.picture = {PIXELS.data(), 64, 48, 64, Encoding::MONO8};
    return submit(TaskKind::DETECTION, deadline_s, std::move(data));
  }
  uint64_t say(double deadline_s = 20.0)
  {
    TaskData data;
    data.encoding = Encoding::S16LE;
    data.bytes = {1, 2, 3, 4};
    data.options = "stop\ngo";
    return submit(TaskKind::SPEECH, deadline_s, std::move(data));
  }
  uint64_t submit(TaskKind kind, double deadline_s, TaskData data)
  {
    const uint64_t id = ++last_;
    client->call([&](int64_t now_ns) { client->submit(id, kind, now_ns, deadline_s, std::move(data), now_ns); });
    return id;
  }
  /// The one end of a task.
  Ended end(uint64_t task)
  {
    const bool came = until([&] { return ends(task) > 0; });
    EXPECT_TRUE(came) << "task " << task << " did not end";
    std::lock_guard<std::mutex> lock(mutex_);
    return came ? ended_[task].front() : Ended();
  }
  size_t ends(uint64_t task)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return ended_[task].size();
  }
  bool waitForLog(const std::string& part)
  {
    return until(
        [&]
        {
          std::lock_guard<std::mutex> lock(mutex_);
          for (const std::string& text : logged_)
          {
            if (text.find(part) != std::string::npos)
            {
              return true;
            }
          }
          return false;
        });
  }
  void localDone(uint64_t task)
  {
    client->call([&](int64_t now_ns) { client->engine().onLocalDone(task, 0.1, now_ns); });
  }

  std::unique_ptr<OffloadClient> client;
  bool hold_local = false;  ///< set before tasks are submitted
  std::atomic<int> local_begun{0};

private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<uint64_t, std::vector<Ended>> ended_;
  std::vector<std::string> logged_;
  uint64_t last_ = 0;
};

TEST(OffloadClient, WithoutNodesTheVehicleDoesIt)
{
  Vehicle vehicle;
  const Ended ended = vehicle.end(vehicle.show());
  EXPECT_EQ(How::LOCAL, ended.outcome.how);
  EXPECT_FALSE(ended.reply);
}

TEST(OffloadClient, APictureGoesToTheNodeAndItsResultComesBack)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  const Ended ended = vehicle.end(vehicle.show());
  EXPECT_EQ(How::REMOTE, ended.outcome.how);
  EXPECT_EQ("lamp", ended.outcome.node);
  EXPECT_TRUE(ended.outcome.by_deadline);
  ASSERT_TRUE(ended.reply);
  ASSERT_EQ(1u, ended.reply->objects.size());
  EXPECT_EQ("car", ended.reply->objects[0].label);
  const std::vector<OffloadRequest> tasks = node.requests(Type::TASK);
  ASSERT_EQ(1u, tasks.size());
  EXPECT_EQ("van", tasks[0].vehicle);
  EXPECT_EQ(TaskKind::DETECTION, tasks[0].kind);
  EXPECT_EQ(Encoding::JPEG, tasks[0].encoding);
  EXPECT_GT(tasks[0].remaining_s, 0.0);
  EXPECT_LE(tasks[0].remaining_s, 20.0);
  EXPECT_FALSE(tasks[0].payload.empty());
}

TEST(OffloadClient, SpeechGoesAsItIs)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp", TaskKind::SPEECH));
  const Ended ended = vehicle.end(vehicle.say());
  EXPECT_EQ(How::REMOTE, ended.outcome.how);
  ASSERT_TRUE(ended.reply);
  EXPECT_EQ("stop", ended.reply->text);
  EXPECT_TRUE(ended.reply->accepted);
  const std::vector<OffloadRequest> tasks = node.requests(Type::TASK);
  ASSERT_EQ(1u, tasks.size());
  EXPECT_EQ(Encoding::S16LE, tasks[0].encoding);
  EXPECT_EQ((std::vector<uint8_t>{1, 2, 3, 4}), tasks[0].payload);
  EXPECT_EQ("stop\ngo", tasks[0].options);
}

TEST(OffloadClient, ANodeThatIsLateIsCalledBackAndItsAnswerComesToNothing)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  node.set(Behaviour::HOLD);
  const uint64_t task = vehicle.show(0.5);
  const Ended ended = vehicle.end(task);
  EXPECT_EQ(How::FALLBACK, ended.outcome.how);
  EXPECT_FALSE(ended.reply);
  EXPECT_TRUE(node.waitFor(Type::CANCEL, 1));
  node.release();
  node.set(Behaviour::ANSWER);
  // The late answer has come once a later one has: all is in order on one connection.
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  vehicle.end(vehicle.show());
  EXPECT_EQ(1u, vehicle.ends(task));
}

TEST(OffloadClient, ALateAnswerCountsWhileTheVehicleIsAtWork)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.hold_local = true;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  node.set(Behaviour::HOLD);
  const uint64_t task = vehicle.show(0.5);
  ASSERT_TRUE(node.waitForTasks(1));
  ASSERT_TRUE(vehicle.until([&] { return vehicle.local_begun == 1; }));
  node.release();
  const Ended ended = vehicle.end(task);
  ASSERT_TRUE(ended.reply);
  vehicle.localDone(task);
  EXPECT_EQ(1u, vehicle.ends(task));
}

TEST(OffloadClient, RefusedAndFailedTasksAreDoneByTheVehicleAtOnce)
{
  for (const Behaviour behaviour : {Behaviour::REFUSE, Behaviour::FAIL})
  {
    FakeEdgeNode node;
    Vehicle vehicle;
    vehicle.add("lamp", node);
    ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
    node.set(behaviour);
    const Ended ended = vehicle.end(vehicle.show());
    EXPECT_EQ(How::FALLBACK, ended.outcome.how);
    EXPECT_EQ("lamp", ended.outcome.node);
    EXPECT_FALSE(ended.reply);
  }
}

TEST(OffloadClient, TasksOfANodeThatDiesComeHomeAndItIsUsedAgain)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  node.set(Behaviour::HOLD);
  const uint64_t first = vehicle.show();
  const uint64_t second = vehicle.show();
  ASSERT_TRUE(node.waitForTasks(2));
  node.kill();
  EXPECT_EQ(How::FALLBACK, vehicle.end(first).outcome.how);  // long before the deadline
  EXPECT_EQ(How::FALLBACK, vehicle.end(second).outcome.how);
  EXPECT_TRUE(vehicle.waitForLog("node lamp: not connected: "));
  EXPECT_EQ(How::LOCAL, vehicle.end(vehicle.show()).outcome.how);
  node.set(Behaviour::ANSWER);
  node.revive();
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
}

TEST(OffloadClient, ConnectsAnewToANodeThatDoesNotAnswer)
{
  OffloadClientOptions options = Vehicle::usual();
  options.unanswered_s = 0.1;
  FakeEdgeNode node;
  Vehicle vehicle(options);
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  node.set(Behaviour::SILENT);
  EXPECT_TRUE(vehicle.waitForLog("no answer for too long"));
  node.set(Behaviour::ANSWER);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
}

TEST(OffloadClient, ANodeWithAnotherNetworkIsUsedAndNamed)
{
  FakeEdgeNode node;
  node.setModel("coco");
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
  EXPECT_EQ("coco", vehicle.client->call([&](int64_t) { return vehicle.client->links().at("lamp").model; }));
}

TEST(OffloadClient, WithoutClassesOfItsOwnNoPictureIsSent)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.client->call([&](int64_t) { vehicle.client->setClassesKnown(false); });
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp", TaskKind::SPEECH));
  EXPECT_EQ(How::LOCAL, vehicle.end(vehicle.show()).outcome.how);
  EXPECT_EQ(0u, node.tasks());
}

TEST(OffloadClient, AnswersThatAreNoNumbersAreNotUsed)
{
  FakeEdgeNode node;
  node.setObjects({{"car", 0.75F, std::numeric_limits<float>::quiet_NaN(), 20.0F, 30.0F, 40.0F}});
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  const Ended ended = vehicle.end(vehicle.show());
  EXPECT_EQ(How::FALLBACK, ended.outcome.how);
  EXPECT_FALSE(ended.reply);
}

TEST(OffloadClient, AReplayedOrUnaskedAnswerIsNoResultAndCounts)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  const uint64_t first = vehicle.show();
  EXPECT_EQ(How::REMOTE, vehicle.end(first).outcome.how);
  const uint64_t answered = node.requests(Type::TASK).front().request;
  const auto unasked = [&](const std::string& id)
  { return vehicle.client->call([&](int64_t) { return vehicle.client->links()[id].unasked; }); };
  EXPECT_EQ(0u, unasked("lamp"));
  node.setObjects({{"ghost", 0.9F, 1.0F, 2.0F, 30.0F, 40.0F}});
  ASSERT_TRUE(node.answerUnasked(answered));         // once more
  ASSERT_TRUE(node.answerUnasked(answered + 1000));  // before it is asked
  EXPECT_TRUE(vehicle.until([&] { return unasked("lamp") == 2; }));
  EXPECT_EQ(1u, vehicle.ends(first));

  // While a task waits, the answer to another one is not its result.
  node.set(Behaviour::HOLD);
  const uint64_t second = vehicle.show();
  ASSERT_TRUE(node.waitForTasks(2));
  ASSERT_TRUE(node.answerUnasked(answered));
  EXPECT_TRUE(vehicle.until([&] { return unasked("lamp") == 3; }));
  EXPECT_EQ(0u, vehicle.ends(second));
  node.setObjects({{"car", 0.9F, 1.0F, 2.0F, 30.0F, 40.0F}});
  node.release();
  const Ended ended = vehicle.end(second);
  ASSERT_TRUE(ended.reply);
  EXPECT_EQ("car", ended.reply->objects.at(0).label);
  EXPECT_EQ(3u, unasked("lamp"));
}

TEST(OffloadClient, TheKillSwitchCallsTasksBack)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  node.set(Behaviour::HOLD);
  const uint64_t task = vehicle.show();
  ASSERT_TRUE(node.waitForTasks(1));
  vehicle.client->call([&](int64_t now_ns) { vehicle.client->setEnabled(false, now_ns); });
  EXPECT_EQ(How::FALLBACK, vehicle.end(task).outcome.how);
  EXPECT_TRUE(node.waitFor(Type::CANCEL, 1));
  EXPECT_EQ(How::LOCAL, vehicle.end(vehicle.show()).outcome.how);
  EXPECT_EQ(1u, node.tasks());
  node.set(Behaviour::ANSWER);
  vehicle.client->call([&](int64_t now_ns) { vehicle.client->setEnabled(true, now_ns); });
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
}

TEST(OffloadClient, ARemovedNodeIsDisconnected)
{
  FakeEdgeNode node;
  Vehicle vehicle;
  vehicle.add("lamp", node);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  node.set(Behaviour::HOLD);
  const uint64_t task = vehicle.show();
  ASSERT_TRUE(node.waitForTasks(1));
  EXPECT_TRUE(vehicle.client->call([&](int64_t now_ns) { return vehicle.client->removeNode("lamp", now_ns); }));
  EXPECT_FALSE(vehicle.client->call([&](int64_t now_ns) { return vehicle.client->removeNode("lamp", now_ns); }));
  EXPECT_EQ(How::FALLBACK, vehicle.end(task).outcome.how);
  EXPECT_TRUE(vehicle.client->links().empty());
}

TEST(OffloadClient, ANodeThatMovesToAnotherAddressIsFoundThere)
{
  FakeEdgeNode first;
  FakeEdgeNode second;
  Vehicle vehicle;
  vehicle.add("lamp", first);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  vehicle.add("lamp", second);
  ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
  EXPECT_EQ(0u, first.tasks());
  EXPECT_EQ(1u, second.tasks());
}

TEST(OffloadClient, WrongAddressesAndNamesAreNamed)
{
  Vehicle vehicle;
  EXPECT_THROW(vehicle.add("lamp", ""), std::invalid_argument);
  EXPECT_THROW(vehicle.add("lamp", "10.0.0.1"), std::invalid_argument);
  EXPECT_THROW(vehicle.add("lamp", "10.0.0.1:99999"), std::invalid_argument);
  EXPECT_THROW(vehicle.add("a lamp", "10.0.0.1:1"), std::invalid_argument);
  EXPECT_TRUE(vehicle.client->call([&](int64_t now_ns) { return vehicle.client->engine().nodes(now_ns); }).empty());
  OffloadClientOptions options = Vehicle::usual();
  options.vehicle = "";
  EXPECT_THROW(Vehicle{options}, std::invalid_argument);
}

TEST(OffloadClient, EndsWithTasksUnderWay)
{
  FakeEdgeNode node;
  uint64_t task = 0;
  {
    Vehicle vehicle;
    vehicle.add("lamp", node);
    ASSERT_TRUE(vehicle.waitUntilUsed("lamp"));
    node.set(Behaviour::HOLD);
    task = vehicle.show();
    ASSERT_TRUE(node.waitForTasks(1));
  }
  node.release();  // to nobody
  EXPECT_EQ(1u, task);
}

/// Answers, refusals, silence and deaths in a fixed order: each task ends once.
TEST(OffloadClient, EveryTaskEndsOnceWhateverTheNodesDo)
{
  FakeEdgeNode first;
  FakeEdgeNode second;
  Vehicle vehicle;
  vehicle.add("first", first);
  vehicle.add("second", second);
  ASSERT_TRUE(vehicle.until(
      [&]
      {
        return vehicle.client->call(
            [&](int64_t now_ns) {
              return vehicle.client->engine().nodes(now_ns)[0].connected &&
                     vehicle.client->engine().nodes(now_ns)[1].connected;
            });
      }));
  std::vector<uint64_t> tasks;
  for (int i = 0; i < 120; ++i)
  {
    switch (i % 24)
    {
      case 4:
        first.set(Behaviour::HOLD);
        break;
      case 8:
        first.kill();
        first.revive();
        break;
      case 12:
        second.set(Behaviour::REFUSE);
        break;
      case 16:
        first.release();
        first.set(Behaviour::FAIL);
        break;
      case 20:
        second.kill();
        second.set(Behaviour::ANSWER);
        second.revive();
        first.set(Behaviour::ANSWER);
        break;
      default:
        break;
    }
    tasks.push_back(i % 7 == 0 ? vehicle.say(0.3) : vehicle.show(0.3));
  }
  for (const uint64_t task : tasks)
  {
    vehicle.end(task);
  }
  for (const uint64_t task : tasks)
  {
    EXPECT_EQ(1u, vehicle.ends(task)) << task;
  }
  const auto statistics = vehicle.client->call([&](int64_t) { return vehicle.client->engine().statistics(); });
  uint64_t ended = 0;
  for (const auto& of_kind : statistics.of_kind)
  {
    EXPECT_EQ(0u, of_kind.abandoned);
    ended += of_kind.local + of_kind.remote + of_kind.fallback;
  }
  EXPECT_EQ(tasks.size(), ended);
}

}  // namespace
}  // namespace pi_offload
