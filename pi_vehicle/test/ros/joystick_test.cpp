// Judge of joystick.test.

#include <fcntl.h>
#include <geometry_msgs/Twist.h>
#include <gtest/gtest.h>
#include <linux/joystick.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <ros/ros.h>
#include <sensor_msgs/Joy.h>
#include <std_msgs/Bool.h>
#include <sys/stat.h>
#include <unistd.h>

#include <limits>
#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr uint8_t EMERGENCY = 1;
constexpr uint8_t DEAD_MAN = 4;
constexpr uint8_t STEERING = 0;
constexpr uint8_t SPEED = 1;

/// The kernel's end of a joystick.
class Device
{
public:
  explicit Device(const std::string& path) : path_(path) { EXPECT_EQ(0, ::mkfifo(path.c_str(), 0600)) << path; }
  ~Device() { unplug(); }
  void plugIn() { descriptor_ = ::open(path_.c_str(), O_RDWR | O_CLOEXEC); }
  void unplug()
  {
    if (descriptor_ >= 0)
    {
      ::close(descriptor_);
    }
    descriptor_ = -1;
  }
  void send(uint8_t type, uint8_t number, int16_t value) const
  {
    js_event event = {};
    event.type = type;
    event.number = number;
    event.value = value;
    EXPECT_EQ(static_cast<ssize_t>(sizeof event), ::write(descriptor_, &event, sizeof event));
  }
  void press(uint8_t button) const { send(JS_EVENT_BUTTON, button, 1); }
  void release(uint8_t button) const { send(JS_EVENT_BUTTON, button, 0); }
  void move(uint8_t axis, int16_t value) const { send(JS_EVENT_AXIS, axis, value); }

private:
  const std::string path_;
  int descriptor_ = -1;
};

class Joystick : public testing::Test
{
protected:
  void SetUp() override
  {
    device_.plugIn();
    ros::param::set("/joystick/device", folder_.path() + "/js0");
    ros::param::set("/joystick/diagnostic_period", 0.1);
  }
  void TearDown() override
  {
    EXPECT_TRUE(unloadNodelet("/joystick"));
    ros::param::del("/joystick");
  }
  void load()
  {
    ASSERT_TRUE(loadNodelet("/joystick", "pi_vehicle/joystick"));
    ASSERT_TRUE(twists_.waitForPublisher());
    ASSERT_TRUE(stops_.waitForPublisher());
  }
  bool waitForSpeed(double speed)
  {
    return until(TIMEOUT_S, [&] { return twists_.last() && std::abs(twists_.last()->linear.x - speed) < 0.01; });
  }
  /// Whether twists have ceased: the arbiter then lets others drive.
  bool fallsSilent()
  {
    size_t count = 0;
    return until(TIMEOUT_S,
                 [&]
                 {
                   const size_t before = count;
                   count = twists_.count();
                   ros::WallDuration(0.2).sleep();  // ten of its periods
                   return before == count && count == twists_.count();
                 });
  }

  const TemporaryFolder folder_;
  Device device_{folder_.path() + "/js0"};
  Collector<geometry_msgs::Twist> twists_{"remote/cmd_vel"};
  Collector<std_msgs::Bool> stops_{"emergency_stop"};
  Collector<sensor_msgs::Joy> joys_{"joy"};
  DiagnosticCollector diagnostics_;
};

TEST_F(Joystick, DrivesWhileTheDeadManButtonIsHeld)
{
  load();
  ASSERT_TRUE(joys_.waitForPublisher());
  device_.move(SPEED, -32767);
  device_.move(STEERING, -32767);
  ASSERT_TRUE(joys_.waitFor([](const sensor_msgs::Joy& joy) { return joy.axes.size() == 2 && joy.axes[0] > 0.99; }));
  EXPECT_EQ(0u, twists_.count()) << "nobody holds the button";
  device_.press(DEAD_MAN);
  ASSERT_TRUE(waitForSpeed(1.5));
  EXPECT_NEAR(1.5 * 0.45, twists_.last()->angular.z, 1e-3) << "to the left";
  device_.move(SPEED, 2000);
  ASSERT_TRUE(waitForSpeed(0.0)) << "in the dead zone";
  device_.move(SPEED, 32767);
  ASSERT_TRUE(waitForSpeed(-1.5));
  device_.release(DEAD_MAN);
  ASSERT_TRUE(waitForSpeed(0.0));
  EXPECT_TRUE(fallsSilent());
}

TEST_F(Joystick, StopsInAnEmergencyAlsoWithoutTheDeadManButton)
{
  load();
  ASSERT_TRUE(joys_.waitForPublisher());  // it tells changes once
  device_.press(EMERGENCY);
  ASSERT_TRUE(stops_.waitFor([](const std_msgs::Bool& stop) { return stop.data != 0; }));
  device_.move(SPEED, -32767);
  device_.move(STEERING, 0);
  device_.press(DEAD_MAN);
  ASSERT_TRUE(joys_.waitFor([](const sensor_msgs::Joy& joy)
                            { return joy.buttons.size() > DEAD_MAN && joy.buttons[DEAD_MAN] != 0; }));
  EXPECT_EQ(0u, twists_.count()) << "while it is pressed";
  device_.release(EMERGENCY);
  ASSERT_TRUE(waitForSpeed(1.5));
  EXPECT_EQ(1u, stops_.count());
}

TEST_F(Joystick, UnpluggedNothingIsPressed)
{
  load();
  device_.move(SPEED, -32767);
  device_.move(STEERING, 0);
  device_.press(DEAD_MAN);
  ASSERT_TRUE(waitForSpeed(1.5));
  device_.unplug();
  ASSERT_TRUE(waitForSpeed(0.0));
  EXPECT_TRUE(fallsSilent());
  EXPECT_TRUE(diagnostics_.waitForSummary("joystick: joystick", ERROR, "plug it in")) << diagnostics_.text();
  device_.plugIn();
  device_.move(SPEED, -32767);
  device_.move(STEERING, 0);
  device_.press(DEAD_MAN);
  EXPECT_TRUE(waitForSpeed(1.5));
}

TEST_F(Joystick, ADeviceThatIsNotThereIsNamed)
{
  ros::param::set("/joystick/device", "/dev/input/js_nowhere");
  load();
  EXPECT_TRUE(diagnostics_.waitForSummary("joystick: joystick", ERROR, "js_nowhere: No such file or directory; plug"))
      << diagnostics_.text();
}

TEST_F(Joystick, TakesTheJoyOfAnotherNodeWhileItIsFresh)
{
  ros::param::set("/joystick/device", "");
  load();
  ros::Publisher publisher = ros::NodeHandle().advertise<sensor_msgs::Joy>("joy", 1);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return publisher.getNumSubscribers() > 1; }));
  sensor_msgs::Joy joy;
  joy.buttons = {0, 0, 0, 0, 1};
  joy.axes = {0.0F};
  publisher.publish(joy);
  EXPECT_TRUE(diagnostics_.waitForSummary("joystick: joystick", WARN, "has 1 axes, not axis 1")) << diagnostics_.text();
  joy.axes = {std::numeric_limits<float>::quiet_NaN(), 1.0F};
  publisher.publish(joy);
  ASSERT_TRUE(waitForSpeed(1.5));
  EXPECT_EQ(0.0, twists_.last()->angular.z) << "of what is not finite";
  ASSERT_TRUE(waitForSpeed(0.0)) << "no later message";
  EXPECT_TRUE(diagnostics_.waitForSummary("joystick: joystick", ERROR, "nothing comes on /joy")) << diagnostics_.text();
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "joystick_test");
}
