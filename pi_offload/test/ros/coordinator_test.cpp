// Judge of coordinator.test.

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pi_offload/SetEta.h>
#include <pi_offload/SetPolicy.h>
#include <pi_speech/RecognizeUtterance.h>
#include <sensor_msgs/BatteryState.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <visualization_msgs/MarkerArray.h>

#include <cmath>
#include <future>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "ros/coordinator_on_graph.h"

namespace pi_offload
{
namespace
{

using Behaviour = FakeEdgeNode::Behaviour;
using Type = OffloadRequest::Type;
using Texts = std::vector<std::string>;

nav_msgs::Odometry odometryAt(double x, double speed, const std::string& frame = "map")
{
  nav_msgs::Odometry message;
  message.header.stamp = ros::Time::now();
  message.header.frame_id = frame;
  message.pose.pose.position.x = x;
  message.pose.pose.orientation.w = 1.0;
  message.twist.twist.linear.x = speed;
  return message;
}

// ------------------------------------------------------------------------------------------------------------ pictures

TEST(Coordinator, WithoutNodesTheVehiclesDetectorGetsTheVeryPicture)
{
  FakeDetector detector("local_only");
  CoordinatorOnGraph coordinator("local_only");
  coordinator.start();
  ASSERT_TRUE(coordinator.listen());
  const sensor_msgs::ImagePtr picture = coordinator.makePicture();
  coordinator.camera.publish(sensor_msgs::ImageConstPtr(picture));
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(picture->header.stamp));
  EXPECT_EQ("local", coordinator.end(picture->header.stamp));
  ASSERT_EQ(1u, detector.came().size());
  EXPECT_EQ(picture.get(), detector.came()[0].get());  // no copy
  const OffloadStatistics statistics = coordinator.statistics();
  EXPECT_EQ("detection", statistics.kind);
  EXPECT_EQ(1u, statistics.tasks);
  EXPECT_EQ(1u, statistics.local);
}

TEST(Coordinator, PicturesGoToANodeAndTheirResultsComeBack)
{
  FakeDetector detector("remote");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("remote");
  coordinator.start();
  ASSERT_TRUE(coordinator.add("lamp", node.address()).success);
  ASSERT_TRUE(coordinator.listen());
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));
  for (int i = 0; i < 5; ++i)
  {
    const ros::Time stamp = coordinator.show();
    EXPECT_EQ(REMOTE_CLASS, coordinator.found(stamp));
    EXPECT_EQ("remote lamp", coordinator.end(stamp));
  }
  EXPECT_TRUE(detector.came().empty());
  EXPECT_EQ(5u, node.tasks());
  EXPECT_EQ("remote", node.requests(Type::TASK)[0].vehicle);
  const EdgeNodeStatus status = coordinator.node("lamp");
  EXPECT_TRUE(status.connected);
  EXPECT_TRUE(status.in_range);
  EXPECT_EQ(5u, status.sent);
  EXPECT_EQ(5u, status.answered);
  EXPECT_EQ(node.address(), status.node.address);
  EXPECT_EQ("map", status.node.frame_id);
}

TEST(Coordinator, ANodeThatIsLateIsReplacedByTheVehicleAndItsAnswerIsDropped)
{
  FakeDetector detector("timeout");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("timeout");
  coordinator.set("detection/deadline_s", 1.0);
  ASSERT_TRUE(coordinator.startBeside(node));
  node.set(Behaviour::HOLD);
  const ros::Time late = coordinator.show();
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(late));
  EXPECT_EQ("fallback lamp", coordinator.end(late));
  EXPECT_TRUE(node.waitFor(Type::CANCEL, 1));
  node.set(Behaviour::ANSWER);
  node.release();
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));
  const ros::Time next = coordinator.show();  // its answer comes after the late one
  EXPECT_EQ(REMOTE_CLASS, coordinator.found(next));
  EXPECT_EQ(1u, coordinator.results(late));
}

TEST(Coordinator, PicturesOfANodeThatDiesComeHomeInTimeAndItIsUsedAgain)
{
  FakeDetector detector("death");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("death");
  ASSERT_TRUE(coordinator.startBeside(node));
  node.set(Behaviour::HOLD);
  std::vector<ros::Time> stamps;
  for (int i = 0; i < 3; ++i)
  {
    stamps.push_back(coordinator.show());
  }
  ASSERT_TRUE(node.waitForTasks(3));
  node.kill();  // long before the deadline
  for (const ros::Time& stamp : stamps)
  {
    EXPECT_EQ(LOCAL_CLASS, coordinator.found(stamp));
    EXPECT_EQ("fallback lamp", coordinator.end(stamp));
  }
  const ros::Time alone = coordinator.show();
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(alone));
  EXPECT_EQ("local", coordinator.end(alone));
  node.set(Behaviour::ANSWER);
  node.revive();
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));
  EXPECT_EQ(REMOTE_CLASS, coordinator.found(coordinator.show()));
}

TEST(Coordinator, TheKillSwitchBringsAllHome)
{
  FakeDetector detector("switch");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("switch");
  ASSERT_TRUE(coordinator.startBeside(node));
  node.set(Behaviour::HOLD);
  const ros::Time under_way = coordinator.show();
  ASSERT_TRUE(node.waitForTasks(1));
  ASSERT_TRUE(coordinator.enable(false));
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(under_way));
  EXPECT_EQ("fallback lamp", coordinator.end(under_way));
  EXPECT_TRUE(node.waitFor(Type::CANCEL, 1));
  EXPECT_EQ("local", coordinator.end(coordinator.show()));
  EXPECT_EQ(1u, node.tasks());
  Statistics statistics;
  ASSERT_TRUE(coordinator.call("statistics", &statistics));
  EXPECT_FALSE(statistics.response.enabled);
  node.set(Behaviour::ANSWER);
  ASSERT_TRUE(coordinator.enable(true));
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));
  EXPECT_EQ("remote lamp", coordinator.end(coordinator.show()));
}

TEST(Coordinator, ANodeWithAnotherNetworkIsUsedAndItsClassesAreMatchedByName)
{
  FakeDetector detector("model");
  FakeEdgeNode node;
  node.setModel("coco");
  node.setObjects({{"zebra", 0.9F, 1.0F, 2.0F, 3.0F, 4.0F}, {"car", 0.75F, 10.0F, 20.0F, 30.0F, 40.0F}});
  CoordinatorOnGraph coordinator("model");
  ASSERT_TRUE(coordinator.startBeside(node));
  EXPECT_EQ(REMOTE_CLASS, coordinator.found(coordinator.show()));  // the only object: the vehicle knows no zebra
  EXPECT_EQ(1u, node.tasks());
}

/// A clear object in one of 12 places of the test's picture.
pi_detect::Box placeOf(size_t number)
{
  const auto x = static_cast<float>(16 * (number % 4));
  const auto y = static_cast<float>(16 * (number / 4 % 3));
  return {x, y, x + 16.0F, y + 16.0F};
}

/// Shows a picture in which node and vehicle find a car each. @return how its task ended
std::string showChecked(CoordinatorOnGraph* coordinator, FakeDetector* detector, FakeEdgeNode* node, size_t answered,
                        size_t own)
{
  const pi_detect::Box box = placeOf(answered);
  node->setObjects({{"car", 0.9F, box.x1, box.y1, box.x2, box.y2}});
  detector->setObjects({{REMOTE_CLASS, 0.8F, placeOf(own)}});
  const ros::Time stamp = coordinator->show();
  EXPECT_EQ(REMOTE_CLASS, coordinator->found(stamp));
  return coordinator->end(stamp);
}

TEST(Coordinator, ANodeThatAnswersWhatIsNotThereGetsNoTasksUntilItIsRegisteredAgain)
{
  FakeDetector detector("liar");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("liar");
  coordinator.set("verify/every", 1);
  coordinator.set("verify/suspect_every", 1);
  DiagnosticCollector diagnostics;
  ASSERT_TRUE(coordinator.startBeside(node));
  size_t pictures = 0;
  while (coordinator.node("lamp").distrusted.empty() && pictures < 20)
  {
    EXPECT_EQ("remote lamp", showChecked(&coordinator, &detector, &node, pictures, pictures + 5));
    ++pictures;
    EXPECT_TRUE(detector.waitFor(pictures));  // it checks each
    EXPECT_TRUE(until(TIMEOUT_S, [&] { return coordinator.node("lamp").checked == pictures; }));
  }
  EXPECT_EQ(7u, pictures);
  const EdgeNodeStatus status = coordinator.node("lamp");
  EXPECT_FALSE(status.connected);
  EXPECT_EQ(7u, status.disagreed);
  EXPECT_NE(std::string::npos, status.distrusted.find("7 of 7 compared ones disagree")) << status.distrusted;
  EXPECT_TRUE(diagnostics.waitForSummary("liar/coordinator: nodes", diagnostic_msgs::DiagnosticStatus::ERROR,
                                         "node lamp: its answers do not fit the pictures"))
      << diagnostics.text();
  EXPECT_EQ("local", showChecked(&coordinator, &detector, &node, 0, 1));
  EXPECT_GT(coordinator.statistics().energy, 8 * 0.4);  // seven checks and a picture of its own

  ASSERT_TRUE(coordinator.add("lamp", node.address()).success);
  EXPECT_EQ("", coordinator.node("lamp").distrusted);
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));
  EXPECT_EQ("remote lamp", showChecked(&coordinator, &detector, &node, 3, 3));
}

TEST(Coordinator, AnHonestNodeIsCheckedSeldomAndKept)
{
  FakeDetector detector("honest");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("honest");
  coordinator.set("verify/every", 10);
  coordinator.set("verify/suspect_every", 2);
  ASSERT_TRUE(coordinator.startBeside(node));
  for (size_t picture = 0; picture < 60; ++picture)
  {
    EXPECT_EQ("remote lamp", showChecked(&coordinator, &detector, &node, 0, 0));
  }
  // Five of the first ten, then one of ten; pictures that come while one is checked do not count.
  EXPECT_TRUE(until(TIMEOUT_S, [&] { return coordinator.node("lamp").checked >= 7; }));
  EXPECT_LE(detector.came().size(), 12u);
  EXPECT_EQ(0u, coordinator.node("lamp").disagreed);
  EXPECT_EQ("", coordinator.node("lamp").distrusted);
}

TEST(Coordinator, EveryPictureIsAnsweredOnceAndInOrder)
{
  FakeDetector detector("once");
  FakeEdgeNode first;
  FakeEdgeNode second;
  CoordinatorOnGraph coordinator("once");
  coordinator.set("local/max_waiting", 100);
  coordinator.start();
  coordinator.add("first", first.address());
  coordinator.add("second", second.address());
  ASSERT_TRUE(coordinator.listen());
  ASSERT_TRUE(
      until(TIMEOUT_S, [&] { return coordinator.node("first").connected && coordinator.node("second").connected; }));
  std::vector<ros::Time> stamps;
  for (int i = 0; i < 96; ++i)
  {
    switch (i % 24)
    {
      case 4:
        first.set(Behaviour::REFUSE);
        break;
      case 8:
        second.set(Behaviour::HOLD);
        break;
      case 9:
        second.kill();
        second.set(Behaviour::ANSWER);
        second.revive();
        EXPECT_NE("", coordinator.end(stamps.back()));  // before a later one is done elsewhere
        break;
      case 14:
        first.set(Behaviour::FAIL);
        break;
      case 18:
        first.kill();
        first.set(Behaviour::ANSWER);
        first.revive();
        break;
      default:
        break;
    }
    stamps.push_back(coordinator.show());
    // One after the other; what a node holds comes home when that dies.
    ASSERT_TRUE(i % 24 == 8 || !coordinator.end(stamps.back()).empty());
  }
  for (const ros::Time& stamp : stamps)
  {
    const std::string end = coordinator.end(stamp);
    EXPECT_TRUE(end.rfind("abandoned", 0) != 0 && !end.empty()) << end;
    EXPECT_GT(coordinator.found(stamp), 0);
  }
  const auto messages = coordinator.detections->messages();
  EXPECT_EQ(stamps.size(), messages.size());
  for (size_t i = 1; i < messages.size(); ++i)
  {
    EXPECT_LT(messages[i - 1]->header.stamp, messages[i]->header.stamp);
  }
  EXPECT_EQ(stamps.size(), coordinator.decisions.messages().size());
  const OffloadStatistics statistics = coordinator.statistics();
  EXPECT_EQ(stamps.size(), statistics.local + statistics.remote + statistics.fallback);
}

TEST(Coordinator, AResultWaitsForThoseOfOlderPicturesUnlessTheOrderDoesNotMatter)
{
  for (const bool keep_order : {true, false})
  {
    const std::string name = keep_order ? "ordered" : "unordered";
    FakeDetector detector(name);
    FakeEdgeNode node;
    CoordinatorOnGraph coordinator(name);
    coordinator.set("keep_order", keep_order);
    ASSERT_TRUE(coordinator.startBeside(node));
    node.set(Behaviour::HOLD);
    const ros::Time overtaken = coordinator.show();
    ASSERT_TRUE(node.waitForTasks(1));
    node.set(Behaviour::ANSWER);
    const ros::Time next = coordinator.show();
    EXPECT_EQ("remote lamp", coordinator.end(next));
    const ros::Time after = coordinator.show();
    EXPECT_EQ("remote lamp", coordinator.end(after));
    if (!keep_order)
    {
      EXPECT_EQ(REMOTE_CLASS, coordinator.found(next));
    }
    EXPECT_EQ(0u, coordinator.results(overtaken));
    node.release();
    EXPECT_EQ(REMOTE_CLASS, coordinator.found(after));
    EXPECT_EQ(REMOTE_CLASS, coordinator.found(overtaken));
    std::vector<ros::Time> stamps;
    for (const auto& message : coordinator.detections->messages())
    {
      stamps.push_back(message->header.stamp);
    }
    EXPECT_EQ(keep_order ? std::vector<ros::Time>({overtaken, next, after})
                         : std::vector<ros::Time>({next, after, overtaken}),
              stamps);
  }
}

TEST(Coordinator, EachPictureIsPublishedOnceAndInOrderBesideANodeThatDelaysAQuarter)
{
  FakeDetector detector("quarter");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("quarter");
  ASSERT_TRUE(coordinator.startBeside(node));
  std::vector<ros::Time> stamps;
  const int pictures = repetitions(100, 1000);
  for (int i = 0; i < pictures; ++i)
  {
    if (i % 4 == 0)
    {
      node.release();  // that of four pictures before
    }
    node.set(i % 4 == 0 ? Behaviour::HOLD : Behaviour::ANSWER);
    stamps.push_back(coordinator.show());
    ASSERT_TRUE(i % 4 == 0 ? node.waitForTasks(stamps.size()) : !coordinator.end(stamps.back()).empty());
  }
  node.release();
  for (const ros::Time& stamp : stamps)
  {
    EXPECT_EQ(REMOTE_CLASS, coordinator.found(stamp));
    EXPECT_EQ(1u, coordinator.results(stamp));
  }
  const auto messages = coordinator.detections->messages();
  for (size_t i = 1; i < messages.size(); ++i)
  {
    EXPECT_LT(messages[i - 1]->header.stamp, messages[i]->header.stamp);
  }
}

TEST(Coordinator, AResultWaitsNoLongerThanTheDeadlineOfAnOlderPicture)
{
  FakeDetector detector("patience");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("patience");
  coordinator.set("detection/deadline_s", 2.0);
  ASSERT_TRUE(coordinator.startBeside(node));
  detector.hold(true);  // the node does not answer, and the vehicle's detector not before the deadline
  node.set(Behaviour::HOLD);
  const ros::Time lost = coordinator.show();
  ASSERT_TRUE(node.waitForTasks(1));
  node.set(Behaviour::ANSWER);
  const ros::Time next = coordinator.show();
  EXPECT_EQ("remote lamp", coordinator.end(next));
  EXPECT_EQ(REMOTE_CLASS, coordinator.found(next));
  EXPECT_EQ(0u, coordinator.results(lost));
  ASSERT_TRUE(detector.waitFor(1));
  detector.release();
  EXPECT_EQ("fallback lamp", coordinator.end(lost));  // dropped, and counted as missed
  for (const auto& decision : coordinator.decisions.messages())
  {
    EXPECT_EQ(decision->header.stamp == lost, decision->dropped != 0);
    EXPECT_GT(decision->expected_time, 0.0);
  }
  EXPECT_EQ(0u, coordinator.results(lost));
  EXPECT_EQ(1u, coordinator.statistics().missed);
}

TEST(Coordinator, ARecordingThatBeginsAgainIsPublished)
{
  FakeDetector detector("again");
  CoordinatorOnGraph coordinator("again");
  coordinator.start();
  ASSERT_TRUE(coordinator.listen());
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(coordinator.show()));
  const sensor_msgs::ImagePtr picture = coordinator.makePicture();
  picture->header.stamp -= ros::Duration(100.0);
  coordinator.camera.publish(sensor_msgs::ImageConstPtr(picture));
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(picture->header.stamp));
}

TEST(Coordinator, PicturesThatTheDetectorLeavesOutAreAbandoned)
{
  FakeDetector detector("dropping");
  CoordinatorOnGraph coordinator("dropping");
  coordinator.start();
  ASSERT_TRUE(coordinator.listen());
  detector.hold(true);
  const ros::Time lost = coordinator.show();
  ASSERT_TRUE(detector.waitFor(1));
  const ros::Time kept = coordinator.show();
  EXPECT_EQ(1u, detector.came().size());  // one at a time
  std_msgs::Header header;
  header.stamp = lost + ros::Duration(0.0005);  // of a later picture, that came to the detector another way
  detector.hold(false);
  detector.answer(header);
  EXPECT_EQ("abandoned", coordinator.end(lost));
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(kept));
  EXPECT_EQ(0u, coordinator.results(lost));
}

TEST(Coordinator, BadPicturesAreNamedAndPassedOver)
{
  FakeDetector detector("bad");
  CoordinatorOnGraph coordinator("bad");
  LogCollector log;
  ASSERT_TRUE(log.waitForPublisher());
  coordinator.start();
  ASSERT_TRUE(coordinator.listen());
  const sensor_msgs::ImagePtr picture = coordinator.makePicture();
  picture->data.resize(100);
  coordinator.camera.publish(sensor_msgs::ImageConstPtr(picture));
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(coordinator.show()));
  EXPECT_TRUE(log.waitForText("/bad/image: step 64 and height 48 need more than its 100 bytes; picture ignored"))
      << log.text();
  EXPECT_EQ(1u, coordinator.statistics().tasks);
}

TEST(Coordinator, SubscribesOnlyWhileSomebodyListens)
{
  FakeDetector detector("lazy");
  CoordinatorOnGraph coordinator("lazy");
  DiagnosticCollector diagnostics;
  coordinator.start();
  ASSERT_TRUE(diagnostics.waitForSummary("lazy/coordinator: input", diagnostic_msgs::DiagnosticStatus::OK,
                                         "nobody listens, /lazy/image is not subscribed"))
      << diagnostics.text();
  EXPECT_EQ(0u, coordinator.camera.getNumSubscribers());
  EXPECT_EQ(0u, detector.listeners());
  ASSERT_TRUE(coordinator.listen());
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(coordinator.show()));
  coordinator.detections.reset();
  EXPECT_TRUE(
      until(TIMEOUT_S, [&] { return coordinator.camera.getNumSubscribers() == 0 && detector.listeners() == 0; }));
  ASSERT_TRUE(coordinator.listen());
  EXPECT_EQ(LOCAL_CLASS, coordinator.found(coordinator.show()));
}

// --------------------------------------------------------------------------------------------------- nodes, position

TEST(Coordinator, NodesAreUsedWithinTheirRangeOnly)
{
  FakeDetector detector("range");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("range");
  ros::Publisher odometry = ros::NodeHandle("/range").advertise<nav_msgs::Odometry>("odometry", 10, true);
  ros::Publisher route = ros::NodeHandle("/range").advertise<nav_msgs::Path>("route", 10, true);
  coordinator.start();
  coordinator.add("lamp", node.address(), 100.0, 50.0);
  ASSERT_TRUE(coordinator.listen());
  EXPECT_EQ("", coordinator.place());  // where the vehicle is, is not known
  odometry.publish(odometryAt(0.0, 2.0));
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return std::abs(coordinator.node("lamp").distance - 100.0) < 1e-6; }));
  EXPECT_FALSE(coordinator.node("lamp").in_range);
  EXPECT_EQ("", coordinator.place());
  odometry.publish(odometryAt(60.0, 2.0));
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));
  EXPECT_EQ("remote lamp", coordinator.end(coordinator.show()));
  EXPECT_NEAR(45.0, coordinator.node("lamp").residence, 1e-3);  // straight on, 90 m at 2 m/s
  // The route turns back at x = 70: 10 m there, 20 m back to the edge at x = 50.
  nav_msgs::Path path;
  path.header.frame_id = "map";
  path.poses.resize(3);
  path.poses[0].pose.position.x = 60.0;
  path.poses[1].pose.position.x = 70.0;
  path.poses[2].pose.position.x = 0.0;
  route.publish(path);
  EXPECT_TRUE(until(TIMEOUT_S, [&] { return std::abs(coordinator.node("lamp").residence - 15.0) < 1e-3; }))
      << coordinator.node("lamp").residence;
  odometry.publish(odometryAt(0.0, 2.0));
  ASSERT_TRUE(coordinator.waitUntilUsed(""));
  EXPECT_EQ("local", coordinator.end(coordinator.show()));
}

TEST(Coordinator, PositionsOfOtherFramesAreBroughtIntoTheMap)
{
  FakeDetector detector("frames");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("frames");
  LogCollector log;
  ASSERT_TRUE(log.waitForPublisher());
  ros::Publisher odometry = ros::NodeHandle("/frames").advertise<nav_msgs::Odometry>("odometry", 10, true);
  coordinator.start();
  coordinator.add("lamp", node.address(), 100.0, 50.0);
  EXPECT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      odometry.publish(odometryAt(0.0, 2.0, "frames_odom"));
                      return log.waitFor([](const rosgraph_msgs::Log& line)
                                         { return line.msg.find("odometry: tf has no map -> frames_odom;") == 0; },
                                         0.05);
                    }))
      << log.text();
  EXPECT_EQ("", coordinator.place());
  tf2_ros::StaticTransformBroadcaster broadcaster;
  geometry_msgs::TransformStamped transform;
  transform.header.frame_id = "map";
  transform.child_frame_id = "frames_odom";
  transform.transform.translation.x = 90.0;
  transform.transform.rotation.w = 1.0;
  broadcaster.sendTransform(transform);
  EXPECT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      odometry.publish(odometryAt(0.0, 2.0, "frames_odom"));
                      return std::abs(coordinator.node("lamp").distance - 10.0) < 1e-6;
                    }));
  EXPECT_TRUE(coordinator.waitUntilUsed("lamp"));
  // A node may be given in another frame, too.
  EXPECT_TRUE(coordinator.add("tree", node.address(), 5.0, 50.0, "frames_odom").success);
  EXPECT_NEAR(5.0, coordinator.node("tree").distance, 1e-6);
  EXPECT_NEAR(95.0, coordinator.node("tree").node.x, 1e-6);
  const RegisterNode::Response unknown = coordinator.add("moon", node.address(), 5.0, 50.0, "moon");
  EXPECT_FALSE(unknown.success);
  EXPECT_EQ("tf has no map -> moon; give the position in map", unknown.message);
}

TEST(Coordinator, TheVehicleIsHandedOverFromNodeToNode)
{
  FakeDetector detector("handover");
  FakeEdgeNode west;
  FakeEdgeNode east;
  CoordinatorOnGraph coordinator("handover");
  ros::Publisher odometry = ros::NodeHandle("/handover").advertise<nav_msgs::Odometry>("odometry", 10, true);
  coordinator.start();
  coordinator.add("west", west.address(), 0.0, 60.0);
  coordinator.add("east", east.address(), 100.0, 60.0);
  ASSERT_TRUE(coordinator.listen());
  odometry.publish(odometryAt(0.0, 2.0));
  ASSERT_TRUE(coordinator.waitUntilUsed("west"));
  EXPECT_EQ("remote west", coordinator.end(coordinator.show()));
  odometry.publish(odometryAt(100.0, 2.0));
  ASSERT_TRUE(coordinator.waitUntilUsed("east"));
  EXPECT_EQ("remote east", coordinator.end(coordinator.show()));
  EXPECT_EQ("remote east", coordinator.end(coordinator.show()));
  EXPECT_EQ(1u, coordinator.statistics().handovers);
  EXPECT_EQ(1u, west.tasks());
  EXPECT_EQ(2u, east.tasks());
}

TEST(Coordinator, NodesComeByParameterAnnouncementAndService)
{
  FakeDetector detector("found");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("found");
  XmlRpc::XmlRpcValue nodes;
  nodes[0]["id"] = std::string("lamp");
  nodes[0]["address"] = node.address();
  nodes[0]["x"] = 3.0;
  nodes[0]["range"] = std::string("inf");
  coordinator.set("nodes", nodes);
  coordinator.set("max_nodes", 3);
  ros::Publisher announcements = ros::NodeHandle("/found").advertise<EdgeNode>("edge_nodes", 10, true);
  EdgeNode announced;
  announced.id = "tree";
  announced.address = node.address();
  announced.x = 7.0;
  announced.range = 50.0;
  announcements.publish(announced);
  coordinator.start();
  EXPECT_EQ(3.0, coordinator.node("lamp").node.x);
  EXPECT_TRUE(until(TIMEOUT_S, [&] { return coordinator.node("tree").node.x == 7.0; }));
  announced.x = 8.0;
  announcements.publish(announced);  // it has moved
  EXPECT_TRUE(until(TIMEOUT_S, [&] { return coordinator.node("tree").node.x == 8.0; }));
  EXPECT_TRUE(coordinator.add("gate", node.address()).success);
  const RegisterNode::Response one_more = coordinator.add("one_more", node.address());
  EXPECT_FALSE(one_more.success);
  EXPECT_EQ("node one_more is one too many: max_nodes = 3", one_more.message);
  EXPECT_TRUE(coordinator.add("gate", node.address(), 5.0).success);  // known already
  EXPECT_EQ(5.0, coordinator.node("gate").node.x);
  EXPECT_TRUE(coordinator.remove("gate").success);
  EXPECT_EQ("", coordinator.node("gate").node.id);
  EXPECT_EQ("there is no node \"gate\"", coordinator.remove("gate").message);
  EXPECT_TRUE(coordinator.waitUntilUsed("lamp"));
}

TEST(Coordinator, WrongAddressesAreNamed)
{
  FakeDetector detector("wrong");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("wrong");
  DiagnosticCollector diagnostics;
  coordinator.start();
  for (const char* address : {"", "10.0.0.1", "10.0.0.1:0", "10.0.0.1:70000", "a b:1"})
  {
    const RegisterNode::Response response = coordinator.add("lamp", address);
    EXPECT_FALSE(response.success) << address;
    EXPECT_NE(std::string::npos, response.message.find("address")) << response.message;
  }
  EXPECT_FALSE(coordinator.add("a lamp", node.address()).success);
  EXPECT_FALSE(coordinator.add("lamp", node.address(), NAN).success);
  EXPECT_FALSE(coordinator.add("lamp", node.address(), 0.0, -1.0).success);
  EXPECT_EQ("", coordinator.node("lamp").node.id);
  const std::string closed = node.address();
  node.kill();
  EXPECT_TRUE(coordinator.add("lamp", closed).success);  // it may come up later
  EXPECT_TRUE(diagnostics.waitForStatus("wrong/coordinator: nodes",
                                        [&closed](const DiagnosticCollector::Status& status)
                                        {
                                          for (const auto& value : status.values)
                                          {
                                            if (value.key == "lamp" &&
                                                value.value.find(closed + ", not connected: ") == 0 &&
                                                value.value.find("refused") != std::string::npos)
                                            {
                                              return true;
                                            }
                                          }
                                          return false;
                                        }))
      << diagnostics.text();
  ASSERT_TRUE(coordinator.listen());
  EXPECT_EQ("local", coordinator.end(coordinator.show()));
}

TEST(Coordinator, MarkersShowNodesAndTheChosenLink)
{
  FakeDetector detector("markers");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("markers");
  ros::Publisher odometry = ros::NodeHandle("/markers").advertise<nav_msgs::Odometry>("odometry", 10, true);
  coordinator.set("marker_rate_hz", 20.0);
  coordinator.start();
  coordinator.add("lamp", node.address(), 10.0, 50.0);
  odometry.publish(odometryAt(2.0, 1.0));
  ASSERT_TRUE(coordinator.listen());
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));
  ASSERT_EQ("remote lamp", coordinator.end(coordinator.show()));
  const Collector<visualization_msgs::MarkerArray> markers("/markers/coordinator/markers");
  EXPECT_TRUE(markers.waitFor(
      [](const visualization_msgs::MarkerArray& array)
      {
        Texts groups;
        for (const auto& marker : array.markers)
        {
          groups.push_back(marker.ns);
        }
        std::sort(groups.begin(), groups.end());
        return groups == Texts{"links", "names", "nodes", "ranges"};
      }));
}

// ----------------------------------------------------------------------------------------------------------- services

TEST(Coordinator, PolicyAndEtaCanBeSet)
{
  FakeDetector detector("policy");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("policy");
  ros::Publisher battery = ros::NodeHandle("/policy").advertise<sensor_msgs::BatteryState>("battery", 10, true);
  coordinator.start();
  coordinator.add("lamp", node.address());
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));

  SetPolicy policy;
  policy.request.policy = "local";
  ASSERT_TRUE(coordinator.call("set_policy", &policy));
  EXPECT_TRUE(policy.response.success);
  EXPECT_EQ("", coordinator.place());
  policy.request.policy = "best";
  ASSERT_TRUE(coordinator.call("set_policy", &policy));
  EXPECT_FALSE(policy.response.success);
  EXPECT_NE(std::string::npos, policy.response.message.find("best")) << policy.response.message;
  EXPECT_EQ("local", policy.response.policy);
  EXPECT_EQ(policyNames(), policy.response.policies);
  policy.request.policy = "expected_cost";
  policy.request.miss_cost = 5.0;
  ASSERT_TRUE(coordinator.call("set_policy", &policy));
  EXPECT_TRUE(policy.response.success);
  EXPECT_EQ(5.0, policy.response.miss_cost);
  EXPECT_EQ("lamp", coordinator.place());
  policy.request.miss_cost = -1.0;
  ASSERT_TRUE(coordinator.call("set_policy", &policy));
  EXPECT_FALSE(policy.response.success);
  EXPECT_EQ(5.0, policy.response.miss_cost);

  SetEta eta;
  eta.request.eta = 0.75;
  ASSERT_TRUE(coordinator.call("set_eta", &eta));
  EXPECT_TRUE(eta.response.success);
  EXPECT_EQ(0.75, eta.response.eta);
  sensor_msgs::BatteryState half;
  half.percentage = 0.5F;
  battery.publish(half);
  eta.request.eta = 1.5;
  ASSERT_TRUE(coordinator.call("set_eta", &eta));
  EXPECT_FALSE(eta.response.success);
  EXPECT_EQ(0.75, eta.response.eta);  // neither the wrong value nor the battery
  eta.request.by_battery = true;
  EXPECT_TRUE(
      until(TIMEOUT_S, [&] { return coordinator.call("set_eta", &eta) && std::abs(eta.response.eta - 0.3) < 1e-6; }));
  half.percentage = 0.1F;
  battery.publish(half);
  Statistics statistics;
  EXPECT_TRUE(
      until(TIMEOUT_S, [&]
            { return coordinator.call("statistics", &statistics) && std::abs(statistics.response.eta - 0.1) < 1e-6; }));
  EXPECT_EQ("expected_cost", statistics.response.policy);
}

TEST(Coordinator, AnUnmeasuredChargeIsNoFaultAndAWrongOneIs)
{
  CoordinatorOnGraph coordinator("charge");
  DiagnosticCollector diagnostics;
  ros::Publisher battery = ros::NodeHandle("/charge").advertise<sensor_msgs::BatteryState>("battery", 10);
  coordinator.start();
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return battery.getNumSubscribers() == 1; }));
  sensor_msgs::BatteryState state;
  state.percentage = NAN;
  state.charge = NAN;
  state.capacity = 12.0F;
  state.design_capacity = NAN;
  battery.publish(state);
  SetEta eta;
  eta.request.by_battery = true;
  ASSERT_TRUE(coordinator.call("set_eta", &eta));
  EXPECT_TRUE(eta.response.success);
  EXPECT_EQ("the battery decides once it says how full it is", eta.response.message);

  state.percentage = -1.0F;
  battery.publish(state);
  std::vector<std::string> warnings;
  EXPECT_TRUE(diagnostics.waitForStatus("charge/coordinator: input",
                                        [&warnings](const DiagnosticCollector::Status& status)
                                        {
                                          warnings.clear();
                                          for (const auto& value : status.values)
                                          {
                                            if (value.key.find("warning") == 0 && value.value.find("battery: ") == 0)
                                            {
                                              warnings.push_back(value.value);
                                            }
                                          }
                                          return !warnings.empty();
                                        }))
      << diagnostics.text();
  EXPECT_EQ(Texts{"battery: percentage = -1, must be in [0, 1], or NaN if it is not measured; eta stays as it is"},
            warnings);
  state.percentage = 0.5F;
  battery.publish(state);
  Statistics statistics;
  EXPECT_TRUE(
      until(TIMEOUT_S, [&]
            { return coordinator.call("statistics", &statistics) && std::abs(statistics.response.eta - 0.3) < 1e-6; }));
}

TEST(Coordinator, DecideSaysWhereAndWhy)
{
  FakeDetector detector("decide");
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("decide");
  coordinator.start();
  Decide decide;
  decide.request.kind = "detection";
  ASSERT_TRUE(coordinator.call("decide", &decide));
  EXPECT_TRUE(decide.response.success);
  EXPECT_EQ("", decide.response.node);
  EXPECT_NEAR(0.1, decide.response.expected_time, 1e-6);
  EXPECT_GT(decide.response.decision_time, 0.0);
  coordinator.add("lamp", node.address());
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp", "speech"));
  decide.request.kind = "speech";
  decide.request.deadline = 10.0;
  ASSERT_TRUE(coordinator.call("decide", &decide));
  EXPECT_EQ("lamp", decide.response.node);
  EXPECT_GT(decide.response.timeout, 0.0);
  EXPECT_LE(decide.response.timeout, 10.0);
  EXPECT_FALSE(decide.response.reason.empty());
  EXPECT_EQ(0u, node.tasks());  // nothing is done
  decide.request.kind = "slam";
  ASSERT_TRUE(coordinator.call("decide", &decide));
  EXPECT_FALSE(decide.response.success);
  EXPECT_EQ("task kind \"slam\" is not known, must be detection or speech", decide.response.message);
  decide.request.kind = "speech";
  decide.request.deadline = -1.0;
  ASSERT_TRUE(coordinator.call("decide", &decide));
  EXPECT_EQ("deadline = -1, must be in [0, 3600]", decide.response.message);
  decide.request.deadline = 0.0;
  decide.request.input_bytes = 1e12;
  ASSERT_TRUE(coordinator.call("decide", &decide));
  EXPECT_FALSE(decide.response.success);
}

// ------------------------------------------------------------------------------------------------------------- speech

pi_speech::RecognizeUtterance utterance(double deadline_s)
{
  pi_speech::RecognizeUtterance service;
  service.request.header.stamp = ros::Time::now();
  service.request.samples = {1, -2, 300};
  service.request.speech_s = 0.125;
  service.request.deadline = deadline_s;
  service.request.commands = {"stop", "go home"};
  return service;
}

TEST(Coordinator, UtterancesGoToANode)
{
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("speech");
  coordinator.start();
  auto service = utterance(20.0);
  ASSERT_TRUE(ros::service::call("/speech/recognize_utterance", service));
  EXPECT_FALSE(service.response.handled);  // there is no node yet
  coordinator.add("lamp", node.address());
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp", "speech"));
  service = utterance(20.0);
  ASSERT_TRUE(ros::service::call("/speech/recognize_utterance", service));
  EXPECT_TRUE(service.response.handled);
  EXPECT_EQ("stop", service.response.text);
  EXPECT_NEAR(0.9, service.response.confidence, 1e-6);
  EXPECT_TRUE(service.response.accepted);
  EXPECT_EQ("lamp", service.response.node);
  const std::vector<OffloadRequest> tasks = node.requests(Type::TASK);
  ASSERT_EQ(1u, tasks.size());
  EXPECT_EQ(TaskKind::SPEECH, tasks[0].kind);
  EXPECT_EQ(Encoding::S16LE, tasks[0].encoding);
  EXPECT_EQ((std::vector<uint8_t>{1, 0, 0xFE, 0xFF, 0x2C, 0x01}), tasks[0].payload);
  EXPECT_EQ("stop\ngo home", tasks[0].options);
  EXPECT_EQ(0.125, tasks[0].speech_s);
  EXPECT_EQ("remote lamp", coordinator.end(service.request.header.stamp));
  EXPECT_EQ(1u, coordinator.statistics(1).local);
  EXPECT_EQ(1u, coordinator.statistics(1).remote);
  service.request.samples.clear();
  ASSERT_TRUE(ros::service::call("/speech/recognize_utterance", service));
  EXPECT_FALSE(service.response.handled);
}

TEST(Coordinator, CallsEndInTimeWhateverTheNodeDoes)
{
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("speech_late");
  coordinator.set("speech/max_calls", 3);
  coordinator.start();
  coordinator.add("lamp", node.address());
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp", "speech"));
  node.set(Behaviour::HOLD);
  const auto call = [](double deadline_s)
  {
    auto service = utterance(deadline_s);
    EXPECT_TRUE(ros::service::call("/speech_late/recognize_utterance", service));
    return service.response.handled != 0 ? service.response.text : "left to the vehicle";
  };
  EXPECT_EQ("left to the vehicle", call(0.5));
  // Several at a time; one too many is left to the vehicle at once.
  std::vector<std::future<std::string>> calls;
  for (size_t i = 0; i < 3; ++i)
  {
    calls.push_back(std::async(std::launch::async, call, 20.0));
    ASSERT_TRUE(node.waitForTasks(2 + i));
  }
  EXPECT_EQ("left to the vehicle", call(20.0));
  node.release();
  for (std::future<std::string>& one : calls)
  {
    EXPECT_EQ("stop", one.get());
  }
  // A node that dies, and a coordinator that ends, leave nobody waiting.
  std::future<std::string> orphan = std::async(std::launch::async, call, 20.0);
  ASSERT_TRUE(node.waitForTasks(5));
  node.kill();
  EXPECT_EQ("left to the vehicle", orphan.get());
}

TEST(Coordinator, EndsWhileAnUtteranceIsUnderWay)
{
  FakeEdgeNode node;
  CoordinatorOnGraph coordinator("speech_end");
  coordinator.start();
  coordinator.add("lamp", node.address());
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp", "speech"));
  node.set(Behaviour::HOLD);
  std::future<void> call = std::async(std::launch::async,
                                      []
                                      {
                                        auto service = utterance(20.0);
                                        ros::service::call("/speech_end/recognize_utterance", service);
                                        EXPECT_FALSE(service.response.handled);
                                      });
  ASSERT_TRUE(node.waitForTasks(1));
  coordinator.stop();
  call.get();
}

}  // namespace
}  // namespace pi_offload

int main(int argc, char** argv)
{
  return pi_offload::runOnGraph(argc, argv, "coordinator_test");
}
