// Judge of navigation.test.

#include "ros/child_node.h"
#include "simulated_car.h"

#include <actionlib/client/simple_action_client.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <gtest/gtest.h>
#include <move_base_msgs/MoveBaseAction.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_vehicle/DriveAction.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/transform_broadcaster.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr double DRIVE_S = 90.0;  // longest that a test waits for the end of a drive
constexpr double NaN = std::numeric_limits<double>::quiet_NaN();
const Pose2 T_MAP_ODOM{3.0, -2.0, 0.5};

geometry_msgs::Pose toPose(const Pose2& pose)
{
  geometry_msgs::Pose message;
  message.position.x = pose.x;
  message.position.y = pose.y;
  message.orientation.z = std::sin(0.5 * pose.heading);
  message.orientation.w = std::cos(0.5 * pose.heading);
  return message;
}

/// A car with localisation and obstacle detection, in wall time, that does what motion/navigation says.
class Vehicle
{
public:
  struct World
  {
    bool localised = true;               // odometry comes
    bool mapped = true;                  // tf map -> odom comes
    double variance = 0.01;              // of odometry, along x and y
    std::optional<double> map_variance;  // of map_pose, if there is one
    uint8_t mode = VehicleState::READY;
    std::string detail;
    std::optional<Eigen::Vector2d> obstacle;  // in the map
    bool sees_ground = false;                 // all of it free, where the obstacle is not
  };

  Vehicle()
  {
    ros::NodeHandle node;
    map_pose_ = node.advertise<geometry_msgs::PoseWithCovarianceStamped>("map_pose", 10);
    odometry_ = node.advertise<nav_msgs::Odometry>("odometry", 10);
    state_ = node.advertise<VehicleState>("vehicle_state", 10);
    obstacles_ = node.advertise<pi_detect::ObstacleArray>("obstacles", 10);
    grid_ = node.advertise<nav_msgs::OccupancyGrid>("grid", 1);
    motion_ = node.subscribe<MotionCommand>(
        "motion/navigation", 1,
        [this](const MotionCommandConstPtr& message)
        {
          std::lock_guard<std::mutex> lock(mutex_);
          command_ = {message->speed, message->curvature, message->max_deceleration, message->source, message->reason};
        });
    thread_ = std::thread([this] { run(); });
  }
  ~Vehicle()
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      stopping_ = true;
    }
    thread_.join();
  }
  Vehicle(const Vehicle&) = delete;
  Vehicle& operator=(const Vehicle&) = delete;

  template <typename Change>
  void set(Change&& change)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    change(world_);
  }
  SimulatedCar car() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return car_;
  }
  bool stands() const { return std::abs(car().speed()) < 0.02; }
  bool waitForSpeed(double speed) const
  {
    return until(TIMEOUT_S, [this, speed] { return car().speed() > speed; });
  }
  bool waitForStandstill() const
  {
    return until(TIMEOUT_S, [this] { return stands(); });
  }
  double distanceTo(const Eigen::Vector2d& point) const { return (car().pose().position() - point).norm(); }

private:
  void run()
  {
    using Clock = std::chrono::steady_clock;
    Clock::time_point last = Clock::now();
    for (uint32_t count = 0;; ++count)
    {
      std::this_thread::sleep_until(last + std::chrono::milliseconds(20));
      const Clock::time_point now = Clock::now();
      const double dt = std::chrono::duration<double>(now - last).count();
      last = now;
      std::unique_lock<std::mutex> lock(mutex_);
      if (stopping_)
      {
        return;
      }
      car_.step(world_.mode == VehicleState::EMERGENCY_STOP ? DriveCommand() : command_, dt);
      const World world = world_;
      const SimulatedCar car = car_;
      lock.unlock();
      publish(world, car, count);
    }
  }

  void publish(const World& world, const SimulatedCar& car, uint32_t count)
  {
    const ros::Time stamp = ros::Time::now();
    VehicleState state;
    state.header.stamp = stamp;
    state.speed = car.speed();
    state.curvature = car.curvature();
    state.mode = world.mode;
    state.detail = world.detail;
    state_.publish(state);
    if (world.mapped)
    {
      geometry_msgs::TransformStamped transform;
      transform.header.stamp = stamp;
      transform.header.frame_id = "map";
      transform.child_frame_id = "odom";
      const geometry_msgs::Pose pose = toPose(T_MAP_ODOM);
      transform.transform.translation.x = pose.position.x;
      transform.transform.translation.y = pose.position.y;
      transform.transform.rotation = pose.orientation;
      broadcaster_.sendTransform(transform);
    }
    if (world.localised)
    {
      nav_msgs::Odometry odometry;
      odometry.header.stamp = stamp;
      odometry.header.frame_id = "odom";
      odometry.child_frame_id = "base_link";
      odometry.pose.pose = toPose(T_MAP_ODOM.inverse() * car.pose());
      odometry.pose.covariance[0] = odometry.pose.covariance[7] = world.variance;
      odometry_.publish(odometry);
      if (world.map_variance)
      {
        geometry_msgs::PoseWithCovarianceStamped pose;
        pose.header.stamp = stamp;
        pose.header.frame_id = "map";
        pose.pose.pose = toPose(car.pose());
        pose.pose.covariance[0] = pose.pose.covariance[7] = *world.map_variance;
        map_pose_.publish(pose);
      }
    }
    if (count % 5 == 0)
    {
      pi_detect::ObstacleArray obstacles;
      obstacles.header.stamp = stamp;
      obstacles.header.frame_id = "base_link";
      if (world.obstacle)
      {
        pi_detect::Obstacle3D obstacle;
        const Eigen::Vector2d place = car.pose().inverse() * *world.obstacle;
        obstacle.id = 5;
        obstacle.position.x = place.x();
        obstacle.position.y = place.y();
        obstacle.size.x = obstacle.size.y = 0.5;
        obstacle.size.z = 1.7;
        obstacles.obstacles.push_back(obstacle);
      }
      obstacles_.publish(obstacles);
      if (world.sees_ground)
      {
        nav_msgs::OccupancyGrid grid;
        grid.header.stamp = stamp;
        grid.header.frame_id = "odom";
        grid.info.resolution = 0.2F;
        grid.info.width = grid.info.height = 200;
        grid.info.origin = toPose(T_MAP_ODOM.inverse() * Pose2{car.pose().x - 20.0, -20.0, 0.0});
        grid.data.assign(200 * 200, 0);
        grid_.publish(grid);
      }
    }
  }

  ros::Publisher map_pose_;
  ros::Publisher odometry_;
  ros::Publisher state_;
  ros::Publisher obstacles_;
  ros::Publisher grid_;
  ros::Subscriber motion_;
  tf2_ros::TransformBroadcaster broadcaster_;
  mutable std::mutex mutex_;
  bool stopping_ = false;
  World world_;
  DriveCommand command_;
  SimulatedCar car_;
  std::thread thread_;
};

class NavigationNode : public testing::Test
{
protected:
  using Client = actionlib::SimpleActionClient<DriveAction>;
  using State = actionlib::SimpleClientGoalState;

  void SetUp() override
  {
    ros::param::set("/navigation/diagnostic_period", 0.1);
    ros::param::set("/navigation/tf_timeout_s", 0.5);
    ros::param::set("/navigation/places/gate", std::vector<double>{15.0, 3.0, 0.0});
    ros::param::set("/navigation/places/far", std::vector<double>{60.0, 0.0});
    start();
  }
  void start()
  {
    ASSERT_TRUE(loadNodelet("/navigation", "pi_vehicle/navigation"));
    ASSERT_TRUE(client_.waitForServer(ros::Duration(TIMEOUT_S)));
    ASSERT_TRUE(until(TIMEOUT_S, [this] { return goals_.getNumSubscribers() > 0; }));
  }
  void TearDown() override
  {
    unloadNodelet("/navigation");
    ros::param::del("/navigation");
  }

  void send(const DriveGoal& goal)
  {
    client_.sendGoal(goal, Client::SimpleDoneCallback(), Client::SimpleActiveCallback(),
                     [this](const DriveFeedbackConstPtr& feedback)
                     {
                       std::lock_guard<std::mutex> lock(mutex_);
                       feedback_ = *feedback;
                     });
  }
  void send(const std::string& place)
  {
    DriveGoal goal;
    goal.places.push_back(place);
    send(goal);
  }
  DriveFeedback feedback() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return feedback_;
  }
  bool waitForFeedback(const std::string& state, const std::string& part)
  {
    return until(TIMEOUT_S,
                 [&]
                 {
                   const DriveFeedback now = feedback();
                   return now.state == state && now.reason.find(part) != std::string::npos;
                 });
  }
  bool waitForEnd(State::StateEnum state)
  {
    return client_.waitForResult(ros::Duration(DRIVE_S)) && client_.getState().state_ == state;
  }
  std::string message() { return client_.getResult() ? client_.getResult()->message : "no result"; }
  std::string text()
  {
    const auto command = motions_.last();
    return client_.getState().toString() + " " + client_.getState().getText() + "; feedback: " + feedback().state +
           ": " + feedback().reason + "; motion: " + (command ? command->reason : "none") + "; at " +
           std::to_string(vehicle_.car().pose().x) + ", " + std::to_string(vehicle_.car().pose().y);
  }

  Vehicle vehicle_;
  Client client_{"drive", false};
  ros::Publisher goals_ = ros::NodeHandle().advertise<geometry_msgs::PoseStamped>("goal", 1);
  Collector<MotionCommand> motions_{"motion/navigation"};
  Collector<nav_msgs::Path> routes_{"route"};
  DiagnosticCollector diagnostics_;
  mutable std::mutex mutex_;
  DriveFeedback feedback_;
};

TEST_F(NavigationNode, ReachesAGoalOfTheAction)
{
  const Collector<visualization_msgs::MarkerArray> markers("navigation/markers");
  send("gate");
  ASSERT_TRUE(waitForEnd(State::SUCCEEDED)) << text();
  EXPECT_LE(vehicle_.distanceTo({15.0, 3.0}), 0.5);
  EXPECT_NEAR(0.0, vehicle_.car().pose().heading, 0.2);
  const auto result = client_.getResult();
  EXPECT_TRUE(result->success);
  EXPECT_EQ("at the goal", result->message);
  EXPECT_NEAR(vehicle_.car().travel(), result->distance, 2.0);
  EXPECT_GT(result->duration.toSec(), 3.0);

  EXPECT_TRUE(routes_.waitFor(
      [](const nav_msgs::Path& route)
      {
        return route.header.frame_id == "map" && route.poses.size() > 20 &&
               std::hypot(route.poses.back().pose.position.x - 15.0, route.poses.back().pose.position.y - 3.0) < 0.1;
      }));
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return routes_.last()->poses.empty(); }));  // there is none any more
  EXPECT_TRUE(diagnostics_.waitForSummary("navigation: navigation", OK, "driving: ")) << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForValue("navigation: navigation", "speed limit set by", "path"));
  EXPECT_TRUE(diagnostics_.waitForSummary("navigation: navigation", OK, "idle: no goal")) << diagnostics_.text();
  EXPECT_TRUE(markers.waitFor([](const visualization_msgs::MarkerArray& array)
                              { return !array.markers.empty() && array.markers[0].ns == "way_ahead"; }));
  EXPECT_EQ("driving", feedback().state);
  EXPECT_GT(feedback().progress, 0.5);
}

TEST_F(NavigationNode, DrivesOnToItsGoalAfterItWasKilled)
{
  unloadNodelet("/navigation");
  auto node = std::make_unique<test::ChildNode>(NAVIGATION_NODE, "navigation");
  ASSERT_TRUE(client_.waitForServer(ros::Duration(TIMEOUT_S)));
  DriveGoal goal;
  goal.places = {"gate", "far"};
  goal.max_speed = 2.0;
  send(goal);
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return vehicle_.car().pose().x > 18.0; })) << text();
  XmlRpc::XmlRpcValue kept;
  ASSERT_TRUE(until(TIMEOUT_S,
                    [&kept] { return ros::param::get("/navigation/kept_goal", kept) && kept["points"].size() == 1; }))
      << text();
  node->end(SIGKILL);
  node.reset();
  node = std::make_unique<test::ChildNode>(NAVIGATION_NODE, "navigation");

  ASSERT_TRUE(waitForEnd(State::SUCCEEDED)) << text();
  EXPECT_LE(vehicle_.distanceTo({60.0, 0.0}), 0.5);
  ASSERT_TRUE(until(TIMEOUT_S, [&kept]
                    { return ros::param::get("/navigation/kept_goal", kept) && kept == XmlRpc::XmlRpcValue(""); }));
  EXPECT_EQ(0, node->end(SIGINT));
  EXPECT_TRUE(loadNodelet("/navigation", "pi_vehicle/navigation"));  // for TearDown
}

TEST_F(NavigationNode, ForgetsAGoalOfLongAgo)
{
  unloadNodelet("/navigation");
  XmlRpc::XmlRpcValue kept;
  kept["points"][0][0] = 60.0;
  kept["points"][0][1] = 0.0;
  kept["max_speed"] = 0.0;
  kept["loop"] = false;
  kept["id"] = "of long ago";
  kept["stamp"] = ros::Time::now().toSec() - 3700.0;
  kept["alive"] = ros::Time::now().toSec() - 3600.0;
  ros::param::set("/navigation/kept_goal", kept);
  start();
  EXPECT_TRUE(diagnostics_.waitForSummary("navigation: navigation", OK, "idle: no goal")) << diagnostics_.text();
  EXPECT_TRUE(until(TIMEOUT_S, [&kept]
                    { return ros::param::get("/navigation/kept_goal", kept) && kept == XmlRpc::XmlRpcValue(""); }));
}

TEST_F(NavigationNode, SpeaksSteadilyWithoutAGoalAlsoAsANodeOfItsOwn)
{
  const Collector<MotionCommand> alone("alone/motion/navigation");
  for (const Collector<MotionCommand>* motions : {&alone, &std::as_const(motions_)})
  {
    ASSERT_TRUE(until(TIMEOUT_S, [motions] { return motions->messages().size() >= 40; }));
    for (const auto& command : motions->messages())
    {
      EXPECT_EQ(0.0, command->speed);
      EXPECT_EQ("no goal", command->reason);
      EXPECT_EQ("navigation", command->source);
      EXPECT_FALSE(command->header.stamp.isZero());
    }
  }
  EXPECT_EQ(0.0, vehicle_.car().travel());
}

TEST_F(NavigationNode, StopsBeforeAnObstacleAndGoesOnWhenItIsGone)
{
  DriveGoal goal;
  goal.waypoints.resize(1);
  goal.waypoints[0].pose.position.x = 20.0;  // in the map, with any heading
  send(goal);
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  const double x = std::max(12.0, vehicle_.car().pose().x + 8.0);
  vehicle_.set([x](Vehicle::World& world) { world.obstacle = Eigen::Vector2d(x, 0.0); });
  ASSERT_TRUE(waitForFeedback("held up", "obstacle 5")) << text();
  ASSERT_TRUE(vehicle_.waitForStandstill()) << text();
  EXPECT_LT(vehicle_.car().pose().x + 1.0, x - 0.25) << text();
  EXPECT_TRUE(diagnostics_.waitForValue("navigation: navigation", "obstacle", "5")) << diagnostics_.text();
  vehicle_.set([](Vehicle::World& world) { world.obstacle.reset(); });
  ASSERT_TRUE(waitForEnd(State::SUCCEEDED)) << text();
  EXPECT_LE(vehicle_.distanceTo({20.0, 0.0}), 0.5);
}

TEST_F(NavigationNode, PassesAnObstacleWhereTheGroundIsSeenToBeFree)
{
  DriveGoal goal;
  goal.waypoints.resize(1);
  goal.waypoints[0].pose.position.x = 40.0;
  vehicle_.set(
      [](Vehicle::World& world)
      {
        world.obstacle = Eigen::Vector2d(20.0, 0.0);
        world.sees_ground = true;
      });
  send(goal);
  ASSERT_TRUE(waitForFeedback("driving", "on the left")) << text();
  ASSERT_TRUE(until(60.0, [this] { return vehicle_.car().pose().x > 20.0; })) << text();
  EXPECT_GE(vehicle_.car().pose().y, 1.2) << text();
  ASSERT_TRUE(waitForEnd(State::SUCCEEDED)) << text();
  EXPECT_LE(vehicle_.distanceTo({40.0, 0.0}), 0.5);
}

TEST_F(NavigationNode, AGoalBehindAWallIsDrivenToRoundTheWallOfTheMap)
{
  ros::Publisher map = ros::NodeHandle().advertise<nav_msgs::OccupancyGrid>("map", 1, true);
  nav_msgs::OccupancyGrid grid;
  grid.header.frame_id = "map";
  grid.info.resolution = 0.2F;
  grid.info.width = grid.info.height = 200;
  grid.info.origin = toPose({-10.0, -20.0, 0.0});
  grid.data.assign(200 * 200, 0);
  for (int row = 60; row < 130; ++row)  // y from -8 to 6, x = 10
  {
    grid.data[static_cast<size_t>(row * 200 + 100)] = 100;
  }
  map.publish(grid);
  ros::Publisher simple = ros::NodeHandle().advertise<geometry_msgs::PoseStamped>("goal", 1);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return simple.getNumSubscribers() > 0 && map.getNumSubscribers() > 0; }));
  geometry_msgs::PoseStamped behind;
  behind.header.frame_id = "map";
  behind.pose.position.x = 22.0;
  simple.publish(behind);  // the map is latched, and of the same queue: it may come later than the goal
  ASSERT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      if (vehicle_.car().pose().y > 1.0)
                      {
                        return true;
                      }
                      if (vehicle_.car().pose().x < 1.0)
                      {
                        simple.publish(behind);
                      }
                      return false;
                    }))
      << text();
  ASSERT_TRUE(until(60.0, [this] { return vehicle_.car().pose().x > 10.0; })) << text();
  EXPECT_GE(vehicle_.car().pose().y, 6.5) << text();
  ASSERT_TRUE(until(60.0, [this] { return vehicle_.distanceTo({22.0, 0.0}) < 0.5; })) << text();
}

TEST_F(NavigationNode, StopsWhenLocalisationIsLostAndGoesOn)
{
  send("far");
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  vehicle_.set([](Vehicle::World& world) { world.localised = false; });
  ASSERT_TRUE(waitForFeedback("stopped", "pose is ")) << text();
  ASSERT_TRUE(vehicle_.waitForStandstill()) << text();
  EXPECT_TRUE(diagnostics_.waitForSummary("navigation: navigation", WARN, "stopped: pose is")) << diagnostics_.text();
  vehicle_.set([](Vehicle::World& world) { world.localised = true; });
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  vehicle_.set([](Vehicle::World& world) { world.mapped = false; });
  ASSERT_TRUE(waitForFeedback("stopped", "no localisation: tf map -> odom is older than tf_timeout_s = 0.5 s"))
      << text();
  ASSERT_TRUE(vehicle_.waitForStandstill()) << text();
  vehicle_.set([](Vehicle::World& world) { world.mapped = true; });
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
}

TEST_F(NavigationNode, TheMapMayKnowThePositionBetterThanOdometry)
{
  vehicle_.set([](Vehicle::World& world) { world.map_variance = 0.04; });
  send("far");
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  vehicle_.set([](Vehicle::World& world) { world.variance = 4.0; });
  ASSERT_TRUE(diagnostics_.waitForValue("navigation: navigation", "localisation", "known to 0.20 m"))
      << diagnostics_.text();
  vehicle_.set([](Vehicle::World& world) { world.map_variance = 2.25; });
  ASSERT_TRUE(waitForFeedback("stopped", "the position is known to 1.5 m only")) << text();
}

TEST_F(NavigationNode, CancelStopsSmoothly)
{
  send("far");
  ASSERT_TRUE(vehicle_.waitForSpeed(1.0)) << text();
  motions_.clear();
  client_.cancelGoal();
  ASSERT_TRUE(waitForEnd(State::PREEMPTED)) << text();
  EXPECT_EQ("cancelled by the client of the action", message());
  EXPECT_TRUE(vehicle_.waitForStandstill()) << text();
  for (const auto& command : motions_.messages())
  {
    EXPECT_LE(command->max_deceleration, 1.0) << command->reason;
  }
  std_srvs::Trigger trigger;
  ASSERT_TRUE(ros::service::call("navigation/cancel", trigger));
  EXPECT_FALSE(trigger.response.success);
  send("far");
  ASSERT_TRUE(vehicle_.waitForSpeed(1.0)) << text();
  ASSERT_TRUE(ros::service::call("navigation/cancel", trigger));
  EXPECT_TRUE(trigger.response.success);
  ASSERT_TRUE(waitForEnd(State::PREEMPTED)) << text();
}

TEST_F(NavigationNode, RefusesWhatCannotBeDriven)
{
  ASSERT_TRUE(diagnostics_.waitForValue("navigation: navigation", "localisation", "known to 0.10 m"))
      << diagnostics_.text();
  const auto refusal = [this](const DriveGoal& goal) -> std::string
  {
    send(goal);
    return waitForEnd(State::REJECTED) ? message() : "not refused: " + text();
  };
  EXPECT_EQ("the goal has no place and no waypoint: give one or more", refusal(DriveGoal()));
  DriveGoal goal;
  goal.places = {"gate", "moon"};
  EXPECT_EQ("there is no place \"moon\"; known are far, gate", refusal(goal));
  goal.places.clear();
  goal.waypoints.resize(1);
  goal.waypoints[0].pose.position.y = NaN;
  EXPECT_EQ("point 1 of the goal has a number that is none: give finite numbers", refusal(goal));
  goal.waypoints[0].pose.position.y = 0.0;
  goal.waypoints[0].header.frame_id = "moon";
  EXPECT_EQ("tf has no map -> moon; give the goal in a frame that tf knows", refusal(goal));
  goal.waypoints.resize(2);
  goal.waypoints[0].header.frame_id = "";
  goal.waypoints[0].pose.position.x = 10.0;
  goal.waypoints[1].pose.position.x = 5.0;
  goal.waypoints[1].pose.position.y = 0.1;
  EXPECT_EQ(0u, refusal(goal).find("no route: waypoint 1: a turn of ")) << message();
  geometry_msgs::PoseStamped nowhere;
  nowhere.header.frame_id = "sun";
  goals_.publish(nowhere);
  EXPECT_TRUE(diagnostics_.waitForValue("navigation: navigation", "goal before",
                                        "refused: tf has no map -> sun; give the goal in a frame that tf knows"))
      << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForSummary("navigation: navigation", WARN, "goal refused: ")) << diagnostics_.text();
  EXPECT_EQ(0.0, vehicle_.car().travel());
}

TEST_F(NavigationNode, ALaterGoalReplacesTheOneBefore)
{
  send("far");
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  Client other("drive", false);
  ASSERT_TRUE(other.waitForServer(ros::Duration(TIMEOUT_S)));
  DriveGoal goal;
  goal.places.push_back("gate");
  other.sendGoal(goal);
  ASSERT_TRUE(waitForEnd(State::PREEMPTED)) << text();
  EXPECT_EQ("replaced by a later goal of the action /drive", message());
  EXPECT_GT(client_.getResult()->distance, 0.0);

  geometry_msgs::PoseStamped topic_goal;  // as rviz sends it, in another frame than the map
  const Pose2 T_map_goal{25.0, 10.0, 0.8};
  topic_goal.header.frame_id = "odom";
  topic_goal.pose = toPose(T_MAP_ODOM.inverse() * T_map_goal);
  goals_.publish(topic_goal);
  ASSERT_TRUE(other.waitForResult(ros::Duration(DRIVE_S)));
  EXPECT_EQ(State::PREEMPTED, other.getState().state_);
  EXPECT_EQ("replaced by a later goal on /goal", other.getResult()->message);
  ASSERT_TRUE(until(DRIVE_S, [&] { return vehicle_.stands() && vehicle_.distanceTo(T_map_goal.position()) < 0.5; }))
      << text();
  EXPECT_NEAR(0.8, vehicle_.car().pose().heading, 0.2);
}

TEST_F(NavigationNode, ServesClientsOfMoveBase)
{
  actionlib::SimpleActionClient<move_base_msgs::MoveBaseAction> client("move_base", false);
  ASSERT_TRUE(client.waitForServer(ros::Duration(TIMEOUT_S)));
  std::mutex mutex;
  std::vector<geometry_msgs::PoseStamped> places;
  const auto drive = [&](const Pose2& pose, const std::string& frame)
  {
    move_base_msgs::MoveBaseGoal goal;
    goal.target_pose.header.frame_id = frame;
    goal.target_pose.pose = toPose(pose);
    client.sendGoal(goal, decltype(client)::SimpleDoneCallback(), decltype(client)::SimpleActiveCallback(),
                    [&](const move_base_msgs::MoveBaseFeedbackConstPtr& feedback)
                    {
                      const std::lock_guard<std::mutex> lock(mutex);
                      places.push_back(feedback->base_position);
                    });
  };
  const auto ends = [&](State::StateEnum state)
  { return client.waitForResult(ros::Duration(DRIVE_S)) && client.getState().state_ == state; };

  drive({15.0, 3.0, 0.0}, "map");
  ASSERT_TRUE(ends(State::SUCCEEDED)) << text();
  EXPECT_LE(vehicle_.distanceTo({15.0, 3.0}), 0.5);
  {
    const std::lock_guard<std::mutex> lock(mutex);
    ASSERT_GT(places.size(), 5u);
    EXPECT_EQ("map", places.back().header.frame_id);
    EXPECT_LT(std::hypot(places.back().pose.position.x - 15.0, places.back().pose.position.y - 3.0), 2.0);
  }
  drive({60.0, 0.0, 0.0}, "map");
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  client.cancelGoal();
  ASSERT_TRUE(ends(State::PREEMPTED)) << text();

  drive({60.0, 0.0, 0.0}, "moon");
  ASSERT_TRUE(ends(State::REJECTED)) << text();
  EXPECT_EQ("tf has no map -> moon; give the goal in a frame that tf knows", client.getState().getText());

  drive({60.0, 0.0, 0.0}, "map");
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  ros::Publisher simple = ros::NodeHandle().advertise<geometry_msgs::PoseStamped>("move_base_simple/goal", 1);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return simple.getNumSubscribers() > 0; }));
  geometry_msgs::PoseStamped later;
  later.header.frame_id = "map";
  later.pose = toPose({50.0, 2.0, 0.0});
  simple.publish(later);
  ASSERT_TRUE(ends(State::PREEMPTED)) << text();
  EXPECT_EQ("replaced by a later goal on /move_base_simple/goal", client.getState().getText());

  drive({70.0, 0.0, 0.0}, "map");
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  ASSERT_TRUE(unloadNodelet("/navigation"));
  ASSERT_TRUE(ends(State::ABORTED)) << text();
  start();
}

TEST_F(NavigationNode, SaysWhyTheVehicleStandsAndGivesUpWhereAsked)
{
  send("far");
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();
  const auto hold = [](Vehicle::World& world)
  {
    world.mode = VehicleState::EMERGENCY_STOP;
    world.detail = "the button";
  };
  vehicle_.set(hold);
  ASSERT_TRUE(waitForFeedback("stopped", "vehicle: emergency stop: the button")) << text();
  EXPECT_TRUE(diagnostics_.waitForSummary("navigation: navigation", WARN, "emergency stop")) << diagnostics_.text();
  ASSERT_TRUE(vehicle_.waitForStandstill()) << text();
  vehicle_.set([](Vehicle::World& world) { world.mode = VehicleState::READY; });
  ASSERT_TRUE(vehicle_.waitForSpeed(0.5)) << text();

  // The end of the navigation is the end of its goals. Whether its last words arrive is roscpp's affair.
  ASSERT_TRUE(unloadNodelet("/navigation"));
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return client_.getState().isDone() || !client_.isServerConnected(); }))
      << text();
  client_.stopTrackingGoal();

  ros::param::set("/navigation/blocked_after_s", 1.0);
  const double x = vehicle_.car().pose().x + 4.0;
  vehicle_.set([x](Vehicle::World& world) { world.obstacle = Eigen::Vector2d(x, 0.0); });
  start();
  send("far");
  ASSERT_TRUE(waitForEnd(State::ABORTED)) << text();
  EXPECT_EQ(0u, message().find("blocked at (")) << message();
  EXPECT_NE(std::string::npos, message().find("(obstacle 5) blocks the way")) << message();
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "navigation_test");
}
