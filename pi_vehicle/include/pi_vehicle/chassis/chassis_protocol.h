#pragma once

#include <pi_node/vehicle_description.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

/// The frames between host and chassis; docs/design/chassis_link.md is the specification.
///
///   A5 5A | version | type | sequence (2) | length | payload (length) | CRC (2)
///
/// Numbers are little-endian. The CRC covers version to payload.
namespace pi_vehicle::chassis
{

constexpr uint8_t PROTOCOL_VERSION = 1;
constexpr std::array<uint8_t, 2> SYNC_BYTES = {0xA5, 0x5A};
constexpr size_t HEADER_BYTES = 7;  ///< sync to length
constexpr size_t CRC_BYTES = 2;
constexpr size_t MAX_PAYLOAD_BYTES = 64;  ///< a longer frame is refused
constexpr size_t MAX_FRAME_BYTES = HEADER_BYTES + MAX_PAYLOAD_BYTES + CRC_BYTES;

enum class FrameType : uint8_t
{
  COMMAND = 0x01,        ///< host -> chassis
  HELLO_REQUEST = 0x02,  ///< host -> chassis, no payload
  STATUS = 0x81,         ///< chassis -> host
  HELLO = 0x82,          ///< chassis -> host: at its start and when asked
};

struct Frame
{
  uint8_t type = 0;       ///< a FrameType, or one that a later minor version adds
  uint16_t sequence = 0;  ///< of the sender, one more each frame
  std::vector<uint8_t> payload;
};

/// CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected; 0x29B1 for "123456789".
uint16_t crc16(const uint8_t* bytes, size_t count, uint16_t start = 0xFFFF);

/// @throws std::invalid_argument if the payload is longer than MAX_PAYLOAD_BYTES.
std::vector<uint8_t> encodeFrame(const Frame& frame);

/// Counts since the decoder was made.
struct DecoderCounters
{
  uint64_t bytes = 0;
  uint64_t frames = 0;         ///< good ones
  uint64_t garbage_bytes = 0;  ///< that belong to no good frame
  uint64_t wrong_crc = 0;      ///< what looked like a frame, but its CRC is wrong
  uint64_t wrong_length = 0;   ///< what looked like a frame, but longer than MAX_PAYLOAD_BYTES
  uint64_t wrong_version = 0;  ///< frames with a good CRC, but another version of the protocol
  uint8_t other_version = 0;   ///< the last such version
};

/// Finds frames in a stream of any bytes. After damage it searches the next sync from the byte after the false one, so
/// a good frame behind garbage is not lost. Keeps less than MAX_FRAME_BYTES. Not thread safe.
class FrameDecoder
{
public:
  /// Appends the good frames among these bytes, and those that came before, to frames. Never throws but bad_alloc.
  void add(const uint8_t* bytes, size_t count, std::vector<Frame>* frames);
  /// Forgets the frame that has begun, as after a reconnect; counters stay.
  void reset();
  const DecoderCounters& counters() const { return counters_; }

private:
  std::vector<uint8_t> pending_;  ///< begins with what may be a sync
  DecoderCounters counters_;
};

/// A command of the host. Values are clamped to the range of the wire; NaN is refused.
struct Command
{
  double speed = 0.0;           ///< [m/s], in steps of 0.001, in +-32.767
  double curvature = 0.0;       ///< [1/m], in steps of 0.0001, in +-3.2767
  double deceleration = 0.0;    ///< [m/s^2], in steps of 0.001, in [0, 65.535]; 0: the chassis's usual one
  bool enable = false;          ///< may move; without it the chassis stops and stands
  bool emergency_stop = false;  ///< stops at once and latches
  bool release = false;         ///< ends the latch, and clears faults that are gone; only with speed 0
};

enum class Mode : uint8_t
{
  READY = 0,
  DRIVING = 1,
  STOPPED_WATCHDOG = 2,
  EMERGENCY_STOP = 3,
  FAULT = 4,
};

/// Bits of Status::faults. BATTERY_LOW and LIMITED warn only, the others stop the vehicle.
enum Fault : uint16_t
{
  BATTERY_LOW = 1 << 0,
  BATTERY_EMPTY = 1 << 1,
  DRIVE_STUCK = 1 << 2,       ///< wheels do not turn as they should; until released
  STEERING_STUCK = 1 << 3,    ///< steering does not follow; until released
  EMERGENCY_BUTTON = 1 << 4,  ///< pressed on the vehicle
  OVERHEATED = 1 << 5,
  INTERNAL = 1 << 6,
  LIMITED = 1 << 7,  ///< the last command was beyond the chassis's limits and was cut to them
};
constexpr uint16_t WARNING_FAULTS = BATTERY_LOW | LIMITED;

/// "battery low, drive stuck", with the numbers of bits that have no name; empty: none.
std::string faultText(uint16_t faults);
const char* modeText(Mode mode);

struct Status
{
  uint16_t echoed_sequence = 0;  ///< of the last command that was accepted
  bool command_seen = false;     ///< one was accepted since the chassis started
  Mode mode = Mode::READY;
  uint16_t faults = 0;                    ///< bits of Fault
  double speed = 0.0;                     ///< measured [m/s], steps of 0.001
  double curvature = 0.0;                 ///< measured [1/m], steps of 0.0001
  double steering = 0.0;                  ///< angle of the front wheels [rad], steps of 0.0001; 0 for differential
  uint32_t travel = 0;                    ///< [0.1 mm] along the path, backwards subtracts; wraps around
  std::optional<double> battery_voltage;  ///< [V], steps of 0.001, below 65.535
  std::optional<double> battery_current;  ///< [A], steps of 0.01, negative while it gives
  std::optional<double> battery_charge;   ///< 0 to 1, steps of 0.0001
  uint32_t uptime_ms = 0;                 ///< since the chassis started; wraps around
};

enum class Kind : uint8_t
{
  CAR_LIKE = 0,
  DIFFERENTIAL = 1,
};

/// Limits of a vehicle's motion; all positive.
struct Limits
{
  double speed = 3.0;                 ///< forwards [m/s]
  double reverse_speed = 1.0;         ///< backwards [m/s]; 0: never
  double curvature = 0.45;            ///< [1/m]
  double acceleration = 1.0;          ///< [m/s^2]
  double deceleration = 2.5;          ///< the hardest, as in an emergency [m/s^2]
  double usual_deceleration = 1.0;    ///< where a command says 0 [m/s^2]
  double lateral_acceleration = 2.0;  ///< speed is cut to it in bends [m/s^2]

  /// @param group  in front of the field's name. @throws std::invalid_argument naming field, value and bound.
  void validate(const std::string& group = "") const;
};

/// Those of the vehicle's description.
Limits limitsOf(const pi_node::MotionLimits& vehicle);

/// The smaller of each.
Limits intersection(const Limits& a, const Limits& b);

/// @return the command within the limits, with a deceleration above 0. @param[out] cut  whether a value was beyond by
/// more than a step of the wire; may be null.
Command withinLimits(const Command& command, const Limits& limits, bool* cut);

/// @return the next speed from `speed` towards `target`: limited by acceleration or deceleration, through 0 where the
/// direction changes, never beyond the target. @param dt  [s], at least 0.
double rampSpeed(double speed, double target, double acceleration, double deceleration, double dt);

struct Hello
{
  uint8_t protocol_version = PROTOCOL_VERSION;
  Kind kind = Kind::CAR_LIKE;
  double wheelbase = 0.75;        ///< [m]; of a differential one: between its wheels
  Limits limits;                  ///< steps of 0.001, curvature of 0.0001
  double watchdog_s = 0.25;       ///< it stops when no valid command came for so long, steps of 0.001
  double status_period_s = 0.02;  ///< steps of 0.001
  std::string name;               ///< at most 16 printable ASCII characters
};

/// @throws std::invalid_argument for numbers that are not finite.
std::vector<uint8_t> encodeCommand(const Command& command, uint16_t sequence);
std::vector<uint8_t> encodeHelloRequest(uint16_t sequence);
std::vector<uint8_t> encodeStatus(const Status& status, uint16_t sequence);
/// Longer names are cut.
std::vector<uint8_t> encodeHello(const Hello& hello, uint16_t sequence);

/// @return nullopt for a frame of another type, a wrong length or invalid values.
std::optional<Command> decodeCommand(const Frame& frame);
std::optional<Status> decodeStatus(const Frame& frame);
std::optional<Hello> decodeHello(const Frame& frame);

}  // namespace pi_vehicle::chassis
