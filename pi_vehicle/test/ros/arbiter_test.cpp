// Judge of arbiter.test.

#include <geometry_msgs/Twist.h>
#include <gtest/gtest.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_vehicle/ArbiterState.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <mutex>
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
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;
constexpr double NO_LIMIT = 1000.0;

// Timeouts for loaded machines.
const char* const SOURCES = R"(
sources:
  - {name: remote, priority: 100, timeout: 1.0, max_speed: 1.5}
  - {name: navigation, priority: 10, timeout: 1.0}
  - {name: reaction, drives: false, timeout: 1.0, required: true}
  - {name: command, drives: false, timeout: 1.0, required: true}
)";

/// The time of the graph, which goes as that of the wall until it is told to stand still.
class TestClock
{
public:
  TestClock() : publisher_(ros::NodeHandle().advertise<rosgraph_msgs::Clock>("/clock", 10))
  {
    thread_ = std::thread(
        [this]
        {
          while (!stopping_)
          {
            {
              std::lock_guard<std::mutex> lock(mutex_);
              now_ += frozen_ ? ros::Duration() : ros::Duration(0.01);
              rosgraph_msgs::Clock message;
              message.clock = now_;
              publisher_.publish(message);
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
          }
        });
  }
  ~TestClock()
  {
    stopping_ = true;
    thread_.join();
  }
  TestClock(const TestClock&) = delete;
  TestClock& operator=(const TestClock&) = delete;

  /// @return the time at which it stands.
  ros::Time freeze()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    frozen_ = true;
    return now_;
  }
  void goOn()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    frozen_ = false;
  }

private:
  ros::Publisher publisher_;
  std::mutex mutex_;
  inline static ros::Time now_{1000.0};  ///< goes on from test to test
  bool frozen_ = false;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

/// Speaks for sources, steadily.
class Speaker
{
public:
  Speaker()
  {
    for (const char* name : {"remote", "navigation", "reaction", "command"})
    {
      publishers_[name] = ros::NodeHandle().advertise<MotionCommand>(std::string("motion/") + name, 1);
    }
    thread_ = std::thread(
        [this]
        {
          while (!stopping_)
          {
            speak();
            std::this_thread::sleep_for(std::chrono::milliseconds(30));
          }
        });
  }
  ~Speaker()
  {
    stopping_ = true;
    thread_.join();
  }
  Speaker(const Speaker&) = delete;
  Speaker& operator=(const Speaker&) = delete;

  bool connected() const
  {
    for (const auto& [name, publisher] : publishers_)
    {
      if (publisher.getNumSubscribers() == 0)
      {
        return false;
      }
    }
    return true;
  }
  void say(const std::string& source, double speed, double max_deceleration = 0.0, const std::string& reason = "test")
  {
    std::lock_guard<std::mutex> lock(mutex_);
    MotionCommand& message = messages_[source];
    message.speed = speed;
    message.max_deceleration = max_deceleration;
    message.source = source;
    message.reason = reason;
  }
  void silence(const std::string& source)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    messages_.erase(source);
  }
  void publish(const std::string& source, MotionCommand message) { publishers_[source].publish(message); }

private:
  void speak()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    for (auto& [source, message] : messages_)
    {
      message.header.stamp = ros::Time::now();
      publishers_[source].publish(message);
    }
  }

  std::map<std::string, ros::Publisher> publishers_;
  std::mutex mutex_;
  std::map<std::string, MotionCommand> messages_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

class ArbiterNode : public testing::Test
{
protected:
  void SetUp() override
  {
    ros::param::del("/arbiter");
    ros::param::set("/arbiter/sources_file", folder_.file("sources.yaml", SOURCES));
    ros::param::set("/arbiter/diagnostic_period", 0.1);
    ros::param::set("/arbiter/warning_period_s", 3.0);
    vehicle_ = ros::NodeHandle().advertise<VehicleState>("vehicle_state", 1, true);
    twist_ = ros::NodeHandle().advertise<geometry_msgs::Twist>("remote/cmd_vel", 1);
    load();
  }
  void TearDown() override { EXPECT_TRUE(unloadNodelet("/arbiter")); }

  void load()
  {
    ASSERT_TRUE(loadNodelet("/arbiter", "pi_vehicle/arbiter"));
    ASSERT_TRUE(motion_.waitForPublisher() && states_.waitForPublisher());
    ASSERT_TRUE(
        until(TIMEOUT_S, [this]
              { return speaker_.connected() && vehicle_.getNumSubscribers() > 0 && twist_.getNumSubscribers() > 0; }));
  }

  void driveAt(double speed)
  {
    speaker_.say("reaction", NO_LIMIT);
    speaker_.say("command", 3.0);
    speaker_.say("navigation", speed, 0.0, "to B");
    ASSERT_TRUE(waitFor("navigation", speed)) << last();
  }
  bool waitFor(const std::string& source, double speed)
  {
    motion_.clear();
    return motion_.waitFor([&](const MotionCommand& motion)
                           { return motion.source == source && std::abs(motion.speed - speed) < 1e-6; });
  }
  bool waitForState(const std::function<bool(const ArbiterState&)>& fits)
  {
    return until(TIMEOUT_S, [&] { return states_.last() && fits(*states_.last()); });
  }
  std::string last() const
  {
    const auto motion = motion_.last();
    return motion ? motion->source + " " + std::to_string(motion->speed) + " " + motion->reason : "no motion";
  }
  void measure(double speed)
  {
    VehicleState state;
    state.header.stamp = ros::Time::now();
    state.speed = speed;
    vehicle_.publish(state);
  }
  /// Publishes it until the diagnostics warn so.
  bool isWarned(const std::string& source, const MotionCommand& message, const std::string& warning)
  {
    return until(TIMEOUT_S,
                 [&]
                 {
                   speaker_.publish(source, message);
                   const auto array = diagnostics_.last();
                   bool warned = false;
                   for (const auto& status : array ? array->status : std::vector<DiagnosticCollector::Status>())
                   {
                     for (const auto& value : status.values)
                     {
                       warned = warned || value.value.find(warning) != std::string::npos;
                     }
                   }
                   return warned;
                 });
  }
  static std_srvs::Trigger::Response call(const std::string& service)
  {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(ros::service::call(service, trigger)) << service;
    return trigger.response;
  }

  const TemporaryFolder folder_;
  TestClock clock_;
  Speaker speaker_;
  ros::Publisher vehicle_;
  ros::Publisher twist_;
  Collector<MotionCommand> motion_{"motion"};
  Collector<ArbiterState> states_{"arbiter/state"};
  DiagnosticCollector diagnostics_;
};

TEST_F(ArbiterNode, NavigationDrivesAndReactionLimits)
{
  driveAt(1.5);
  EXPECT_TRUE(waitForState([](const ArbiterState& state)
                           { return state.driver == "navigation" && state.limited_by.empty() && !state.emergency; }));
  diagnostics_.clear();
  EXPECT_TRUE(diagnostics_.waitForSummary("arbiter: arbiter", OK, "navigation drives")) << diagnostics_.text();
  speaker_.say("reaction", 0.8, 0.0, "person beside");
  ASSERT_TRUE(waitFor("reaction", 0.8)) << last();
  EXPECT_EQ("person beside", motion_.last()->reason);
  EXPECT_TRUE(waitForState([](const ArbiterState& state)
                           { return state.driver == "navigation" && state.limited_by == "reaction"; }));
  speaker_.say("reaction", NO_LIMIT);
  ASSERT_TRUE(waitFor("navigation", 1.5)) << last();
}

TEST_F(ArbiterNode, ACommandToStopReachesMotionBeforeTheNextTick)
{
  driveAt(1.0);
  // While the clock stands still there are no ticks: what comes then comes on arrival.
  const ros::Time now = clock_.freeze();
  ASSERT_TRUE(motion_.waitForStamp(now));
  motion_.clear();
  speaker_.say("command", 0.0, 2.5, "stop");
  ASSERT_TRUE(motion_.waitFor([](const MotionCommand& motion) { return motion.source == "command"; }));
  EXPECT_EQ(motion_.last()->header.stamp, now);
  EXPECT_EQ(motion_.last()->max_deceleration, 2.5);
  EXPECT_EQ(motion_.last()->reason, "stop");
  clock_.goOn();
  ASSERT_TRUE(waitFor("command", 0.0)) << last();
  // The navigation goes on asking, the stop goes on holding.
  motion_.clear();
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return motion_.messages().size() >= 100; }));
  for (const auto& motion : motion_.messages())
  {
    ASSERT_EQ(0.0, motion->speed);
  }
  speaker_.say("command", 3.0);
  EXPECT_TRUE(waitFor("navigation", 1.0)) << last();
}

TEST_F(ArbiterNode, SilenceOfARequiredSourceStopsUntilItIsBack)
{
  driveAt(1.0);
  diagnostics_.clear();
  speaker_.silence("reaction");
  ASSERT_TRUE(waitFor("arbiter", 0.0)) << last();
  EXPECT_EQ("reaction is silent and required", motion_.last()->reason);
  EXPECT_TRUE(diagnostics_.waitForSummary("arbiter: arbiter", ERROR, "reaction is silent")) << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForSummary("arbiter: sources", ERROR, "reaction is silent")) << diagnostics_.text();
  EXPECT_TRUE(
      waitForState([](const ArbiterState& state)
                   { return state.limited_by == "arbiter" && state.sources.size() == 4 && !state.sources[2].alive; }));
  speaker_.say("reaction", NO_LIMIT);
  EXPECT_TRUE(waitFor("navigation", 1.0)) << last();
}

TEST_F(ArbiterNode, TheDriversSilenceStopsAndTheRemoteTakesOver)
{
  driveAt(1.0);
  speaker_.silence("navigation");
  ASSERT_TRUE(waitFor("arbiter", 0.0)) << last();
  geometry_msgs::Twist twist;
  twist.linear.x = 0.8;
  twist.angular.z = 0.2;
  motion_.clear();
  ASSERT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      twist_.publish(twist);
                      const auto motion = motion_.last();
                      return motion && motion->source == "remote" && std::abs(motion->speed - 0.8) < 1e-6 &&
                             std::abs(motion->curvature - 0.25) < 1e-6;
                    }))
      << last();
  EXPECT_TRUE(waitForState([](const ArbiterState& state) { return state.driver == "remote"; }));
}

TEST_F(ArbiterNode, EmergencyStopLatchesOverARestartUntilItIsReleasedAtStandstill)
{
  driveAt(1.0);
  measure(1.0);
  clock_.freeze();
  EXPECT_NE(0, call("/arbiter/emergency_stop").success);
  EXPECT_EQ(0, call("/arbiter/release_emergency_stop").success) << "it still moves";
  clock_.goOn();
  ASSERT_TRUE(waitFor("arbiter", 0.0)) << last();
  EXPECT_TRUE(diagnostics_.waitForSummary("arbiter: arbiter", WARN, "emergency stop")) << diagnostics_.text();
  ASSERT_TRUE(until(TIMEOUT_S,
                    []
                    {
                      std::string kept;
                      return ros::param::get("/arbiter/latched", kept) && !kept.empty();
                    }));

  ASSERT_TRUE(unloadNodelet("/arbiter"));
  states_.clear();
  load();
  EXPECT_TRUE(waitForState([](const ArbiterState& state) { return state.emergency; }));
  ASSERT_TRUE(waitFor("arbiter", 0.0)) << last();
  EXPECT_EQ(0U, motion_.last()->reason.find("emergency stop: ")) << last();
  measure(0.0);
  ASSERT_TRUE(until(TIMEOUT_S, [] { return call("/arbiter/release_emergency_stop").success != 0; }));
  EXPECT_TRUE(waitFor("navigation", 1.0)) << last();
  EXPECT_TRUE(waitForState([](const ArbiterState& state) { return !state.emergency; }));
}

TEST_F(ArbiterNode, RefusesOddCommandsAndSaysSo)
{
  driveAt(1.0);
  MotionCommand message;
  message.speed = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(isWarned("navigation", message, "a command of navigation was refused: a number that is none"))
      << diagnostics_.text();
  message.speed = 1.0;
  message.header.stamp = ros::Time::now() - ros::Duration(60.0);
  EXPECT_TRUE(isWarned("remote", message, "a command of remote was refused: stamp older than the source's timeout"))
      << diagnostics_.text();
  EXPECT_TRUE(waitFor("navigation", 1.0)) << last();
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "arbiter_test");
}
