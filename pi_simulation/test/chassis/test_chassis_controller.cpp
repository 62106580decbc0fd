// The chassis's end: watchdog, limits, latches, whatever the host does.

#include "chassis/chassis_controller.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace pi_simulation
{

using namespace pi_vehicle::chassis;

namespace
{

/// A controller whose wheels follow at once, with a clock that the test moves.
class OnBench : public testing::Test
{
protected:
  void send(const Command& command) { sendBytes(encodeCommand(command, sequence_++)); }
  void sendBytes(const std::vector<uint8_t>& bytes) { controller_.onBytes(bytes.data(), bytes.size(), now_ns_); }

  /// 5 ms later.
  void tick()
  {
    now_ns_ += 5'000'000;
    const double before = measured_.speed;
    const Setpoint setpoint = controller_.update(measured_, now_ns_);
    hardest_ = std::max(hardest_, std::abs(setpoint.speed - before) / 0.005);
    if (!blocked_)
    {
      measured_.speed = setpoint.speed;
      measured_.curvature = setpoint.curvature;
    }
    const std::vector<uint8_t> output = controller_.takeOutput();
    std::vector<Frame> frames;
    decoder_.add(output.data(), output.size(), &frames);
    for (const Frame& frame : frames)
    {
      if (const auto status = decodeStatus(frame))
      {
        status_ = *status;
        ++statuses_;
      }
      hellos_ += decodeHello(frame) ? 1 : 0;
    }
  }

  void run(double seconds, const Command* command)
  {
    for (int i = 0; i < std::lround(seconds / 0.005); ++i)
    {
      if (command != nullptr && i % 4 == 0)
      {
        send(*command);
      }
      tick();
    }
  }

  static Command forward(double speed)
  {
    Command command;
    command.speed = speed;
    command.enable = true;
    return command;
  }

  int64_t now_ns_ = 0;
  ChassisController controller_{Hello(), 0};
  Measurement measured_;
  FrameDecoder decoder_;
  Status status_;
  int statuses_ = 0;
  int hellos_ = 0;
  uint16_t sequence_ = 65530;  // wraps around soon
  double hardest_ = 0.0;
  bool blocked_ = false;
};

using ChassisControllerTest = OnBench;

TEST_F(ChassisControllerTest, SaysHelloAtItsStartAndWhenAsked)
{
  tick();
  EXPECT_EQ(1, hellos_);
  sendBytes(encodeHelloRequest(1));
  tick();
  EXPECT_EQ(2, hellos_);
}

TEST_F(ChassisControllerTest, RampsToTheCommandAndEchoesItsSequence)
{
  const Command command = forward(1.0);
  run(0.5, &command);
  EXPECT_NEAR(0.5, measured_.speed, 0.02);
  EXPECT_EQ(Mode::DRIVING, status_.mode);
  run(1.0, &command);
  EXPECT_NEAR(1.0, measured_.speed, 1e-9);
  EXPECT_TRUE(status_.command_seen);
  EXPECT_EQ(static_cast<uint16_t>(sequence_ - 1), status_.echoed_sequence);
  EXPECT_NEAR(75, statuses_, 2);  // 50 Hz
}

TEST_F(ChassisControllerTest, DoesNotMoveWithoutEnable)
{
  Command command = forward(1.0);
  command.enable = false;
  run(1.0, &command);
  EXPECT_EQ(0.0, measured_.speed);
  EXPECT_EQ(Mode::READY, status_.mode);
}

TEST_F(ChassisControllerTest, LimitsHoldWhateverIsCommanded)
{
  std::mt19937 random(99);
  std::uniform_real_distribution<double> any(-30.0, 30.0);
  for (int i = 0; i < 2000; ++i)
  {
    Command command = forward(any(random));
    command.curvature = any(random);
    command.deceleration = std::abs(any(random));
    send(command);
    tick();
    const Limits& limits = controller_.hello().limits;
    ASSERT_LE(measured_.speed, limits.speed + 1e-9);
    ASSERT_GE(measured_.speed, -limits.reverse_speed - 1e-9);
    ASSERT_LE(std::abs(measured_.curvature), limits.curvature + 1e-9);
  }
  EXPECT_LE(hardest_, 2.5 + 1e-6);
  EXPECT_NE(0, status_.faults & LIMITED);
}

TEST_F(ChassisControllerTest, StopsWhenCommandsCeaseAndGoesOnWhenTheyComeAgain)
{
  const Command command = forward(2.0);
  run(3.0, &command);
  ASSERT_NEAR(2.0, measured_.speed, 1e-9);
  run(0.2, nullptr);
  EXPECT_NEAR(2.0, measured_.speed, 1e-9);  // 0.25 s are not over
  run(0.2 + 2.0 / 2.5, nullptr);
  EXPECT_EQ(0.0, measured_.speed);
  EXPECT_EQ(Mode::STOPPED_WATCHDOG, status_.mode);
  EXPECT_EQ(1u, controller_.counters().watchdog_stops);
  run(1.0, &command);
  EXPECT_GT(measured_.speed, 0.9);
  EXPECT_EQ(Mode::DRIVING, status_.mode);
}

TEST_F(ChassisControllerTest, AFrameThatComesAgainDoesNotFeedTheWatchdog)
{
  const Command command = forward(1.0);
  run(1.5, &command);
  const std::vector<uint8_t> old = encodeCommand(command, static_cast<uint16_t>(sequence_ - 1));
  for (int i = 0; i < 40; ++i)
  {
    sendBytes(old);
    tick();
  }
  ASSERT_EQ(Mode::DRIVING, controller_.mode());
  for (int i = 0; i < 20; ++i)
  {
    sendBytes(old);
    tick();
    if (controller_.mode() == Mode::STOPPED_WATCHDOG)
    {
      break;
    }
  }
  EXPECT_EQ(1u, controller_.counters().watchdog_stops);
  EXPECT_GE(controller_.counters().old_commands, 40u);
}

TEST_F(ChassisControllerTest, DamagedCommandsDoNotFeedTheWatchdog)
{
  const Command command = forward(1.0);
  run(1.5, &command);
  for (int i = 0; i < 60 + 100; ++i)
  {
    std::vector<uint8_t> bytes = encodeCommand(command, sequence_++);
    bytes[8] ^= 0x10;
    sendBytes(bytes);
    tick();
  }
  EXPECT_EQ(0.0, measured_.speed);
  EXPECT_EQ(Mode::STOPPED_WATCHDOG, controller_.mode());
  EXPECT_GT(controller_.decoder().wrong_crc, 100u);
}

TEST_F(ChassisControllerTest, EmergencyStopLatchesUntilItIsReleasedAtSpeedZero)
{
  Command command = forward(2.0);
  run(3.0, &command);
  Command emergency = command;
  emergency.emergency_stop = true;
  send(emergency);
  run(1.0, &command);
  EXPECT_EQ(0.0, measured_.speed);
  EXPECT_EQ(Mode::EMERGENCY_STOP, status_.mode);
  Command release = forward(1.0);  // not with a speed
  release.release = true;
  run(0.1, &release);
  EXPECT_EQ(Mode::EMERGENCY_STOP, status_.mode);
  release.speed = 0.0;
  release.emergency_stop = true;  // nor with an emergency stop
  run(0.1, &release);
  EXPECT_EQ(Mode::EMERGENCY_STOP, status_.mode);
  release.emergency_stop = false;
  run(0.1, &release);
  EXPECT_EQ(Mode::READY, status_.mode);
  run(1.0, &command);
  EXPECT_GT(measured_.speed, 0.9);
}

TEST_F(ChassisControllerTest, EmergencyStopSurvivesTheWatchdogAndAnotherHost)
{
  Command command;
  command.emergency_stop = true;
  send(command);
  run(1.0, nullptr);
  EXPECT_EQ(Mode::EMERGENCY_STOP, status_.mode);
  sendBytes(encodeHelloRequest(1));
  command = forward(1.0);
  run(0.5, &command);
  EXPECT_EQ(Mode::EMERGENCY_STOP, status_.mode);
  EXPECT_EQ(0.0, measured_.speed);
}

TEST_F(ChassisControllerTest, ButtonOnTheVehicleStopsAndCannotBeReleasedWhilePressed)
{
  const Command command = forward(1.0);
  run(1.5, &command);
  measured_.faults = EMERGENCY_BUTTON;
  Command release;
  release.release = true;
  run(1.0, &release);
  EXPECT_EQ(Mode::EMERGENCY_STOP, status_.mode);
  EXPECT_EQ(0.0, measured_.speed);
  measured_.faults = 0;
  run(0.1, &command);
  EXPECT_EQ(Mode::EMERGENCY_STOP, status_.mode);
  run(0.1, &release);
  EXPECT_EQ(Mode::READY, status_.mode);
}

TEST_F(ChassisControllerTest, WheelsThatDoNotTurnAreAFaultUntilReleased)
{
  blocked_ = true;
  const Command command = forward(1.0);
  run(1.0, &command);
  EXPECT_EQ(Mode::DRIVING, status_.mode);
  run(0.5, &command);
  EXPECT_EQ(Mode::FAULT, status_.mode);
  EXPECT_NE(0, status_.faults & DRIVE_STUCK);
  blocked_ = false;
  run(1.0, &command);
  EXPECT_EQ(Mode::FAULT, status_.mode);
  EXPECT_EQ(0.0, measured_.speed);
  Command release;
  release.release = true;
  run(0.1, &release);
  EXPECT_EQ(Mode::READY, status_.mode);
}

TEST_F(ChassisControllerTest, EmptyBatteryStopsAndALowOneWarns)
{
  const Command command = forward(1.0);
  measured_.faults = BATTERY_LOW;
  run(1.5, &command);
  EXPECT_EQ(Mode::DRIVING, status_.mode);
  EXPECT_EQ(BATTERY_LOW, status_.faults);
  measured_.faults = BATTERY_LOW | BATTERY_EMPTY;
  run(1.0, &command);
  EXPECT_EQ(Mode::FAULT, status_.mode);
  EXPECT_EQ(0.0, measured_.speed);
}

TEST_F(ChassisControllerTest, NothingButCommandsMovesIt)
{
  std::mt19937 random(5);
  for (int i = 0; i < 20000; ++i)
  {
    std::vector<uint8_t> bytes(random() % 64);
    for (uint8_t& byte : bytes)
    {
      const uint32_t draw = random();
      byte = draw % 4 == 0 ? 0xA5 : draw % 4 == 1 ? 0x5A : static_cast<uint8_t>(draw >> 8);
    }
    sendBytes(bytes);
    tick();
    ASSERT_EQ(0.0, measured_.speed);
  }
  EXPECT_GT(controller_.decoder().garbage_bytes, 100000u);
}

}  // namespace
}  // namespace pi_simulation
