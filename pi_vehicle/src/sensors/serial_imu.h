#pragma once

#include "sensors/vectornav.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace pi_vehicle
{

struct SerialImuOptions
{
  std::string port = "/dev/ttyUSB0";  ///< path, name in /dev, or part of a name in /dev/serial/by-id
  uint32_t baud_rate = 230400;        ///< that of the device
  double rate = 200.0;                ///< at which the device measures [Hz], in [1, 1000]
  bool configure = true;              ///< tell the device to send VNIMU at `rate`
  double reconnect_pause_s = 0.5;     ///< before a port that is gone is tried again [s], in [0.05, 60]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

struct SerialImuState
{
  std::string path;     ///< of the open port; empty: none is open
  std::string problem;  ///< why no measurements come, and the way out; empty: they come
  bool configured = false;
  uint64_t opened = 0;           ///< times that the port was opened
  uint64_t measurements = 0;     ///< that were read
  uint64_t wrong_checksums = 0;  ///< lines
  uint64_t torn = 0;             ///< lines
  uint64_t not_finite = 0;       ///< lines
  uint64_t other = 0;            ///< lines that are no measurements
  uint64_t missed = 0;           ///< measurements of which nothing came
  uint64_t garbage_bytes = 0;
};

/// Called on the thread of the IMU, one at a time. They must not throw.
struct SerialImuEvents
{
  /// @param stamp_ns  by vehicleNs(), increasing.
  std::function<void(const ImuMeasurement&, int64_t stamp_ns)> measurement;
  std::function<void(const std::string& path)> well;        ///< measurements come, for the first time or again
  std::function<void(const std::string& problem)> problem;  ///< they do not: once until well()
};

/// Reads a VectorNav on a serial line, on a thread of its own. A line that is missing or goes is opened again.
///
/// The time of a measurement is that of SampleClock less the time that its text takes on the wire.
class SerialImu
{
public:
  /// Starts the thread. @throws std::invalid_argument for wrong options.
  SerialImu(const SerialImuOptions& options, SerialImuEvents events);
  /// Ends within 50 ms.
  ~SerialImu();
  SerialImu(const SerialImu&) = delete;
  SerialImu& operator=(const SerialImu&) = delete;

  /// Any thread.
  SerialImuState state() const;

private:
  class Worker;
  std::unique_ptr<Worker> worker_;
};

}  // namespace pi_vehicle
