#pragma once

#include <pi_vehicle/chassis/chassis_protocol.h>
#include <pi_vehicle/decision/pose2.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle::chassis
{

struct HostOptions
{
  double command_period_s = 0.02;  ///< between commands to the chassis [s], in [0.002, 0.05]: 20 Hz or faster
  double status_timeout_s = 0.2;   ///< without a status, after which the chassis counts as gone [s], in [0.02, 10]
  double motion_timeout_s = 0.3;   ///< a motion holds so long [s], in [0.02, 10]
  double stop_deceleration = 1.5;  ///< where motions cease [m/s^2], in [0.01, limits.deceleration]
  Limits limits;                   ///< of the host; those of the chassis hold as well

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// State of the vehicle as the host knows it.
enum class HostMode : uint8_t
{
  READY = 0,
  DRIVING = 1,
  STOPPED_WATCHDOG = 2,
  EMERGENCY_STOP = 3,
  FAULT = 4,
  DISCONNECTED = 5,
};

struct Motion
{
  double speed = 0.0;         ///< [m/s]
  double curvature = 0.0;     ///< [1/m]
  double deceleration = 0.0;  ///< [m/s^2]; 0: usual
};

/// Odometry of the wheels, from the pose at the start of the host.
struct WheelOdometry
{
  Pose2 pose;             ///< of the middle of the rear axle, or of the only axle
  double speed = 0.0;     ///< [m/s]
  double yaw_rate = 0.0;  ///< [rad/s]
  double distance = 0.0;  ///< driven, forwards and backwards [m]
  int64_t stamp_ns = 0;   ///< monotonic: when the status came
  uint64_t count = 0;     ///< of statuses; another number is another odometry
};

struct HostCounters
{
  uint64_t commands = 0;  ///< frames of commands written
  uint64_t statuses = 0;
  uint64_t refused_frames = 0;   ///< good frames that mean nothing here
  uint64_t lost_frames = 0;      ///< gaps in the chassis's sequence
  uint64_t refused_motions = 0;  ///< not finite
  uint64_t limited_motions = 0;  ///< beyond the limits, cut
  uint64_t restarts = 0;         ///< of the chassis, while connected
  uint64_t status_timeouts = 0;  ///< times that statuses ceased on an open line
};

/// Whether a motion's numbers are finite; counts those that are not, and those beyond the limits.
/// @param[out] cut  whether it is beyond the limits.
bool isUsable(const Motion& motion, const Limits& limits, HostCounters* counters, bool* cut);

struct HostState
{
  HostMode mode = HostMode::DISCONNECTED;
  std::string detail;  ///< in words, with the way out
  bool moving = false;
  Status status;  ///< the last one
  WheelOdometry odometry;
  std::optional<Hello> hello;  ///< of the chassis that is connected, or was last
  double round_trip_s = 0.0;   ///< from a command to the status that echoes it; 0: none yet
  DecoderCounters decoder;
  HostCounters counters;
};

/// The host's end of the protocol, without line, thread or clock: the caller passes bytes and monotonic time. Until a
/// HELLO of this version came, only a stop is commanded. Not thread safe.
class ChassisHost
{
public:
  /// @throws std::invalid_argument for wrong options.
  explicit ChassisHost(const HostOptions& options);

  /// The line is open; begins with a request for a HELLO.
  void onLineOpen(int64_t now_ns);
  /// The line is not open. @param problem  what is wrong and the way out.
  void onLineClosed(const std::string& problem);
  void onBytes(const uint8_t* bytes, size_t count, int64_t now_ns);

  /// @return false if a number is not finite; the last motion then holds until it times out.
  bool setMotion(const Motion& motion, int64_t now_ns);
  /// Latched until release(). @param reason  for people.
  void emergencyStop(const std::string& reason);
  /// Ends the latch of host and chassis, and clears faults of the chassis that are over. The vehicle stands until a
  /// motion that is newer than this call.
  void release(int64_t now_ns);

  /// Forgets the motion: speed 0 is commanded until the next one. Latches stay.
  void stop();

  /// @return the bytes to write; call once per command_period_s.
  std::vector<uint8_t> poll(int64_t now_ns);
  HostState state(int64_t now_ns) const;

private:
  bool heard(int64_t now_ns) const;
  bool motionHolds(int64_t now_ns) const;
  void onStatus(const Status& status, int64_t now_ns);
  void onHello(const Hello& hello);
  Command nextCommand(int64_t now_ns);
  HostMode mode(int64_t now_ns, std::string* detail) const;

  const HostOptions options_;
  Limits limits_;  ///< of both
  FrameDecoder decoder_;
  HostCounters counters_;

  bool line_open_ = false;
  std::string problem_ = "not opened yet";
  std::optional<Hello> hello_;
  bool hello_valid_ = false;  ///< since the line was opened, and no restart of the chassis since
  std::string hello_problem_;
  int64_t hello_asked_ns_ = 0;
  bool hello_asked_ = false;

  Status status_;
  bool status_seen_ = false;  ///< since the line was opened
  int64_t status_ns_ = 0;
  bool timeout_counted_ = false;
  std::optional<uint16_t> frame_sequence_;
  WheelOdometry odometry_;
  double round_trip_s_ = 0.0;
  uint16_t timed_sequence_ = 0;  ///< command whose way is measured
  int64_t timed_ns_ = 0;
  bool timing_ = false;

  std::optional<Motion> motion_;
  int64_t motion_ns_ = 0;
  bool motion_cut_ = false;
  bool emergency_ = false;
  std::string emergency_reason_;
  std::optional<int64_t> release_ns_;         ///< asked, not confirmed yet
  std::optional<uint16_t> release_sequence_;  ///< of the first command that asked
  double commanded_speed_ = 0.0;              ///< ramped
  int64_t command_ns_ = 0;
  uint16_t sequence_ = 0;
};

}  // namespace pi_vehicle::chassis
