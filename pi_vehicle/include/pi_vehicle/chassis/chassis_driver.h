#pragma once

#include <pi_vehicle/chassis/chassis_host.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace pi_vehicle::chassis
{

struct DriverOptions
{
  std::string port = "/dev/ttyUSB0";  ///< path, name in /dev, or part of a name in /dev/serial/by-id
  uint32_t baud_rate = 115200;
  double start_patience_s = 10.0;  ///< after the start a port may be missing so long [s], in [0, 600]
  double first_pause_s = 0.1;      ///< before a port that is gone is opened again [s], in [0.01, 10]; doubles each time
  double longest_pause_s = 1.0;    ///< up to this [s], in [first_pause_s, 60]
  HostOptions host;

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

struct DriverState
{
  HostState host;
  std::string path;               ///< of the open port; empty: none is open
  uint64_t opened = 0;            ///< times that the port was opened
  uint64_t lost = 0;              ///< times that an open port was gone
  uint64_t open_errors = 0;       ///< tries that failed
  uint64_t dropped_commands = 0;  ///< that the line had no room for
};

/// Called on the driver's thread, one at a time. They must not throw, and should return within a command period.
struct DriverEvents
{
  std::function<void(const DriverState&)> state;           ///< once per command period, whether connected or not
  std::function<void(const std::string& path)> opened;     ///< the port is open; may be empty
  std::function<void(const std::string& problem)> closed;  ///< cannot be opened, or is gone: once until opened(), and
                                                           ///< at the start not before start_patience_s
};

/// Drives a chassis over a serial line, on a thread of its own, in the vehicle's time. A missing or lost port is opened
/// again after pauses that grow. All methods may be called from any thread; none waits for the line.
class ChassisDriver
{
public:
  /// Starts the thread. @throws std::invalid_argument for wrong options or without events.state.
  ChassisDriver(const DriverOptions& options, DriverEvents events);
  /// Commands a stop and ends within a few milliseconds; then the watchdog of the chassis acts.
  ~ChassisDriver();
  ChassisDriver(const ChassisDriver&) = delete;
  ChassisDriver& operator=(const ChassisDriver&) = delete;

  /// As ChassisHost::setMotion().
  bool setMotion(const Motion& motion);
  /// Goes out at once. As ChassisHost::emergencyStop().
  void emergencyStop(const std::string& reason);
  /// As ChassisHost::release().
  void release();
  DriverState state() const;

private:
  class Worker;
  std::unique_ptr<Worker> worker_;
};

}  // namespace pi_vehicle::chassis
