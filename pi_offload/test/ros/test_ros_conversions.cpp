#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include <pi_detect/ros/conversions.h>
#include "ros/conversions.h"
#include "ros/node_markers.h"

namespace pi_offload
{
namespace
{

using visualization_msgs::Marker;

constexpr double NOT_A_NUMBER = std::numeric_limits<double>::quiet_NaN();
const Eigen::Isometry3d SAME = Eigen::Isometry3d::Identity();

/// Map axes are turned by 90 degrees against odom's, and moved.
Eigen::Isometry3d turned()
{
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  transform.translation() = Eigen::Vector3d(100.0, 0.0, 5.0);
  transform.linear() = Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return transform;
}

nav_msgs::Odometry odometry(double x, double y, double yaw, double speed)
{
  nav_msgs::Odometry message;
  message.pose.pose.position.x = x;
  message.pose.pose.position.y = y;
  message.pose.pose.orientation.z = std::sin(yaw / 2.0);
  message.pose.pose.orientation.w = std::cos(yaw / 2.0);
  message.twist.twist.linear.x = speed;
  return message;
}

NodeDescription someNode()
{
  return {"lamp", "10.0.0.1:5680", {1.5, -2.0}, 80.0, 3.0, 0.0};
}

TEST(Conversions, NodesComeBackAsTheyWere)
{
  const EdgeNode message = toMsg(someNode(), "map");
  EXPECT_EQ("map", message.frame_id);
  const NodeDescription again = fromMsg(message);
  EXPECT_EQ("lamp", again.id);
  EXPECT_EQ("10.0.0.1:5680", again.address);
  EXPECT_EQ(1.5, again.position.x);
  EXPECT_EQ(-2.0, again.position.y);
  EXPECT_EQ(80.0, again.range_m);
  EXPECT_EQ(3.0, again.frequency_ghz);
}

TEST(Conversions, ANodeThatCannotBeIsNamed)
{
  EdgeNode message = toMsg(someNode(), "map");
  message.address = "";
  EXPECT_THROW(fromMsg(message), std::invalid_argument);
  message = toMsg(someNode(), "map");
  message.x = NOT_A_NUMBER;
  EXPECT_THROW(fromMsg(message), std::invalid_argument);
  message = toMsg(someNode(), "map");
  message.id = "a b";
  EXPECT_THROW(fromMsg(message), std::invalid_argument);
  message = toMsg(someNode(), "map");
  message.frequency_ghz = 0.0;  // not known
  EXPECT_EQ(NodeDescription().frequency_ghz, fromMsg(message).frequency_ghz);
}

TEST(Conversions, StatusHasBothKindsOfTasks)
{
  OffloadEngine::NodeStatus status;
  status.description = someNode();
  status.connected = true;
  status.residence.now_s = 12.5;
  status.round_trip_s = 0.004;
  status.service_s = {0.02, 0.15};
  status.queue_s = {0.001, 0.002};
  status.sent = 7;
  status.late = 2;
  const EdgeNodeStatus message = toMsg(status, {9, 4, "it lies"}, 6, "map");
  EXPECT_TRUE(message.connected);
  EXPECT_FALSE(message.in_range);
  EXPECT_EQ(12.5, message.residence);
  EXPECT_EQ((std::vector<std::string>{"detection", "speech"}), message.kinds);
  EXPECT_EQ((std::vector<double>{0.02, 0.15}), message.service_time);
  EXPECT_EQ((std::vector<double>{0.001, 0.002}), message.queue_time);
  EXPECT_EQ(7u, message.sent);
  EXPECT_EQ(2u, message.late);
  EXPECT_EQ(6u, message.unasked);
  EXPECT_EQ(9u, message.checked);
  EXPECT_EQ(4u, message.disagreed);
  EXPECT_EQ("it lies", message.distrusted);
}

TEST(Conversions, ObjectsGetTheVehiclesClassesByNameBestFirstAndWithinThePicture)
{
  std_msgs::Header header;
  header.stamp = ros::Time(5, 6);
  header.frame_id = "camera";
  pi_detect::LabelArray labels;
  labels.ids = {1, 2};
  labels.names = {"car", "person"};
  const std::vector<DetectedObject> objects{{"person", 0.25F, 10.0F, 20.0F, 30.0F, 60.0F},
                                            {"zebra", 0.9F, 1.0F, 2.0F, 3.0F, 4.0F},  // the vehicle has no such class
                                            {"car", 0.5F, -5.0F, 2.0F, 900.0F, 4.0F}};
  const pi_detect::Detection2DArrayPtr message = toMsg(objects, idsByName(labels), 640, 480, header);
  EXPECT_EQ(header.stamp, message->header.stamp);
  EXPECT_EQ("camera", message->header.frame_id);
  const pi_detect::Detections again = pi_detect::fromMsg(*message);
  ASSERT_EQ(2u, again.size());
  EXPECT_EQ(1, again[0].class_id);
  EXPECT_EQ(0.0F, again[0].box.x1);
  EXPECT_EQ(640.0F, again[0].box.x2);
  EXPECT_EQ(2, again[1].class_id);
  EXPECT_EQ(0.25F, again[1].score);
  EXPECT_EQ(10.0F, again[1].box.x1);
  EXPECT_EQ(20.0F, again[1].box.y1);
  EXPECT_EQ(30.0F, again[1].box.x2);
  EXPECT_EQ(60.0F, again[1].box.y2);
  EXPECT_TRUE(toMsg(objects, {}, 640, 480, header)->detections.empty());
}

TEST(Conversions, DecisionsAndStatisticsSayAll)
{
  Outcome outcome;
  outcome.task.kind = TaskKind::SPEECH;
  outcome.task.created_ns = 1000000000;
  outcome.task.deadline_s = 0.5;
  outcome.how = Outcome::How::FALLBACK;
  outcome.node = "lamp";
  outcome.finished_ns = 1250000000;
  outcome.by_deadline = true;
  outcome.energy_j = 0.25;
  outcome.reason = "no answer in time";
  outcome.expected_s = 0.125;
  outcome.expected_j = 0.0625;
  outcome.expected_misses = 0.5;
  outcome.hedged = true;
  const OffloadDecision decision = toMsg(outcome, std_msgs::Header(), true);
  EXPECT_EQ("speech", decision.kind);
  EXPECT_EQ("fallback", decision.how);
  EXPECT_EQ("lamp", decision.node);
  EXPECT_EQ("no answer in time", decision.reason);
  EXPECT_DOUBLE_EQ(0.25, decision.response_time);
  EXPECT_EQ(0.5, decision.deadline);
  EXPECT_TRUE(decision.by_deadline);
  EXPECT_EQ(0.25, decision.energy);
  EXPECT_EQ(0.125, decision.expected_time);
  EXPECT_EQ(0.0625, decision.expected_energy);
  EXPECT_EQ(0.5, decision.expected_misses);
  EXPECT_TRUE(decision.dropped);
  EXPECT_TRUE(decision.hedged);

  OffloadEngine::Statistics::OfKind of_kind;
  of_kind.tasks = 10;
  of_kind.local = 1;
  of_kind.remote = 2;
  of_kind.fallback = 3;
  of_kind.abandoned = 4;
  of_kind.missed = 5;
  of_kind.handovers = 6;
  of_kind.energy_j = 7.0;
  const OffloadStatistics statistics = toMsg(TaskKind::DETECTION, of_kind, 0.1, 0.2);
  EXPECT_EQ("detection", statistics.kind);
  EXPECT_EQ(10u, statistics.tasks);
  EXPECT_EQ(1u, statistics.local);
  EXPECT_EQ(2u, statistics.remote);
  EXPECT_EQ(3u, statistics.fallback);
  EXPECT_EQ(4u, statistics.abandoned);
  EXPECT_EQ(5u, statistics.missed);
  EXPECT_EQ(6u, statistics.handovers);
  EXPECT_EQ(7.0, statistics.energy);
  EXPECT_EQ(0.1, statistics.response_time_p50);
  EXPECT_EQ(0.2, statistics.response_time_p99);
  EXPECT_STREQ("local", toString(Outcome::How::LOCAL));
  EXPECT_STREQ("remote", toString(Outcome::How::REMOTE));
  EXPECT_STREQ("abandoned", toString(Outcome::How::ABANDONED));
}

TEST(Conversions, HeadingIsFromNorthClockwise)
{
  VehicleState state = fromMsg(odometry(3.0, 4.0, 0.0, 2.0), SAME);  // along +X: east
  EXPECT_TRUE(state.known);
  EXPECT_EQ(3.0, state.position.x);
  EXPECT_EQ(4.0, state.position.y);
  EXPECT_NEAR(2.0, state.speed, 1e-12);
  EXPECT_NEAR(1.0, std::sin(state.heading), 1e-12);
  EXPECT_NEAR(0.0, std::cos(state.heading), 1e-12);
  state = fromMsg(odometry(0.0, 0.0, M_PI / 2.0, 2.0), SAME);  // north
  EXPECT_NEAR(1.0, std::cos(state.heading), 1e-12);
}

TEST(Conversions, HeadingIsThatOfTheMotion)
{
  const VehicleState back = fromMsg(odometry(0.0, 0.0, 0.0, -2.0), SAME);
  EXPECT_NEAR(2.0, back.speed, 1e-12);
  EXPECT_NEAR(-1.0, std::sin(back.heading), 1e-12);  // west
  const VehicleState still = fromMsg(odometry(0.0, 0.0, 0.0, 0.0), SAME);
  EXPECT_EQ(0.0, still.speed);
  EXPECT_NEAR(1.0, std::sin(still.heading), 1e-12);  // where it looks
}

TEST(Conversions, PositionIsInTheMap)
{
  const VehicleState state = fromMsg(odometry(3.0, 4.0, 0.0, 2.0), turned());
  EXPECT_NEAR(96.0, state.position.x, 1e-12);
  EXPECT_NEAR(3.0, state.position.y, 1e-12);
  EXPECT_NEAR(1.0, std::cos(state.heading), 1e-12);
  nav_msgs::Path path;
  path.poses.resize(1);
  path.poses[0].pose.position.x = 3.0;
  path.poses[0].pose.position.y = 4.0;
  const std::vector<Point> route = fromMsg(path, turned());
  ASSERT_EQ(1u, route.size());
  EXPECT_NEAR(96.0, route[0].x, 1e-12);
  EXPECT_NEAR(3.0, route[0].y, 1e-12);
}

TEST(Conversions, NumbersThatAreNotFiniteAreNoPosition)
{
  EXPECT_FALSE(fromMsg(odometry(NOT_A_NUMBER, 0.0, 0.0, 0.0), SAME).known);
  EXPECT_FALSE(fromMsg(odometry(0.0, 0.0, 0.0, NOT_A_NUMBER), SAME).known);
  EXPECT_FALSE(fromMsg(nav_msgs::Odometry(), SAME).known);  // a rotation that is none
  nav_msgs::Path path;
  path.poses.resize(2);
  path.poses[1].pose.position.y = NOT_A_NUMBER;
  EXPECT_THROW(fromMsg(path, SAME), std::invalid_argument);
  EXPECT_TRUE(fromMsg(nav_msgs::Path(), SAME).empty());
}

TEST(Conversions, ChargeIsThePercentageOrChargeByCapacity)
{
  sensor_msgs::BatteryState message;
  message.percentage = 0.5F;
  EXPECT_EQ(0.5, chargeOf(message));
  message.percentage = static_cast<float>(NOT_A_NUMBER);
  message.charge = 3.0F;
  message.capacity = 4.0F;
  EXPECT_EQ(0.75, chargeOf(message));
  message.capacity = static_cast<float>(NOT_A_NUMBER);
  message.design_capacity = 6.0F;
  EXPECT_EQ(0.5, chargeOf(message));
  message.charge = static_cast<float>(NOT_A_NUMBER);
  EXPECT_FALSE(chargeOf(message));
}

// ------------------------------------------------------------------------------------------------------------- markers

OffloadEngine::NodeStatus shown(const std::string& id, bool connected, bool in_range, double range_m)
{
  OffloadEngine::NodeStatus status;
  status.description = {id, "h:1", {10.0, 20.0}, range_m, 3.0, 0.0};
  status.connected = connected;
  status.in_range = in_range;
  status.round_trip_s = 0.0042;
  status.queue_s = {0.012, 0.0};
  return status;
}

/// By group and number.
std::map<std::pair<std::string, int>, Marker> byName(const visualization_msgs::MarkerArray& array)
{
  std::map<std::pair<std::string, int>, Marker> markers;
  for (const Marker& marker : array.markers)
  {
    markers[{marker.ns, marker.id}] = marker;
  }
  return markers;
}

TEST(NodeMarkers, ShowNodeRangeNameAndLink)
{
  NodeMarkers markers("map");
  VehicleState vehicle;
  vehicle.known = true;
  vehicle.position = {1.0, 2.0};
  const auto array = markers.update({shown("lamp", true, true, 50.0)}, vehicle, {"lamp", ""}, ros::Time(3, 0));
  const auto by_name = byName(*array);
  ASSERT_EQ(4u, by_name.size());
  for (const Marker& marker : array->markers)
  {
    EXPECT_EQ("map", marker.header.frame_id);
    EXPECT_EQ(ros::Time(3, 0), marker.header.stamp);
    EXPECT_EQ(static_cast<int>(Marker::ADD), marker.action);
  }
  EXPECT_EQ("lamp 4.2 ms, queue 12 ms", by_name.at({"names", 0}).text);
  const Marker& range = by_name.at({"ranges", 0});
  for (const auto& point : range.points)
  {
    EXPECT_NEAR(50.0, std::hypot(point.x - 10.0, point.y - 20.0), 1e-9);
  }
  const Marker& link = by_name.at({"links", 0});
  ASSERT_EQ(2u, link.points.size());
  EXPECT_EQ(1.0, link.points[0].x);
  EXPECT_EQ(20.0, link.points[1].y);
  EXPECT_GT(by_name.at({"nodes", 0}).color.g, 0.7F);  // in use
}

TEST(NodeMarkers, ColourSaysTheState)
{
  NodeMarkers markers("map");
  const auto by_name = byName(
      *markers.update({shown("a", true, true, INFINITY), shown("b", true, false, 50.0), shown("c", false, true, 50.0)},
                      VehicleState(), {"", ""}, ros::Time(1, 0)));
  EXPECT_EQ(0u, by_name.count({"ranges", 0}));  // everywhere
  EXPECT_GT(by_name.at({"nodes", 0}).color.b, 0.9F);
  EXPECT_GT(by_name.at({"nodes", 1}).color.r, 0.9F);
  EXPECT_EQ(by_name.at({"nodes", 2}).color.r, by_name.at({"nodes", 2}).color.b);
  EXPECT_EQ("c not connected", by_name.at({"names", 2}).text);
}

TEST(NodeMarkers, VanishedNodesAreDeletedOnce)
{
  NodeMarkers markers("map");
  markers.update({shown("a", true, true, 50.0), shown("b", true, true, 50.0)}, VehicleState(), {"", ""},
                 ros::Time(1, 0));
  const auto by_name =
      byName(*markers.update({shown("b", true, true, 50.0)}, VehicleState(), {"", ""}, ros::Time(2, 0)));
  EXPECT_EQ(static_cast<int>(Marker::DELETE), by_name.at({"nodes", 0}).action);
  EXPECT_EQ(static_cast<int>(Marker::DELETE), by_name.at({"names", 0}).action);
  EXPECT_EQ(static_cast<int>(Marker::DELETE), by_name.at({"ranges", 0}).action);
  EXPECT_EQ(static_cast<int>(Marker::ADD), by_name.at({"nodes", 1}).action);
  EXPECT_EQ(3u,
            markers.update({shown("b", true, true, 50.0)}, VehicleState(), {"", ""}, ros::Time(3, 0))->markers.size());
}

}  // namespace
}  // namespace pi_offload
