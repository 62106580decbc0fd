// Judge of stock_base.test.

#include <geometry_msgs/Twist.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <ros/ros.h>

#include <cmath>
#include <limits>
#include <memory>

namespace pi_simulation
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr double NAN_VALUE = std::numeric_limits<double>::quiet_NaN();

double headingOf(const nav_msgs::Odometry& odometry)
{
  return 2.0 * std::atan2(odometry.pose.pose.orientation.z, odometry.pose.pose.orientation.w);
}

/// One simulator for all tests, as in vehicle_simulator_test.cpp.
class StockBaseOnGraph : public testing::Test
{
protected:
  static void SetUpTestSuite()
  {
    folder() = std::make_unique<TemporaryFolder>();
    ros::param::set("/simulator/scenario", folder()->file("test.yaml",
                                                          "{name: test, road: [[0, 0], [60, 0]], parked: false, "
                                                          "start: [10, 0, 0], goal: [40, 0, 0]}"));
    ros::param::set("/simulator/base", "twist");
    ros::param::set("/simulator/diagnostic_period", 0.2);
    ASSERT_TRUE(loadNodelet("/simulator", "pi_simulation/vehicle_simulator"));
  }
  static void TearDownTestSuite()
  {
    EXPECT_TRUE(unloadNodelet("/simulator"));
    folder().reset();
  }
  static std::unique_ptr<TemporaryFolder>& folder()
  {
    static std::unique_ptr<TemporaryFolder> folder;
    return folder;
  }

  void SetUp() override
  {
    commands_ = ros::NodeHandle().advertise<geometry_msgs::Twist>("cmd_vel", 1);
    ASSERT_TRUE(
        until(TIMEOUT_S, [this] { return commands_.getNumSubscribers() > 0 && odometry_.last() && truth_.last(); }));
  }

  template <typename Condition>
  bool drivesUntil(double linear, double angular, Condition&& condition)
  {
    return until(2.0 * TIMEOUT_S,
                 [&]
                 {
                   geometry_msgs::Twist twist;
                   twist.linear.x = linear;
                   twist.angular.z = angular;
                   commands_.publish(twist);
                   return condition();
                 });
  }
  double speed() const { return truth_.last()->twist.twist.linear.x; }
  double turned() const { return headingOf(*truth_.last()); }

  ros::Publisher commands_;
  Collector<nav_msgs::Odometry> odometry_{"odom"};
  Collector<nav_msgs::Odometry> truth_{"ground_truth/odometry"};
  DiagnosticCollector diagnostics_;
};

TEST_F(StockBaseOnGraph, TurnsOnTheSpotAndDrivesAndTellsItsWay)
{
  ASSERT_TRUE(drivesUntil(0.0, 1.0, [this] { return turned() > 1.0; }));
  ASSERT_TRUE(drivesUntil(0.0, -1.0, [this] { return turned() < 0.0; }));
  EXPECT_NEAR(-0.35, truth_.last()->pose.pose.position.x, 0.01) << "the map begins at the IMU";
  ASSERT_TRUE(drivesUntil(1.5, 0.0, [this] { return odometry_.last()->pose.pose.position.x > 3.0; }));
  const nav_msgs::Odometry odometry = *odometry_.last();
  EXPECT_EQ("odom", odometry.header.frame_id);
  EXPECT_EQ("base_link", odometry.child_frame_id);
  EXPECT_GT(odometry.twist.twist.linear.x, 1.0);
  const auto all = odometry_.messages();
  EXPECT_NEAR(0.02 * static_cast<double>(all.size() - 1),
              (all.back()->header.stamp - all.front()->header.stamp).toSec(), 0.021);
  double truth = 0.0;
  ASSERT_TRUE(truth_.waitFor(
      [&](const nav_msgs::Odometry& message)
      {
        truth = message.pose.pose.position.x;
        return message.header.stamp >= odometry.header.stamp;
      }));
  EXPECT_NEAR(odometry.pose.pose.position.x, truth + 0.35, 0.1);
  EXPECT_TRUE(diagnostics_.waitForSummary("simulator: world", OK, "scenario test")) << diagnostics_.text();
}

TEST_F(StockBaseOnGraph, BrakesWhenCommandsCease)
{
  ASSERT_TRUE(drivesUntil(1.5, 0.0, [this] { return speed() > 1.2; }));
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return std::abs(speed()) < 0.01; }));
  EXPECT_TRUE(drivesUntil(1.5, 0.0, [this] { return speed() > 0.5; }));
}

TEST_F(StockBaseOnGraph, IgnoresWhatIsNoNumberAndSaysSo)
{
  ASSERT_TRUE(drivesUntil(1.5, 0.0, [this] { return speed() > 1.2; }));
  ASSERT_TRUE(drivesUntil(NAN_VALUE, 0.0, [this] { return std::abs(speed()) < 0.01; })) << "nothing feeds the timeout";
  EXPECT_TRUE(std::isfinite(odometry_.last()->pose.pose.position.x));
  EXPECT_TRUE(
      diagnostics_.waitForSummary("simulator: world", WARN, "a twist on /cmd_vel was ignored: a number is not finite"))
      << diagnostics_.text();
}

}  // namespace
}  // namespace pi_simulation

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "stock_base_test");
}
