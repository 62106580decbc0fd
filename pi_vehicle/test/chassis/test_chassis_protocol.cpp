// The frames on the wire: as specified, byte by byte, and whatever bytes come.

#include <pi_vehicle/chassis/chassis_protocol.h>

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_vehicle::chassis
{
namespace
{

std::vector<Frame> decode(FrameDecoder* decoder, const std::vector<uint8_t>& bytes)
{
  std::vector<Frame> frames;
  decoder->add(bytes.data(), bytes.size(), &frames);
  return frames;
}

Frame onlyFrame(const std::vector<uint8_t>& bytes)
{
  FrameDecoder decoder;
  const std::vector<Frame> frames = decode(&decoder, bytes);
  EXPECT_EQ(1u, frames.size());
  EXPECT_EQ(0u, decoder.counters().garbage_bytes);
  return frames.size() == 1 ? frames.front() : Frame();
}

Command someCommand()
{
  Command command;
  command.speed = -1.25;
  command.curvature = 0.3;
  command.deceleration = 1.5;
  command.enable = true;
  return command;
}

TEST(ChassisProtocol, CrcIsCcittFalse)
{
  const std::string text = "123456789";
  EXPECT_EQ(0x29B1, crc16(reinterpret_cast<const uint8_t*>(text.data()), text.size()));
  EXPECT_EQ(0xFFFF, crc16(nullptr, 0));
}

TEST(ChassisProtocol, CommandHasTheBytesOfTheSpecification)
{
  std::vector<uint8_t> expected = {0xA5, 0x5A, 0x01, 0x01, 0x34, 0x12, 0x07, 0x1E, 0xFB, 0xB8, 0x0B, 0xDC, 0x05, 0x01};
  const uint16_t crc = crc16(expected.data() + 2, expected.size() - 2);
  expected.push_back(static_cast<uint8_t>(crc & 0xFF));
  expected.push_back(static_cast<uint8_t>(crc >> 8));
  EXPECT_EQ(expected, encodeCommand(someCommand(), 0x1234));
  EXPECT_EQ(9u + 26u, encodeStatus(Status(), 0).size());
  EXPECT_EQ(9u + 38u, encodeHello(Hello(), 0).size());
  EXPECT_EQ(9u, encodeHelloRequest(0).size());
}

TEST(ChassisProtocol, CommandsComeBack)
{
  Command command = someCommand();
  command.emergency_stop = true;
  command.release = true;
  const Frame frame = onlyFrame(encodeCommand(command, 65535));
  EXPECT_EQ(65535, frame.sequence);
  const auto again = decodeCommand(frame);
  ASSERT_TRUE(again);
  EXPECT_NEAR(command.speed, again->speed, 1e-9);
  EXPECT_NEAR(command.curvature, again->curvature, 1e-9);
  EXPECT_NEAR(command.deceleration, again->deceleration, 1e-9);
  EXPECT_TRUE(again->enable && again->emergency_stop && again->release);
  EXPECT_FALSE(decodeStatus(frame));
  EXPECT_FALSE(decodeHello(frame));
}

TEST(ChassisProtocol, CommandsBeyondTheWireAreCutAndNumbersThatAreNoneRefused)
{
  Command command;
  command.speed = 1e9;
  command.curvature = -1e9;
  command.deceleration = -1.0;
  const auto again = decodeCommand(onlyFrame(encodeCommand(command, 0)));
  ASSERT_TRUE(again);
  EXPECT_NEAR(32.767, again->speed, 1e-9);
  EXPECT_NEAR(-3.2767, again->curvature, 1e-9);
  EXPECT_EQ(0.0, again->deceleration);
  command.speed = std::nan("");
  EXPECT_THROW(encodeCommand(command, 0), std::invalid_argument);
  command.speed = std::numeric_limits<double>::infinity();
  EXPECT_THROW(encodeCommand(command, 0), std::invalid_argument);
}

TEST(ChassisProtocol, StatusComesBack)
{
  Status status;
  status.echoed_sequence = 40000;
  status.command_seen = true;
  status.mode = Mode::FAULT;
  status.faults = DRIVE_STUCK | BATTERY_LOW;
  status.speed = -0.512;
  status.curvature = 0.1234;
  status.steering = -0.2;
  status.travel = 0xFEDCBA98;
  status.battery_voltage = 25.123;
  status.battery_current = -12.34;
  status.uptime_ms = 4000000000;
  const auto again = decodeStatus(onlyFrame(encodeStatus(status, 7)));
  ASSERT_TRUE(again);
  EXPECT_EQ(status.echoed_sequence, again->echoed_sequence);
  EXPECT_TRUE(again->command_seen);
  EXPECT_EQ(Mode::FAULT, again->mode);
  EXPECT_EQ(status.faults, again->faults);
  EXPECT_NEAR(status.speed, again->speed, 1e-9);
  EXPECT_NEAR(status.curvature, again->curvature, 1e-9);
  EXPECT_NEAR(status.steering, again->steering, 1e-9);
  EXPECT_EQ(status.travel, again->travel);
  EXPECT_NEAR(25.123, *again->battery_voltage, 1e-9);
  EXPECT_NEAR(-12.34, *again->battery_current, 1e-9);
  EXPECT_FALSE(again->battery_charge);  // unknown stays unknown
  EXPECT_EQ(status.uptime_ms, again->uptime_ms);
  EXPECT_EQ("battery low, drive stuck", faultText(again->faults));
  EXPECT_EQ("fault 15", faultText(0x8000));
}

TEST(ChassisProtocol, HelloComesBackWithANameThatFits)
{
  Hello hello;
  hello.kind = Kind::DIFFERENTIAL;
  hello.wheelbase = 0.55;
  hello.limits.speed = 1.5;
  hello.limits.reverse_speed = 0.0;
  hello.watchdog_s = 0.3;
  hello.name = "a name that is longer than sixteen";
  const auto again = decodeHello(onlyFrame(encodeHello(hello, 7)));
  ASSERT_TRUE(again);
  EXPECT_EQ(Kind::DIFFERENTIAL, again->kind);
  EXPECT_NEAR(0.55, again->wheelbase, 1e-9);
  EXPECT_NEAR(1.5, again->limits.speed, 1e-9);
  EXPECT_EQ(0.0, again->limits.reverse_speed);
  EXPECT_NEAR(0.45, again->limits.curvature, 1e-9);
  EXPECT_NEAR(0.3, again->watchdog_s, 1e-9);
  EXPECT_EQ("a name that is l", again->name);
}

TEST(ChassisProtocol, PayloadsThatMeanNothingAreRefused)
{
  Frame command = onlyFrame(encodeCommand(someCommand(), 0));
  command.payload[6] = 0x08;  // a flag that there is not
  EXPECT_FALSE(decodeCommand(command));
  command.payload.pop_back();
  EXPECT_FALSE(decodeCommand(command));
  Frame status = onlyFrame(encodeStatus(Status(), 0));
  status.payload[3] = 5;  // a mode that there is not
  EXPECT_FALSE(decodeStatus(status));
  Frame hello = onlyFrame(encodeHello(Hello(), 0));
  hello.payload[4] = 0;  // a greatest speed of 0
  hello.payload[5] = 0;
  EXPECT_FALSE(decodeHello(hello));
}

TEST(FrameDecoder, FindsFramesWhateverTheChunks)
{
  std::vector<uint8_t> stream;
  for (uint16_t i = 0; i < 50; ++i)
  {
    const std::vector<uint8_t> bytes = i % 2 == 0 ? encodeCommand(someCommand(), i) : encodeStatus(Status(), i);
    stream.insert(stream.end(), bytes.begin(), bytes.end());
  }
  for (size_t chunk = 1; chunk < 100; chunk += 7)
  {
    FrameDecoder decoder;
    std::vector<Frame> frames;
    for (size_t at = 0; at < stream.size(); at += chunk)
    {
      decoder.add(stream.data() + at, std::min(chunk, stream.size() - at), &frames);
    }
    ASSERT_EQ(50u, frames.size()) << chunk;
    EXPECT_EQ(49, frames.back().sequence);
    EXPECT_EQ(0u, decoder.counters().garbage_bytes);
  }
}

TEST(FrameDecoder, AFrameBehindAFalseSyncIsNotLost)
{
  const std::vector<uint8_t> good = encodeCommand(someCommand(), 9);
  for (size_t cut = 1; cut < good.size(); ++cut)  // the beginning of a frame, then a whole one
  {
    FrameDecoder decoder;
    std::vector<uint8_t> bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(cut));
    bytes.insert(bytes.end(), good.begin(), good.end());
    bytes.insert(bytes.end(), 80, 0);  // what a false length waits for
    const std::vector<Frame> frames = decode(&decoder, bytes);
    ASSERT_EQ(1u, frames.size()) << cut;
    EXPECT_EQ(9, frames.front().sequence);
    EXPECT_EQ(cut + 80, decoder.counters().garbage_bytes);
  }
}

TEST(FrameDecoder, EverySingleDamagedBitIsSeen)
{
  const std::vector<uint8_t> good = encodeStatus(Status(), 9);
  for (size_t bit = 0; bit < 8 * good.size(); ++bit)
  {
    std::vector<uint8_t> bad = good;
    bad[bit / 8] ^= static_cast<uint8_t>(1u << (bit % 8));
    bad.insert(bad.end(), 2 * MAX_FRAME_BYTES, 0);
    FrameDecoder decoder;
    EXPECT_TRUE(decode(&decoder, bad).empty()) << bit;
    EXPECT_EQ(bad.size(), decoder.counters().garbage_bytes) << bit;
  }
}

TEST(FrameDecoder, FramesOfAnotherVersionAreCountedAndNamed)
{
  std::vector<uint8_t> bytes = encodeHelloRequest(1);
  bytes[2] = 9;
  const uint16_t crc = crc16(bytes.data() + 2, bytes.size() - 4);
  bytes[bytes.size() - 2] = static_cast<uint8_t>(crc & 0xFF);
  bytes[bytes.size() - 1] = static_cast<uint8_t>(crc >> 8);
  FrameDecoder decoder;
  EXPECT_TRUE(decode(&decoder, bytes).empty());
  EXPECT_EQ(1u, decoder.counters().wrong_version);
  EXPECT_EQ(9, decoder.counters().other_version);
}

TEST(FrameDecoder, SurvivesAnyBytesAndFindsWhatIsGoodAmongThem)
{
  std::mt19937 random(4711);
  FrameDecoder decoder;
  size_t sent = 0;
  size_t found = 0;
  uint64_t bytes = 0;
  for (int round = 0; round < 20000; ++round)
  {
    std::vector<uint8_t> stream(random() % 40);
    for (uint8_t& byte : stream)  // sync bytes more often than chance has them
    {
      const uint32_t draw = random();
      byte = draw % 8 == 0 ? 0xA5 : draw % 8 == 1 ? 0x5A : static_cast<uint8_t>(draw >> 8);
    }
    const std::vector<uint8_t> good = encodeCommand(someCommand(), static_cast<uint16_t>(round));
    stream.insert(stream.end(), good.begin(), good.end());
    ++sent;
    bytes += stream.size();
    for (const Frame& frame : decode(&decoder, stream))
    {
      found += decodeCommand(frame) ? 1 : 0;
    }
  }
  const std::vector<uint8_t> rest(2 * MAX_FRAME_BYTES, 0);
  bytes += rest.size();
  for (const Frame& frame : decode(&decoder, rest))
  {
    found += decodeCommand(frame) ? 1 : 0;
  }
  // A false frame of noise passes a CRC of 16 bits once in 65536, and may swallow a good one.
  EXPECT_GE(found + 2, sent);
  EXPECT_LE(found, sent);
  EXPECT_EQ(bytes, decoder.counters().bytes);
  EXPECT_GT(decoder.counters().wrong_crc, 0u);
  EXPECT_GT(decoder.counters().wrong_length, 0u);
}

TEST(Payloads, SurviveAnyBytes)
{
  std::mt19937 random(4712);
  for (int round = 0; round < 200000; ++round)
  {
    Frame frame;
    frame.type = std::array<uint8_t, 5>{0x01, 0x02, 0x81, 0x82, 0x77}[random() % 5];
    frame.payload.resize(std::array<size_t, 5>{7, 26, 38, 0, random() % 65}[random() % 5]);
    for (uint8_t& byte : frame.payload)
    {
      byte = static_cast<uint8_t>(random());
    }
    if (const auto command = decodeCommand(frame))
    {
      ASSERT_LE(std::abs(command->speed), 32.7671);
      ASSERT_GE(command->deceleration, 0.0);
    }
    if (const auto hello = decodeHello(frame))
    {
      ASSERT_NO_THROW(hello->limits.validate());
    }
    if (const auto status = decodeStatus(frame))
    {
      ASSERT_TRUE(std::isfinite(status->speed));
      ASSERT_LE(status->battery_charge.value_or(0.0), 1.0);
    }
  }
}

TEST(Limits, CutSpeedCurvatureAndDeceleration)
{
  const Limits limits;
  Command command;
  command.speed = 9.0;
  command.deceleration = 9.0;
  bool cut = false;
  EXPECT_EQ(3.0, withinLimits(command, limits, &cut).speed);
  EXPECT_EQ(2.5, withinLimits(command, limits, &cut).deceleration);
  EXPECT_TRUE(cut);
  command.speed = -9.0;
  EXPECT_EQ(-1.0, withinLimits(command, limits, &cut).speed);
  command.speed = 3.0;
  command.curvature = -0.9;  // cut to 0.45, where 2 m/s^2 sideways allow 2.11 m/s
  EXPECT_EQ(-0.45, withinLimits(command, limits, &cut).curvature);
  EXPECT_NEAR(std::sqrt(2.0 / 0.45), withinLimits(command, limits, &cut).speed, 1e-12);
  command = Command();
  command.speed = 2.0;
  EXPECT_EQ(1.0, withinLimits(command, limits, &cut).deceleration);  // 0 is the usual one
  EXPECT_FALSE(cut);
}

TEST(Limits, NameFieldValueAndBound)
{
  Limits limits;
  limits.usual_deceleration = 3.0;
  try
  {
    limits.validate();
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ("usual_deceleration = 3, must be in [0.01, 2.5]", error.what());
  }
}

TEST(Ramp, SpeedsUpAndSlowsDownAtTheirRatesAndEndsOnTheTarget)
{
  EXPECT_NEAR(0.1, rampSpeed(0.0, 1.0, 1.0, 2.0, 0.1), 1e-12);
  EXPECT_NEAR(0.8, rampSpeed(1.0, 0.0, 1.0, 2.0, 0.1), 1e-12);
  EXPECT_EQ(0.0, rampSpeed(0.1, 0.0, 1.0, 2.0, 1.0));
  EXPECT_EQ(-1.0, rampSpeed(-0.95, -1.0, 1.0, 2.0, 1.0));
  EXPECT_NEAR(-0.8, rampSpeed(-1.0, 0.5, 1.0, 2.0, 0.1), 1e-12);
  EXPECT_NEAR(0.05, rampSpeed(-0.1, 1.0, 1.0, 2.0, 0.1), 1e-12);  // 0.05 s to a stand, 0.05 s the other way
}

}  // namespace
}  // namespace pi_vehicle::chassis
