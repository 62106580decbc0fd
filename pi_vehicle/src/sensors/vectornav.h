#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace pi_vehicle
{

/// What an IMU measures, in its own axes.
struct ImuMeasurement
{
  std::array<double, 3> angular_velocity = {};  ///< [rad/s]
  std::array<double, 3> acceleration = {};      ///< specific force: 9.81 upwards at rest [m/s^2]
};

/// A line of VectorNav's text protocol: "$VNIMU,-00.0350,...*66", the XOR of all between $ and * in hexadecimal digits.
struct VectorNavLine
{
  enum class Kind
  {
    MEASUREMENT,     ///< VNIMU: magnetic field, acceleration, angular velocity, temperature, pressure
    NOT_FINITE,      ///< a VNIMU with a measurement that is no finite number
    OTHER,           ///< any other with the right checksum: answers, errors, other measurements
    WRONG_CHECKSUM,  ///< or without one
    TORN,            ///< another one begins before its end, it is too long, or it is a VNIMU without its eleven fields
  };

  Kind kind = Kind::TORN;
  ImuMeasurement measurement;
  std::string text;  ///< between $ and *
  size_t bytes = 0;  ///< on the wire
};

/// @param line  from $ on, without the line's end.
VectorNavLine parseVectorNav(std::string_view line);

/// The bytes of a command. @param text  as "VNWRG,07,200".
std::string vectorNavCommand(const std::string& text);

/// Cuts what comes on a serial line into lines. Not thread safe.
class VectorNavReader
{
public:
  void onBytes(const uint8_t* bytes, size_t size, const std::function<void(const VectorNavLine&)>& on_line);
  /// Forgets a line that has begun.
  void restart() { line_.clear(); }
  /// Bytes outside of lines, and those of torn lines.
  uint64_t garbageBytes() const { return garbage_bytes_; }

private:
  void tear(const std::function<void(const VectorNavLine&)>& on_line);

  std::string line_;  ///< empty: none has begun
  uint64_t garbage_bytes_ = 0;
};

}  // namespace pi_vehicle
