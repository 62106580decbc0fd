#include "ros/navigation/navigation_conversions.h"

#include <gtest/gtest.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <limits>
#include <vector>

namespace pi_vehicle
{
namespace
{

constexpr double NaN = std::numeric_limits<double>::quiet_NaN();

geometry_msgs::Pose makePose(double x, double y, double heading)
{
  geometry_msgs::Pose pose;
  pose.position.x = x;
  pose.position.y = y;
  pose.orientation.z = std::sin(0.5 * heading);
  pose.orientation.w = std::cos(0.5 * heading);
  return pose;
}

TEST(NavigationConversions, PosesKeepPlaceAndHeading)
{
  geometry_msgs::Transform transform;
  transform.translation.x = 10.0;
  transform.rotation.z = transform.rotation.w = std::sqrt(0.5);  // a quarter turn to the left
  const Pose2 pose = toPose2(toIsometry(transform) * toIsometry(makePose(2.0, 1.0, 0.3)));
  EXPECT_NEAR(9.0, pose.x, 1e-9);
  EXPECT_NEAR(2.0, pose.y, 1e-9);
  EXPECT_NEAR(M_PI_2 + 0.3, pose.heading, 1e-9);
}

TEST(NavigationConversions, AWaypointWithoutOrientationHasNoHeading)
{
  geometry_msgs::Pose pose = makePose(1.0, 2.0, 0.7);
  EXPECT_NEAR(0.7, toWaypoint(pose, Eigen::Isometry3d::Identity()).heading.value(), 1e-9);
  pose.orientation = geometry_msgs::Quaternion();
  EXPECT_FALSE(toWaypoint(pose, Eigen::Isometry3d::Identity()).heading);
  EXPECT_EQ(Eigen::Vector2d(1.0, 2.0), toWaypoint(pose, Eigen::Isometry3d::Identity()).position);
  pose.orientation.x = NaN;
  EXPECT_TRUE(std::isnan(toWaypoint(pose, Eigen::Isometry3d::Identity()).heading.value()));
  pose = makePose(NaN, 2.0, 0.0);
  EXPECT_FALSE(toWaypoint(pose, Eigen::Isometry3d::Identity()).position.allFinite());
}

TEST(NavigationConversions, DeviationIsThatOfTheWorstDirection)
{
  nav_msgs::Odometry odometry;
  EXPECT_EQ(0.0, positionDeviation(odometry.pose));  // unknown
  odometry.pose.covariance[0] = 0.04;
  odometry.pose.covariance[7] = 0.25;
  EXPECT_NEAR(0.5, positionDeviation(odometry.pose), 1e-12);
  odometry.pose.covariance[0] = odometry.pose.covariance[7] = 1.0;
  odometry.pose.covariance[1] = odometry.pose.covariance[6] = 0.44;
  EXPECT_NEAR(1.2, positionDeviation(odometry.pose), 1e-12);
  odometry.pose.covariance[0] = -1.0;
  odometry.pose.covariance[7] = -1.0;
  odometry.pose.covariance[1] = odometry.pose.covariance[6] = 0.0;
  EXPECT_EQ(0.0, positionDeviation(odometry.pose));
  odometry.pose.covariance[7] = NaN;
  EXPECT_TRUE(std::isnan(positionDeviation(odometry.pose)));
}

TEST(NavigationConversions, NamesModesThatDoNotDrive)
{
  VehicleState state;
  state.detail = "the button";
  for (const uint8_t mode : {VehicleState::READY, VehicleState::DRIVING, VehicleState::STOPPED_WATCHDOG})
  {
    state.mode = mode;
    EXPECT_EQ("", vehicleProblem(state));
  }
  state.mode = VehicleState::EMERGENCY_STOP;
  EXPECT_EQ("emergency stop: the button", vehicleProblem(state));
  state.mode = VehicleState::FAULT;
  EXPECT_EQ("fault: the button", vehicleProblem(state));
  state.mode = VehicleState::DISCONNECTED;
  state.detail.clear();
  EXPECT_EQ("disconnected", vehicleProblem(state));
}

TEST(NavigationConversions, ObstaclesBecomeBoxes)
{
  pi_detect::ObstacleArray array;
  array.obstacles.resize(1);
  pi_detect::Obstacle3D& obstacle = array.obstacles.front();
  obstacle.id = 42;
  obstacle.position.x = 5.0;
  obstacle.position.y = -1.0;
  obstacle.size.x = 0.4;
  obstacle.size.y = 0.6;
  obstacle.velocity.y = 1.2;
  obstacle.moving = 1;
  obstacle.age = ros::Duration(0.9);
  obstacle.since_seen = ros::Duration(0.25);
  const std::vector<ObstacleBox> boxes = toObstacleBoxes(array);
  ASSERT_EQ(1u, boxes.size());
  EXPECT_EQ(42, boxes[0].id);
  EXPECT_EQ(Eigen::Vector2d(5.0, -1.0), boxes[0].position);
  EXPECT_EQ(Eigen::Vector2d(0.4, 0.6), boxes[0].size);
  EXPECT_EQ(Eigen::Vector2d(0.0, 1.2), boxes[0].velocity);
  EXPECT_TRUE(boxes[0].moving);
  EXPECT_NEAR(0.65, boxes[0].followed_s, 1e-9);
  EXPECT_NEAR(0.25, boxes[0].unseen_s, 1e-9);
  EXPECT_TRUE(boxes[0].outline.empty());
}

geometry_msgs::Point32 makeCorner(float x, float y)
{
  geometry_msgs::Point32 corner;
  corner.x = x;
  corner.y = y;
  return corner;
}

TEST(NavigationConversions, OutlinesGoWithTheirBoxes)
{
  pi_detect::ObstacleArray array;
  array.obstacles.resize(2);
  array.obstacles[1].outline = {makeCorner(4.0F, -1.5F), makeCorner(5.5F, -1.0F), makeCorner(4.5F, 0.25F)};
  const std::vector<ObstacleBox> boxes = toObstacleBoxes(array);
  ASSERT_EQ(2u, boxes.size());
  EXPECT_TRUE(boxes[0].outline.empty());
  const std::vector<Eigen::Vector2d> expected = {{4.0, -1.5}, {5.5, -1.0}, {4.5, 0.25}};
  EXPECT_EQ(expected, boxes[1].outline);
  EXPECT_TRUE(GroundPolygon::isOutline(boxes[1].outline));
}

TEST(NavigationConversions, MarkersShowTheOutlineOfTheObstacleThatLimits)
{
  NavigationView view;
  view.base_link_frame = "base_link";
  auto obstacles = boost::make_shared<pi_detect::ObstacleArray>();
  obstacles->obstacles.resize(1);
  obstacles->obstacles[0].id = 9;
  obstacles->obstacles[0].size.z = 1.5;
  obstacles->obstacles[0].outline = {makeCorner(4.0F, -1.5F), makeCorner(5.5F, -1.0F), makeCorner(4.5F, 0.25F)};
  view.obstacles = obstacles;
  view.output.obstacle_id = 9;
  const visualization_msgs::MarkerArray array = toMarkers(view);
  ASSERT_EQ(1u, array.markers.size());
  EXPECT_EQ(visualization_msgs::Marker::LINE_LIST, array.markers[0].type);
  ASSERT_EQ(3u * 3 * 2, array.markers[0].points.size()) << "below, above and at each corner";
  EXPECT_EQ(1.5, array.markers[0].points[2].z);
  EXPECT_EQ(0.0, array.markers[0].pose.position.x);
}

TEST(NavigationConversions, ARouteHasEvenPosesAndBothEnds)
{
  const Path path({{0.0, 0.0}, {5.0, 0.0}, {10.0, 0.0}});
  const nav_msgs::Path message = toMsg(path, 0.3, ros::Time(7.0), "map");
  ASSERT_EQ(35u, message.poses.size());
  EXPECT_EQ("map", message.header.frame_id);
  EXPECT_EQ(0.0, message.poses.front().pose.position.x);
  EXPECT_EQ(10.0, message.poses.back().pose.position.x);
  for (size_t i = 1; i < message.poses.size(); ++i)
  {
    EXPECT_LE(message.poses[i].pose.position.x - message.poses[i - 1].pose.position.x, 0.3 + 1e-9);
  }
  const Path loop({{0.0, 0.0}, {10.0, 0.0}, {10.0, 10.0}, {0.0, 10.0}}, true);
  const nav_msgs::Path round = toMsg(loop, 0.3, ros::Time(7.0), "map");
  EXPECT_NEAR(0.0, round.poses.back().pose.position.x, 1e-9);
  EXPECT_NEAR(0.0, round.poses.back().pose.position.y, 1e-9);
  EXPECT_TRUE(toMsg(Path(), 0.3, ros::Time(7.0), "map").poses.empty());
}

TEST(NavigationConversions, MarkersShowTheObstacleThatLimits)
{
  NavigationView view;
  view.map_frame = "map";
  view.base_link_frame = "base_link";
  EXPECT_TRUE(toMarkers(view).markers.empty());
  view.way = {Pose2(), Pose2{1.0, 0.0, 0.0}};
  view.look_ahead = Eigen::Vector2d(3.0, 4.0);
  auto obstacles = boost::make_shared<pi_detect::ObstacleArray>();
  obstacles->header.frame_id = "base_link";
  obstacles->obstacles.resize(2);
  obstacles->obstacles[1].id = 9;
  obstacles->obstacles[1].position.x = 6.0;
  view.obstacles = obstacles;
  view.output.state = NavigatorState::HELD_UP;
  view.output.obstacle_id = 9;
  const visualization_msgs::MarkerArray array = toMarkers(view);
  ASSERT_EQ(4u, array.markers.size());
  EXPECT_EQ("way_ahead", array.markers[0].ns);
  EXPECT_EQ(2u, array.markers[0].points.size());
  EXPECT_EQ("map", array.markers[1].header.frame_id);
  EXPECT_EQ(6.0, array.markers[2].pose.position.x);
  EXPECT_GT(array.markers[2].scale.x, 0.0);
  EXPECT_EQ(0u, array.markers[3].text.find("held up"));
  view.output.obstacle_id = 10;  // not in the last report
  EXPECT_EQ(3u, toMarkers(view).markers.size());
}

}  // namespace
}  // namespace pi_vehicle
