// Judge of chassis.test.

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <sensor_msgs/BatteryState.h>
#include <std_srvs/Trigger.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

namespace pi_simulation
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;

/// The program, with its stdin in our hands; ends with the object.
class Simulator
{
public:
  Simulator(const std::string& link, const std::string& truth)
  {
    int ends[2];
    if (::pipe(ends) != 0)
    {
      throw std::runtime_error("no pipe");
    }
    child_ = ::fork();
    if (child_ == 0)
    {
      ::dup2(ends[0], STDIN_FILENO);
      ::close(ends[0]);
      ::close(ends[1]);
      ::execl(CHASSIS_SIMULATOR, CHASSIS_SIMULATOR, "--link", link.c_str(), "--truth", truth.c_str(),
              static_cast<char*>(nullptr));
      ::_exit(127);
    }
    ::close(ends[0]);
    stdin_ = ends[1];
  }
  ~Simulator()
  {
    if (child_ > 0)
    {
      ::kill(child_, SIGKILL);
      ::waitpid(child_, nullptr, 0);
    }
    ::close(stdin_);
  }
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;

  void command(const std::string& line)
  {
    const std::string text = line + "\n";
    ASSERT_EQ(static_cast<ssize_t>(text.size()), ::write(stdin_, text.data(), text.size()));
  }
  /// @return what it ended with.
  int quit()
  {
    command("quit");
    int status = -1;
    ::waitpid(child_, &status, 0);
    child_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

private:
  pid_t child_ = -1;
  int stdin_ = -1;
};

class ChassisNode : public testing::Test
{
protected:
  void SetUp() override
  {
    ros::param::set("/chassis/port", folder_.path() + "/chassis");
    ros::param::set("/chassis/longest_pause_s", 0.2);
    ros::param::set("/chassis/diagnostic_period", 0.1);
    commands_ = ros::NodeHandle().advertise<pi_vehicle::MotionCommand>("motion", 1);
    ASSERT_TRUE(loadNodelet("/chassis", "pi_vehicle/chassis"));
    ASSERT_TRUE(states_.waitForPublisher());
    ASSERT_TRUE(until(TIMEOUT_S, [this] { return commands_.getNumSubscribers() > 0; }));
  }
  void TearDown() override { EXPECT_TRUE(unloadNodelet("/chassis")); }

  void command(double speed, double curvature = 0.0)
  {
    pi_vehicle::MotionCommand message;
    message.header.stamp = ros::Time::now();
    message.speed = speed;
    message.curvature = curvature;
    message.source = "test";
    commands_.publish(message);
  }
  /// Commands a speed until it holds.
  template <typename Condition>
  bool drivesUntil(double speed, Condition&& condition, double curvature = 0.0)
  {
    return until(TIMEOUT_S,
                 [&]
                 {
                   command(speed, curvature);
                   const auto state = states_.last();
                   return state && condition(*state);
                 });
  }
  bool waitForMode(uint8_t mode)
  {
    return until(TIMEOUT_S, [&] { return states_.last() && states_.last()->mode == mode; });
  }
  std::string last() const
  {
    const auto state = states_.last();
    return state ? std::to_string(state->mode) + " " + state->detail : "no state";
  }
  static bool fast(const pi_vehicle::VehicleState& state)
  {
    return state.speed > 0.5 && state.mode == pi_vehicle::VehicleState::DRIVING;
  }
  static bool call(const std::string& service)
  {
    std_srvs::Trigger trigger;
    return ros::service::waitForService(service, ros::Duration(TIMEOUT_S)) && ros::service::call(service, trigger) &&
           trigger.response.success != 0;
  }

  const TemporaryFolder folder_;
  const std::string truth_ = folder_.path() + "/truth.json";
  Simulator simulator_{folder_.path() + "/chassis", truth_};
  ros::Publisher commands_;
  Collector<pi_vehicle::VehicleState> states_{"vehicle_state"};
  Collector<nav_msgs::Odometry> odometry_{"wheel_odometry"};
  Collector<sensor_msgs::BatteryState> battery_{"battery"};
  DiagnosticCollector diagnostics_;
};

TEST_F(ChassisNode, DrivesAndStopsWhenCommandsCease)
{
  ASSERT_TRUE(waitForMode(pi_vehicle::VehicleState::READY)) << last();
  ASSERT_TRUE(drivesUntil(
      1.0, [](const pi_vehicle::VehicleState& state) { return state.odometer > 1.0; }, 0.3))
      << last();
  EXPECT_TRUE(diagnostics_.waitForSummary("chassis: chassis", OK, "driving")) << diagnostics_.text();
  ASSERT_TRUE(waitForMode(pi_vehicle::VehicleState::STOPPED_WATCHDOG)) << last();
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return !states_.last()->moving && states_.last()->speed == 0.0; })) << last();
  EXPECT_TRUE(diagnostics_.waitForSummary("chassis: chassis", WARN, "no motion command for")) << diagnostics_.text();
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return battery_.last() && battery_.last()->present; }));
  EXPECT_NEAR(0.9, battery_.last()->percentage, 0.01);

  // Where the wheels say it is, it truly is.
  const auto odometry = odometry_.last();
  ASSERT_TRUE(odometry);
  EXPECT_EQ("odom", odometry->header.frame_id);
  EXPECT_GT(odometry->pose.pose.position.y, 0.05);  // to the left
  std::string line;
  std::string truth;
  ASSERT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      std::ifstream file(truth_);
                      while (std::getline(file, line))
                      {
                        truth = line;
                      }
                      return truth.find("\"speed\": 0.0000") != std::string::npos;
                    }))
      << truth;
  const auto number = [&truth](const std::string& name)
  { return std::stod(truth.substr(truth.find("\"" + name + "\": ") + name.size() + 4)); };
  EXPECT_NEAR(number("x"), odometry->pose.pose.position.x, 0.02) << truth;
  EXPECT_NEAR(number("y"), odometry->pose.pose.position.y, 0.02) << truth;
}

TEST_F(ChassisNode, CommandsThatAreOldOrNoNumbersAreRefused)
{
  ASSERT_TRUE(waitForMode(pi_vehicle::VehicleState::READY)) << last();
  pi_vehicle::MotionCommand message;
  message.source = "test";
  message.speed = 1.0;
  message.header.stamp = ros::Time::now() - ros::Duration(60.0);
  commands_.publish(message);
  EXPECT_TRUE(diagnostics_.waitForSummary("chassis: chassis", WARN, "was 60.")) << diagnostics_.text();
  message.header.stamp = ros::Time();
  message.speed = std::numeric_limits<double>::quiet_NaN();
  commands_.publish(message);
  EXPECT_TRUE(diagnostics_.waitForValue("chassis: chassis", "motions refused", "1")) << diagnostics_.text();
  EXPECT_EQ(pi_vehicle::VehicleState::READY, states_.last()->mode);
  EXPECT_EQ(0.0, states_.last()->odometer);
}

TEST_F(ChassisNode, UnplugAndReplug)
{
  ASSERT_TRUE(drivesUntil(1.0, fast)) << last();
  simulator_.command("unplug");
  ASSERT_TRUE(drivesUntil(
      1.0, [](const pi_vehicle::VehicleState& state) { return state.mode == pi_vehicle::VehicleState::DISCONNECTED; }));
  EXPECT_TRUE(diagnostics_.waitForSummary("chassis: line", ERROR, "is not there")) << diagnostics_.text();
  states_.clear();
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return states_.messages().size() >= 50; }));  // it goes on saying so
  simulator_.command("plug");
  ASSERT_TRUE(drivesUntil(1.0, fast)) << last();
}

TEST_F(ChassisNode, GarbageIsRefusedAndReported)
{
  ASSERT_TRUE(waitForMode(pi_vehicle::VehicleState::READY)) << last();
  simulator_.command("garbage on");
  ASSERT_TRUE(drivesUntil(1.0, fast)) << last();
  EXPECT_TRUE(diagnostics_.waitForSummary("chassis: line", WARN, "bytes of garbage")) << diagnostics_.text();
}

TEST_F(ChassisNode, EmergencyStopLatchesUntilReleased)
{
  ASSERT_TRUE(drivesUntil(1.0, fast)) << last();
  ASSERT_TRUE(call("emergency_stop"));
  ASSERT_TRUE(drivesUntil(1.0, [](const pi_vehicle::VehicleState& state)
                          { return state.mode == pi_vehicle::VehicleState::EMERGENCY_STOP && state.speed == 0.0; }))
      << last();
  states_.clear();
  ASSERT_TRUE(drivesUntil(1.0, [this](const pi_vehicle::VehicleState&) { return states_.messages().size() >= 50; }));
  for (const auto& state : states_.messages())
  {
    ASSERT_EQ(pi_vehicle::VehicleState::EMERGENCY_STOP, state->mode);
    ASSERT_EQ(0.0, state->speed);
  }
  ASSERT_TRUE(call("release_emergency_stop"));
  ASSERT_TRUE(drivesUntil(1.0, fast)) << last();
}

TEST_F(ChassisNode, StuckWheelsAndALowBatteryAreSaid)
{
  ASSERT_TRUE(waitForMode(pi_vehicle::VehicleState::READY)) << last();
  simulator_.command("battery 0.1");
  EXPECT_TRUE(diagnostics_.waitForSummary("chassis: battery", WARN, "10 %; charge it")) << diagnostics_.text();
  simulator_.command("stuck on");
  ASSERT_TRUE(drivesUntil(
      1.0, [](const pi_vehicle::VehicleState& state) { return state.mode == pi_vehicle::VehicleState::FAULT; }))
      << last();
  EXPECT_NE(std::string::npos, states_.last()->detail.find("drive stuck")) << last();
  simulator_.command("stuck off");
  ASSERT_TRUE(call("release_emergency_stop"));
  ASSERT_TRUE(drivesUntil(1.0, fast)) << last();
}

TEST_F(ChassisNode, EndOfTheSimulatorIsADisconnect)
{
  ASSERT_TRUE(drivesUntil(1.0, fast)) << last();
  EXPECT_EQ(0, simulator_.quit());
  EXPECT_TRUE(waitForMode(pi_vehicle::VehicleState::DISCONNECTED)) << last();
}

}  // namespace
}  // namespace pi_simulation

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "chassis_test");
}
