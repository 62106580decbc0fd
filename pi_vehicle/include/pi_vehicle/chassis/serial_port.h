#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace pi_vehicle::chassis
{

/// What is wrong with a serial port: device, reason, way out.
class SerialError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// A serial line, raw, 8N1, without flow control, locked for this process. Never blocks. Not thread safe.
class SerialPort
{
public:
  /// The path of a port: a path stays as it is; "ttyUSB0" is in /dev; else the one name in by_id that has the text in
  /// it, as "usb-FTDI", which stays the same whatever socket it is plugged into.
  /// @throws SerialError if there is none or several, with those that there are.
  static std::string findPath(const std::string& name, const std::string& by_id = "/dev/serial/by-id");

  /// @param baud_rate  one that termios knows: 9600 to 4000000.
  /// @throws SerialError if it is not there, not a serial port, not permitted, used by another, or refuses the rate;
  ///         std::invalid_argument for a rate that does not exist.
  SerialPort(const std::string& path, uint32_t baud_rate);
  ~SerialPort();
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  /// @return bytes that were there, at most size; 0: none at the moment. @throws SerialError if the line is gone.
  size_t read(uint8_t* bytes, size_t size);
  /// @return bytes that were taken; less than size where the line is slower. @throws SerialError if the line is gone.
  size_t write(const uint8_t* bytes, size_t size);
  /// For poll().
  int descriptor() const { return descriptor_; }
  const std::string& path() const { return path_; }

  /// @throws std::invalid_argument as the constructor does.
  static void checkBaudRate(uint32_t baud_rate);

private:
  void configure(uint32_t baud_rate);

  const std::string path_;
  int descriptor_ = -1;
};

}  // namespace pi_vehicle::chassis
