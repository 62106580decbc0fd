// Driver, serial port and simulated chassis through a pseudo-terminal. Waits for events; no time is judged.

#include <pi_vehicle/chassis/chassis_driver.h>

#include "chassis/simulated_chassis.h"

#include <gtest/gtest.h>
#include <pi_node/durations.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_vehicle/serial/serial_port.h>

#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_simulation
{
namespace
{

using namespace pi_vehicle::chassis;
using pi_vehicle::SerialError;
using pi_vehicle::SerialPort;

using pi_node::test_support::TemporaryFolder;

/// A simulated chassis that lives on a thread.
class LiveChassis
{
public:
  explicit LiveChassis(const SimulationOptions& options) : chassis_(options, pi_node::monotonicNs())
  {
    thread_ = std::thread(
        [this]
        {
          while (!stopping_)
          {
            {
              std::lock_guard<std::mutex> lock(mutex_);
              chassis_.step(pi_node::monotonicNs());
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(5));  // its tick
          }
        });
  }
  ~LiveChassis()
  {
    stopping_ = true;
    thread_.join();
  }
  void command(const std::string& line)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    EXPECT_EQ("", chassis_.command(line, pi_node::monotonicNs()));
  }
  Measurement measurement()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return chassis_.model().measurement();
  }
  Mode mode()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return chassis_.controller().mode();
  }

private:
  std::mutex mutex_;
  SimulatedChassis chassis_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

class ChassisDriverTest : public testing::Test
{
protected:
  ChassisDriverTest()
  {
    SimulationOptions simulation;
    simulation.link = link_;
    chassis_ = std::make_unique<LiveChassis>(simulation);
  }

  /// @param motion  set before each look; null: none.
  bool until(const Motion* motion, const std::function<bool(const DriverState&)>& condition)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(60),
                             [&]
                             {
                               if (motion != nullptr)
                               {
                                 driver_->setMotion(*motion);
                               }
                               return condition(state_);
                             });
  }
  bool untilMode(const Motion* motion, HostMode mode)
  {
    return until(motion, [mode](const DriverState& state) { return state.host.mode == mode; });
  }

  void start(double patience_s = DriverOptions().start_patience_s)
  {
    DriverOptions options;
    options.port = link_;
    options.start_patience_s = patience_s;
    options.longest_pause_s = 0.2;
    DriverEvents events;
    events.state = [this](const DriverState& state)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      state_ = state;
      changed_.notify_all();
    };
    events.closed = [this](const std::string& problem)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      problems_.push_back(problem);
    };
    driver_ = std::make_unique<ChassisDriver>(options, std::move(events));
  }

  static Motion forward(double speed)
  {
    Motion motion;
    motion.speed = speed;
    return motion;
  }
  static bool drives(const DriverState& state)
  {
    return state.host.mode == HostMode::DRIVING && state.host.status.speed > 0.5;
  }

  const TemporaryFolder folder_;
  const std::string link_ = folder_.path() + "/chassis";
  std::unique_ptr<LiveChassis> chassis_;
  std::mutex mutex_;
  std::condition_variable changed_;
  DriverState state_;
  std::vector<std::string> problems_;
  std::unique_ptr<ChassisDriver> driver_;
};

TEST_F(ChassisDriverTest, DrivesAndStopsWhenMotionsCease)
{
  start();
  const Motion motion = forward(1.0);
  ASSERT_TRUE(until(&motion, drives)) << state_.host.detail;
  ASSERT_TRUE(untilMode(nullptr, HostMode::STOPPED_WATCHDOG));
  EXPECT_TRUE(until(nullptr, [](const DriverState& state) { return !state.host.moving; }));
  EXPECT_GT(state_.host.odometry.distance, 0.0);
}

TEST_F(ChassisDriverTest, UnplugAndReplug)
{
  start();
  const Motion motion = forward(1.0);
  ASSERT_TRUE(until(&motion, drives)) << state_.host.detail;
  chassis_->command("unplug");
  ASSERT_TRUE(untilMode(&motion, HostMode::DISCONNECTED));
  ASSERT_TRUE(until(&motion, [](const DriverState& state) { return state.open_errors >= 3; }));
  EXPECT_EQ("", state_.path);
  {
    std::lock_guard<std::mutex> lock(mutex_);
    ASSERT_EQ(1u, problems_.size());  // told once, not at every try
    EXPECT_NE(std::string::npos, problems_[0].find("is gone; is the chassis unplugged?")) << problems_[0];
  }
  chassis_->command("plug");
  ASSERT_TRUE(until(&motion, [](const DriverState& state) { return state.opened >= 2 && drives(state); }));
  EXPECT_EQ(1u, state_.lost);
}

TEST_F(ChassisDriverTest, PortThatComesLaterThanTheDriverIsNoProblem)
{
  chassis_->command("unplug");
  start(600.0);
  ASSERT_TRUE(untilMode(nullptr, HostMode::DISCONNECTED));
  ASSERT_TRUE(until(nullptr, [](const DriverState& state) { return state.open_errors > 0; }));
  EXPECT_NE(std::string::npos, state_.host.detail.find(link_ + " is not there")) << state_.host.detail;
  chassis_->command("plug");
  EXPECT_TRUE(untilMode(nullptr, HostMode::READY)) << state_.host.detail;
  std::lock_guard<std::mutex> lock(mutex_);
  EXPECT_EQ(std::vector<std::string>(), problems_);
}

TEST_F(ChassisDriverTest, PortThatIsNotThereIsNamedOnceWhenPatienceEnds)
{
  chassis_->command("unplug");
  start(0.0);
  ASSERT_TRUE(until(nullptr, [](const DriverState& state) { return state.open_errors >= 3; }));
  std::lock_guard<std::mutex> lock(mutex_);
  ASSERT_EQ(1u, problems_.size());
  EXPECT_NE(std::string::npos, problems_[0].find(link_ + " is not there")) << problems_[0];
}

TEST_F(ChassisDriverTest, GarbageIsRefusedAndItDrivesOn)
{
  start();
  chassis_->command("garbage on");
  const Motion motion = forward(1.0);
  ASSERT_TRUE(until(&motion,
                    [](const DriverState& state) { return state.host.decoder.garbage_bytes > 1000 && drives(state); }));
  EXPECT_EQ(HostMode::DRIVING, state_.host.mode) << state_.host.detail;
}

TEST_F(ChassisDriverTest, EmergencyStopLatchesUntilReleased)
{
  start();
  const Motion motion = forward(1.0);
  ASSERT_TRUE(until(&motion, drives)) << state_.host.detail;
  driver_->emergencyStop("test");
  ASSERT_TRUE(until(&motion, [](const DriverState& state)
                    { return state.host.status.mode == Mode::EMERGENCY_STOP && !state.host.moving; }));
  EXPECT_EQ(HostMode::EMERGENCY_STOP, state_.host.mode);
  driver_->release();
  EXPECT_TRUE(until(&motion, drives)) << state_.host.detail;
}

TEST_F(ChassisDriverTest, EndOfTheDriverStopsTheChassis)
{
  start();
  const Motion motion = forward(1.0);
  ASSERT_TRUE(until(&motion, drives)) << state_.host.detail;
  driver_.reset();
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (chassis_->measurement().speed > 0.0 && std::chrono::steady_clock::now() < end)
  {
    std::this_thread::yield();
  }
  EXPECT_EQ(0.0, chassis_->measurement().speed);
}

TEST_F(ChassisDriverTest, EmergencyStopStaysWhenTheDriverEnds)
{
  start();
  const Motion motion = forward(1.0);
  ASSERT_TRUE(until(&motion, drives)) << state_.host.detail;
  driver_->emergencyStop("test");
  ASSERT_TRUE(until(nullptr, [](const DriverState& state) { return state.host.status.mode == Mode::EMERGENCY_STOP; }));
  driver_.reset();
  start();
  ASSERT_TRUE(
      until(&motion, [](const DriverState& state) { return state.opened > 0 && state.host.hello.has_value(); }));
  EXPECT_TRUE(untilMode(&motion, HostMode::EMERGENCY_STOP)) << state_.host.detail;
  EXPECT_EQ(Mode::EMERGENCY_STOP, chassis_->mode());
}

TEST_F(ChassisDriverTest, SecondDriverOnOnePortIsRefusedByTheLock)
{
  const SerialPort first(link_, 115200, "the chassis");
  try
  {
    const SerialPort second(link_, 115200, "the chassis");
    FAIL();
  }
  catch (const SerialError& error)
  {
    EXPECT_NE(std::string::npos, std::string(error.what()).find("is used by another program")) << error.what();
  }
}

TEST_F(ChassisDriverTest, LinkOfTheSimulationGoesWithTheLine)
{
  EXPECT_TRUE(std::filesystem::is_symlink(link_));
  chassis_->command("unplug");
  EXPECT_FALSE(std::filesystem::is_symlink(link_));
}

std::string openError(const std::string& path)
{
  try
  {
    const SerialPort port(path, 115200, "the chassis");
  }
  catch (const SerialError& error)
  {
    return error.what();
  }
  return "";
}

TEST(SerialPort, SaysWhatIsWrongAndTheWayOut)
{
  const TemporaryFolder folder;
  EXPECT_EQ("serial port " + folder.path() + "/none is not there; is the chassis plugged in and switched on?",
            openError(folder.path() + "/none"));
  EXPECT_EQ("/dev/null is not a serial port", openError("/dev/null"));
  try
  {
    SerialPort::checkBaudRate(1234);
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_EQ(0u, std::string(error.what()).find("baud_rate = 1234, must be one of 9600, 19200"));
  }
}

TEST(SerialPort, IsFoundByAPartOfItsName)
{
  const TemporaryFolder folder;
  folder.file("usb-FTDI_A-if00", "");
  folder.file("usb-FTDI_B-if00", "");
  EXPECT_EQ("/some/path", SerialPort::findPath("/some/path", folder.path()));
  EXPECT_EQ("/dev/null", SerialPort::findPath("null", folder.path()));
  EXPECT_EQ(folder.path() + "/usb-FTDI_B-if00", SerialPort::findPath("FTDI_B", folder.path()));
  EXPECT_THROW(SerialPort::findPath("FTDI", folder.path()), SerialError);
  EXPECT_THROW(SerialPort::findPath("CH340", folder.path()), SerialError);
  EXPECT_THROW(SerialPort::findPath("CH340", folder.path() + "/none"), SerialError);
}

TEST(SimulatedChassis, RefusesWhatItDoesNotUnderstand)
{
  SimulatedChassis chassis(SimulationOptions(), 0);
  for (const char* line : {"", "fly", "stuck", "stuck maybe", "battery 2", "battery", "garbage -1", "pose 1 2"})
  {
    EXPECT_NE(std::string::npos, chassis.command(line, 0).find("is not understood, must be one of")) << line;
  }
  for (const char* line : {"stuck on", "battery 0.5", "garbage 10", "pose 1 2 3", "restart", "button off", "silent on"})
  {
    EXPECT_EQ("", chassis.command(line, 0)) << line;
  }
  EXPECT_NE(std::string::npos, chassis.truth().find("\"x\": 1.00000, \"y\": 2.00000, \"yaw\": 3.000000"));
}

TEST(DriverOptions, WrongOnesAreNamed)
{
  DriverOptions options;
  options.port = "";
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = DriverOptions();
  options.longest_pause_s = 0.01;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  EXPECT_THROW(ChassisDriver(DriverOptions(), DriverEvents()), std::invalid_argument);
}

}  // namespace
}  // namespace pi_simulation
