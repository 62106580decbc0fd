#include <pi_vehicle/chassis/chassis_protocol.h>

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace pi_vehicle::chassis
{
namespace
{

constexpr double MILLI = 1e-3;
constexpr double CENTI = 1e-2;
constexpr double TENTH_MILLI = 1e-4;
constexpr size_t NAME_BYTES = 16;
constexpr uint16_t UNKNOWN_UNSIGNED = 0xFFFF;
constexpr int16_t UNKNOWN_SIGNED = std::numeric_limits<int16_t>::min();

constexpr uint8_t ENABLE = 1 << 0;
constexpr uint8_t EMERGENCY = 1 << 1;
constexpr uint8_t RELEASE = 1 << 2;
constexpr uint8_t COMMAND_FLAGS = ENABLE | EMERGENCY | RELEASE;
constexpr uint8_t COMMAND_SEEN = 1 << 0;

class Writer
{
public:
  void u8(uint8_t value) { bytes_.push_back(value); }
  void u16(uint16_t value)
  {
    u8(static_cast<uint8_t>(value & 0xFF));
    u8(static_cast<uint8_t>(value >> 8));
  }
  void u32(uint32_t value)
  {
    u16(static_cast<uint16_t>(value & 0xFFFF));
    u16(static_cast<uint16_t>(value >> 16));
  }
  /// In +-32767 steps.
  void fixedSigned(const char* field, double value, double step)
  {
    const double steps = std::clamp(std::round(finite(field, value) / step), -32767.0, 32767.0);
    u16(static_cast<uint16_t>(static_cast<int16_t>(steps)));
  }
  /// In 0 to 65534 steps.
  void fixedUnsigned(const char* field, double value, double step)
  {
    u16(static_cast<uint16_t>(std::clamp(std::round(finite(field, value) / step), 0.0, 65534.0)));
  }
  std::vector<uint8_t> take() { return std::move(bytes_); }

private:
  static double finite(const char* field, double value)
  {
    if (!std::isfinite(value))
    {
      throw std::invalid_argument(std::string(field) + " = " + std::to_string(value) + ", must be a finite number");
    }
    return value;
  }

  std::vector<uint8_t> bytes_;
};

/// The payload's length is checked before.
class Reader
{
public:
  explicit Reader(const std::vector<uint8_t>& bytes) : bytes_(bytes) {}
  uint8_t u8() { return bytes_.at(at_++); }
  uint16_t u16()
  {
    const uint16_t low = u8();
    return static_cast<uint16_t>(low | (u8() << 8));
  }
  uint32_t u32()
  {
    const uint32_t low = u16();
    return low | (static_cast<uint32_t>(u16()) << 16);
  }
  int16_t i16() { return static_cast<int16_t>(u16()); }
  double fixedSigned(double step) { return step * i16(); }
  double fixedUnsigned(double step) { return step * u16(); }

private:
  const std::vector<uint8_t>& bytes_;
  size_t at_ = 0;
};

constexpr size_t COMMAND_BYTES = 7;
constexpr size_t STATUS_BYTES = 26;
constexpr size_t HELLO_BYTES = 38;

std::vector<uint8_t> encode(FrameType type, uint16_t sequence, std::vector<uint8_t> payload)
{
  Frame frame;
  frame.type = static_cast<uint8_t>(type);
  frame.sequence = sequence;
  frame.payload = std::move(payload);
  return encodeFrame(frame);
}

bool is(const Frame& frame, FrameType type, size_t length)
{
  return frame.type == static_cast<uint8_t>(type) && frame.payload.size() == length;
}

}  // namespace

uint16_t crc16(const uint8_t* bytes, size_t count, uint16_t start)
{
  uint32_t crc = start;
  for (size_t i = 0; i < count; ++i)
  {
    crc ^= static_cast<uint32_t>(bytes[i]) << 8;
    for (int bit = 0; bit < 8; ++bit)
    {
      crc = (crc & 0x8000) != 0 ? (crc << 1) ^ 0x1021 : crc << 1;
    }
    crc &= 0xFFFF;
  }
  return static_cast<uint16_t>(crc);
}

std::vector<uint8_t> encodeFrame(const Frame& frame)
{
  if (frame.payload.size() > MAX_PAYLOAD_BYTES)
  {
    throw std::invalid_argument("payload = " + std::to_string(frame.payload.size()) + " bytes, must be at most " +
                                std::to_string(MAX_PAYLOAD_BYTES));
  }
  Writer writer;
  writer.u8(SYNC_BYTES[0]);
  writer.u8(SYNC_BYTES[1]);
  writer.u8(PROTOCOL_VERSION);
  writer.u8(frame.type);
  writer.u16(frame.sequence);
  writer.u8(static_cast<uint8_t>(frame.payload.size()));
  std::vector<uint8_t> bytes = writer.take();
  bytes.insert(bytes.end(), frame.payload.begin(), frame.payload.end());
  const uint16_t crc = crc16(bytes.data() + SYNC_BYTES.size(), bytes.size() - SYNC_BYTES.size());
  bytes.push_back(static_cast<uint8_t>(crc & 0xFF));
  bytes.push_back(static_cast<uint8_t>(crc >> 8));
  return bytes;
}

void FrameDecoder::add(const uint8_t* bytes, size_t count, std::vector<Frame>* frames)
{
  counters_.bytes += count;
  pending_.insert(pending_.end(), bytes, bytes + count);
  size_t at = 0;
  const auto skip = [this, &at](size_t skipped)
  {
    counters_.garbage_bytes += skipped;
    at += skipped;
  };
  while (at < pending_.size())
  {
    const uint8_t* frame = pending_.data() + at;
    const size_t left = pending_.size() - at;
    if (frame[0] != SYNC_BYTES[0] || (left > 1 && frame[1] != SYNC_BYTES[1]))
    {
      skip(1);
      continue;
    }
    if (left < HEADER_BYTES)
    {
      break;
    }
    const size_t length = frame[HEADER_BYTES - 1];
    if (length > MAX_PAYLOAD_BYTES)
    {
      ++counters_.wrong_length;
      skip(1);
      continue;
    }
    const size_t size = HEADER_BYTES + length + CRC_BYTES;
    if (left < size)
    {
      break;
    }
    const size_t covered = size - SYNC_BYTES.size() - CRC_BYTES;
    const uint16_t crc = static_cast<uint16_t>(frame[size - 2] | (frame[size - 1] << 8));
    if (crc != crc16(frame + SYNC_BYTES.size(), covered))
    {
      ++counters_.wrong_crc;
      skip(1);
      continue;
    }
    if (frame[2] != PROTOCOL_VERSION)
    {
      ++counters_.wrong_version;
      counters_.other_version = frame[2];
      skip(size);
      continue;
    }
    Frame found;
    found.type = frame[3];
    found.sequence = static_cast<uint16_t>(frame[4] | (frame[5] << 8));
    found.payload.assign(frame + HEADER_BYTES, frame + HEADER_BYTES + length);
    frames->push_back(std::move(found));
    ++counters_.frames;
    at += size;
  }
  pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(at));
}

void FrameDecoder::reset()
{
  counters_.garbage_bytes += pending_.size();
  pending_.clear();
}

std::string faultText(uint16_t faults)
{
  static const std::array<const char*, 8> NAMES = {"battery low",      "battery empty", "drive stuck", "steering stuck",
                                                   "emergency button", "overheated",    "internal",    "limited"};
  std::string text;
  for (size_t bit = 0; bit < 16; ++bit)
  {
    if ((faults & (1u << bit)) != 0)
    {
      text +=
          (text.empty() ? "" : ", ") + (bit < NAMES.size() ? std::string(NAMES[bit]) : "fault " + std::to_string(bit));
    }
  }
  return text;
}

const char* modeText(Mode mode)
{
  static const std::array<const char*, 5> NAMES = {"ready", "driving", "stopped by its watchdog", "emergency stop",
                                                   "fault"};
  return NAMES.at(static_cast<size_t>(mode));
}

void Limits::validate(const std::string& group) const
{
  const pi_node::OptionCheck check(group);
  check.range("speed", speed, 0.01, 30.0);
  check.range("reverse_speed", reverse_speed, 0.0, 30.0);
  check.range("curvature", curvature, 0.001, 3.0);
  check.range("acceleration", acceleration, 0.01, 30.0);
  check.range("deceleration", deceleration, 0.01, 30.0);
  check.range("usual_deceleration", usual_deceleration, 0.01, deceleration);
  check.range("lateral_acceleration", lateral_acceleration, 0.01, 30.0);
}

Limits limitsOf(const pi_node::MotionLimits& vehicle)
{
  return {vehicle.speed,
          vehicle.reverse_speed,
          vehicle.curvature,
          vehicle.acceleration,
          vehicle.emergency_deceleration,
          vehicle.deceleration,
          vehicle.lateral_acceleration};
}

Limits intersection(const Limits& a, const Limits& b)
{
  Limits both;
  both.speed = std::min(a.speed, b.speed);
  both.reverse_speed = std::min(a.reverse_speed, b.reverse_speed);
  both.curvature = std::min(a.curvature, b.curvature);
  both.acceleration = std::min(a.acceleration, b.acceleration);
  both.deceleration = std::min(a.deceleration, b.deceleration);
  both.usual_deceleration = std::min({a.usual_deceleration, b.usual_deceleration, both.deceleration});
  both.lateral_acceleration = std::min(a.lateral_acceleration, b.lateral_acceleration);
  return both;
}

Command withinLimits(const Command& command, const Limits& limits, bool* cut)
{
  Command within = command;
  within.curvature = std::clamp(command.curvature, -limits.curvature, limits.curvature);
  const double bend = std::abs(within.curvature);
  const double in_bend = bend > 0.0 ? std::sqrt(limits.lateral_acceleration / bend) : limits.speed;
  within.speed = std::clamp(command.speed, -std::min(limits.reverse_speed, in_bend), std::min(limits.speed, in_bend));
  within.deceleration =
      std::min(command.deceleration > 0.0 ? command.deceleration : limits.usual_deceleration, limits.deceleration);
  if (cut != nullptr)
  {
    *cut = std::abs(within.curvature - command.curvature) > TENTH_MILLI ||
           std::abs(within.speed - command.speed) > MILLI ||
           (command.deceleration > 0.0 && command.deceleration - within.deceleration > MILLI);
  }
  return within;
}

double rampSpeed(double speed, double target, double acceleration, double deceleration, double dt)
{
  if (speed * target < 0.0)  // the other direction: to a stand first
  {
    const double stop_s = std::abs(speed) / deceleration;
    if (stop_s >= dt)
    {
      return speed - std::copysign(deceleration * dt, speed);
    }
    return rampSpeed(0.0, target, acceleration, deceleration, dt - stop_s);
  }
  const double rate = std::abs(target) > std::abs(speed) ? acceleration : deceleration;
  return speed + std::clamp(target - speed, -rate * dt, rate * dt);
}

std::vector<uint8_t> encodeCommand(const Command& command, uint16_t sequence)
{
  Writer writer;
  writer.fixedSigned("speed", command.speed, MILLI);
  writer.fixedSigned("curvature", command.curvature, TENTH_MILLI);
  writer.fixedUnsigned("deceleration", command.deceleration, MILLI);
  writer.u8(static_cast<uint8_t>((command.enable ? ENABLE : 0) | (command.emergency_stop ? EMERGENCY : 0) |
                                 (command.release ? RELEASE : 0)));
  return encode(FrameType::COMMAND, sequence, writer.take());
}

std::vector<uint8_t> encodeHelloRequest(uint16_t sequence)
{
  return encode(FrameType::HELLO_REQUEST, sequence, {});
}

std::vector<uint8_t> encodeStatus(const Status& status, uint16_t sequence)
{
  Writer writer;
  writer.u16(status.echoed_sequence);
  writer.u8(status.command_seen ? COMMAND_SEEN : 0);
  writer.u8(static_cast<uint8_t>(status.mode));
  writer.u16(status.faults);
  writer.fixedSigned("speed", status.speed, MILLI);
  writer.fixedSigned("curvature", status.curvature, TENTH_MILLI);
  writer.fixedSigned("steering", status.steering, TENTH_MILLI);
  writer.u32(status.travel);
  status.battery_voltage ? writer.fixedUnsigned("battery_voltage", *status.battery_voltage, MILLI)
                         : writer.u16(UNKNOWN_UNSIGNED);
  status.battery_current ? writer.fixedSigned("battery_current", *status.battery_current, CENTI)
                         : writer.u16(static_cast<uint16_t>(UNKNOWN_SIGNED));
  status.battery_charge
      ? writer.fixedUnsigned("battery_charge", std::clamp(*status.battery_charge, 0.0, 1.0), TENTH_MILLI)
      : writer.u16(UNKNOWN_UNSIGNED);
  writer.u32(status.uptime_ms);
  return encode(FrameType::STATUS, sequence, writer.take());
}

std::vector<uint8_t> encodeHello(const Hello& hello, uint16_t sequence)
{
  Writer writer;
  writer.u8(hello.protocol_version);
  writer.u8(static_cast<uint8_t>(hello.kind));
  writer.fixedUnsigned("wheelbase", hello.wheelbase, MILLI);
  writer.fixedUnsigned("speed", hello.limits.speed, MILLI);
  writer.fixedUnsigned("reverse_speed", hello.limits.reverse_speed, MILLI);
  writer.fixedUnsigned("curvature", hello.limits.curvature, TENTH_MILLI);
  writer.fixedUnsigned("acceleration", hello.limits.acceleration, MILLI);
  writer.fixedUnsigned("deceleration", hello.limits.deceleration, MILLI);
  writer.fixedUnsigned("usual_deceleration", hello.limits.usual_deceleration, MILLI);
  writer.fixedUnsigned("lateral_acceleration", hello.limits.lateral_acceleration, MILLI);
  writer.fixedUnsigned("watchdog_s", hello.watchdog_s, MILLI);
  writer.fixedUnsigned("status_period_s", hello.status_period_s, MILLI);
  for (size_t i = 0; i < NAME_BYTES; ++i)
  {
    const char letter = i < hello.name.size() ? hello.name[i] : '\0';
    writer.u8(static_cast<uint8_t>(letter == '\0' || (letter >= ' ' && letter <= '~') ? letter : '?'));
  }
  return encode(FrameType::HELLO, sequence, writer.take());
}

std::optional<Command> decodeCommand(const Frame& frame)
{
  if (!is(frame, FrameType::COMMAND, COMMAND_BYTES))
  {
    return std::nullopt;
  }
  Reader reader(frame.payload);
  const int16_t speed = reader.i16();
  const int16_t curvature = reader.i16();
  const uint16_t deceleration = reader.u16();
  const uint8_t flags = reader.u8();
  if (speed == UNKNOWN_SIGNED || curvature == UNKNOWN_SIGNED || deceleration == UNKNOWN_UNSIGNED ||
      (flags & ~COMMAND_FLAGS) != 0)
  {
    return std::nullopt;
  }
  Command command;
  command.speed = MILLI * speed;
  command.curvature = TENTH_MILLI * curvature;
  command.deceleration = MILLI * deceleration;
  command.enable = (flags & ENABLE) != 0;
  command.emergency_stop = (flags & EMERGENCY) != 0;
  command.release = (flags & RELEASE) != 0;
  return command;
}

std::optional<Status> decodeStatus(const Frame& frame)
{
  if (!is(frame, FrameType::STATUS, STATUS_BYTES))
  {
    return std::nullopt;
  }
  Reader reader(frame.payload);
  Status status;
  status.echoed_sequence = reader.u16();
  status.command_seen = (reader.u8() & COMMAND_SEEN) != 0;
  const uint8_t mode = reader.u8();
  if (mode > static_cast<uint8_t>(Mode::FAULT))
  {
    return std::nullopt;
  }
  status.mode = static_cast<Mode>(mode);
  status.faults = reader.u16();
  status.speed = reader.fixedSigned(MILLI);
  status.curvature = reader.fixedSigned(TENTH_MILLI);
  status.steering = reader.fixedSigned(TENTH_MILLI);
  status.travel = reader.u32();
  if (const uint16_t voltage = reader.u16(); voltage != UNKNOWN_UNSIGNED)
  {
    status.battery_voltage = MILLI * voltage;
  }
  if (const int16_t current = reader.i16(); current != UNKNOWN_SIGNED)
  {
    status.battery_current = CENTI * current;
  }
  if (const uint16_t charge = reader.u16(); charge != UNKNOWN_UNSIGNED)
  {
    if (charge > 10000)
    {
      return std::nullopt;
    }
    status.battery_charge = TENTH_MILLI * charge;
  }
  status.uptime_ms = reader.u32();
  return status;
}

std::optional<Hello> decodeHello(const Frame& frame)
{
  if (!is(frame, FrameType::HELLO, HELLO_BYTES))
  {
    return std::nullopt;
  }
  Reader reader(frame.payload);
  Hello hello;
  hello.protocol_version = reader.u8();
  const uint8_t kind = reader.u8();
  if (kind > static_cast<uint8_t>(Kind::DIFFERENTIAL))
  {
    return std::nullopt;
  }
  hello.kind = static_cast<Kind>(kind);
  hello.wheelbase = reader.fixedUnsigned(MILLI);
  hello.limits.speed = reader.fixedUnsigned(MILLI);
  hello.limits.reverse_speed = reader.fixedUnsigned(MILLI);
  hello.limits.curvature = reader.fixedUnsigned(TENTH_MILLI);
  hello.limits.acceleration = reader.fixedUnsigned(MILLI);
  hello.limits.deceleration = reader.fixedUnsigned(MILLI);
  hello.limits.usual_deceleration = reader.fixedUnsigned(MILLI);
  hello.limits.lateral_acceleration = reader.fixedUnsigned(MILLI);
  hello.watchdog_s = reader.fixedUnsigned(MILLI);
  hello.status_period_s = reader.fixedUnsigned(MILLI);
  for (size_t i = 0; i < NAME_BYTES; ++i)
  {
    const char letter = static_cast<char>(reader.u8());
    if (letter >= ' ' && letter <= '~')
    {
      hello.name += letter;
    }
  }
  try
  {
    hello.limits.validate();
  }
  catch (const std::invalid_argument&)
  {
    return std::nullopt;
  }
  const bool plausible = hello.wheelbase >= 0.05 && hello.watchdog_s >= 0.05 && hello.status_period_s > 0.0;
  return plausible ? std::optional<Hello>(hello) : std::nullopt;
}

}  // namespace pi_vehicle::chassis
