#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace pi_vehicle
{

/// A problem with a serial port: device, reason, remedy.
class SerialError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// A serial line, raw, 8N1, without flow control, locked for this process. Never blocks. Not thread safe.
class SerialPort
{
public:
  /// The path of a port. A path is returned unchanged; "ttyUSB0" is in /dev; other names, such as "usb-FTDI", are a
  /// part of a name in by_id, which does not depend on the socket.
  /// @throws SerialError listing the ports, if none or several match.
  static std::string findPath(const std::string& name, const std::string& by_id = "/dev/serial/by-id");

  /// @param baud_rate  one that termios knows: 9600 to 4000000.
  /// @param device     what is at its end, for messages: "the chassis".
  /// @throws SerialError if it is not there, not a serial port, not permitted, used by another, or refuses the rate;
  ///         std::invalid_argument for a rate that does not exist.
  SerialPort(const std::string& path, uint32_t baud_rate, const std::string& device);
  ~SerialPort();
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  /// @return number of bytes read; 0: none at the moment. @throws SerialError if the line is gone.
  size_t read(uint8_t* bytes, size_t size);
  /// @return number of bytes written, less than size if the line is slower. @throws SerialError if the line is gone.
  size_t write(const uint8_t* bytes, size_t size);
  /// For poll(). It hangs up (POLLHUP, POLLERR, POLLNVAL) when the line is gone; then call this: @throws SerialError.
  [[noreturn]] void throwGone() const;
  int descriptor() const { return descriptor_; }
  const std::string& path() const { return path_; }

  /// @throws std::invalid_argument as the constructor does.
  static void checkBaudRate(uint32_t baud_rate);

private:
  void configure(uint32_t baud_rate);

  const std::string path_;
  const std::string device_;
  int descriptor_ = -1;
};

}  // namespace pi_vehicle
