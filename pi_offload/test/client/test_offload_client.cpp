// The vehicle's side against nodes that answer by script, over loopback.

#include <gtest/gtest.h>
#include <pi_node/durations.h>

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "client/fake_edge_node.h"
#include "client/vehicle_under_test.h"

namespace pi_offload
{
namespace
{

using Behaviour = FakeEdgeNode::Behaviour;
using How = Outcome::How;
using Type = OffloadRequest::Type;
using Vehicle = VehicleUnderTest;

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
