#pragma once

#include <pi_vehicle/chassis/chassis_protocol.h>

#include <cstdint>
#include <optional>
#include <vector>

namespace pi_simulation
{

namespace chassis = pi_vehicle::chassis;

/// Measurements of the chassis.
struct Measurement
{
  double speed = 0.0;      ///< [m/s]
  double curvature = 0.0;  ///< [1/m]
  double steering = 0.0;   ///< [rad]
  double travel = 0.0;     ///< along the path, backwards subtracts [m]
  double yaw_rate = 0.0;   ///< [rad/s]
  double turn = 0.0;       ///< by the wheels since the start, left positive [rad]
  std::optional<double> battery_voltage;
  std::optional<double> battery_current;
  std::optional<double> battery_charge;
  uint16_t faults = 0;  ///< those of the hardware that are there at the moment: battery, button, heat, steering
};

/// Targets of the motors.
struct Setpoint
{
  double speed = 0.0;      ///< [m/s]
  double curvature = 0.0;  ///< [1/m]
  std::optional<double>
      yaw_rate;  ///< of a differential vehicle, in place of the curvature: it may turn on the spot [rad/s]
};

struct ControllerCounters
{
  uint64_t commands = 0;      ///< accepted
  uint64_t refused = 0;       ///< frames that mean nothing here: type, length or values
  uint64_t old_commands = 0;  ///< not newer than the last one, refused
  uint64_t watchdog_stops = 0;
};

/// The chassis's end of the protocol, a reference for its firmware: watchdog, limits, ramps, latched emergency stop.
/// Monotonic time; one thread per instance.
class ChassisController
{
public:
  /// @param hello  describes this chassis; its limits hold.
  /// @throws std::invalid_argument for limits that are impossible.
  ChassisController(const chassis::Hello& hello, int64_t now_ns);

  /// Any bytes from the host.
  void onBytes(const uint8_t* bytes, size_t count, int64_t now_ns);
  /// Ramps towards the last command, and writes a status when due. Call at 50 Hz or faster.
  Setpoint update(const Measurement& measured, int64_t now_ns);
  /// Bytes for the host since the last call.
  std::vector<uint8_t> takeOutput();

  chassis::Mode mode() const { return mode_; }
  const chassis::Hello& hello() const { return hello_; }
  const chassis::DecoderCounters& decoder() const { return decoder_.counters(); }
  const ControllerCounters& counters() const { return counters_; }

private:
  void onCommand(const chassis::Command& command, uint16_t sequence, int64_t now_ns);
  void watchDrive(const Measurement& measured, int64_t now_ns);
  void sendStatus(const Measurement& measured, int64_t now_ns);
  uint16_t faults(const Measurement& measured) const;

  const chassis::Hello hello_;
  const int64_t start_ns_;
  chassis::FrameDecoder decoder_;
  std::vector<uint8_t> output_;
  ControllerCounters counters_;
  uint16_t sequence_ = 0;

  chassis::Command command_;  ///< within the limits
  bool command_cut_ = false;
  bool command_seen_ = false;
  bool watching_ = false;  ///< a command came, and the watchdog has not run out since
  bool ran_out_ = false;   ///< and it ran out
  uint16_t command_sequence_ = 0;
  int64_t command_ns_ = 0;

  chassis::Mode mode_ = chassis::Mode::READY;
  bool emergency_ = false;       ///< latched
  uint16_t latched_faults_ = 0;  ///< until released
  Setpoint setpoint_;
  int64_t update_ns_;
  int64_t follows_ns_;  ///< when the wheels last did as they should
  int64_t status_ns_;   ///< when the next one is due
};

}  // namespace pi_simulation
