#include <pi_vehicle/serial/serial_port.h>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <vector>

namespace pi_vehicle
{
namespace
{

const std::map<uint32_t, speed_t>& rates()
{
  static const std::map<uint32_t, speed_t> RATES = {
      {9600, B9600},       {19200, B19200},     {38400, B38400},     {57600, B57600},     {115200, B115200},
      {230400, B230400},   {460800, B460800},   {500000, B500000},   {576000, B576000},   {921600, B921600},
      {1000000, B1000000}, {1152000, B1152000}, {1500000, B1500000}, {2000000, B2000000}, {2500000, B2500000},
      {3000000, B3000000}, {3500000, B3500000}, {4000000, B4000000}};
  return RATES;
}

std::string reason(const std::string& path, const std::string& device, int error)
{
  switch (error)
  {
    case ENOENT:
    case ENXIO:
    case ENODEV:
      return "serial port " + path + " is not there; is " + device + " plugged in and switched on?";
    case EACCES:
    case EPERM:
      return "serial port " + path +
             " may not be opened by this user; add the user to the group dialout and log in again";
    case EBUSY:
    case EWOULDBLOCK:
      return "serial port " + path + " is used by another program; end that one";
    default:
      return "serial port " + path + ": " + std::strerror(error);
  }
}

}  // namespace

void SerialPort::checkBaudRate(uint32_t baud_rate)
{
  if (rates().count(baud_rate) == 0)
  {
    std::string list;
    for (const auto& [rate, code] : rates())
    {
      list += (list.empty() ? "" : ", ") + std::to_string(rate);
    }
    throw std::invalid_argument("baud_rate = " + std::to_string(baud_rate) + ", must be one of " + list);
  }
}

std::string SerialPort::findPath(const std::string& name, const std::string& by_id)
{
  namespace fs = std::filesystem;
  if (name.empty() || name.front() == '/')
  {
    return name;
  }
  std::error_code error;
  if (name.find('/') == std::string::npos && fs::exists("/dev/" + name, error))
  {
    return "/dev/" + name;
  }
  std::vector<std::string> found;
  std::string list;
  for (fs::directory_iterator entry(by_id, error), end; !error && entry != end; entry.increment(error))
  {
    const std::string file = entry->path().filename().string();
    list += (list.empty() ? "" : ", ") + file;
    if (file.find(name) != std::string::npos)
    {
      found.push_back(entry->path().string());
    }
  }
  if (found.size() == 1)
  {
    return found.front();
  }
  throw SerialError((found.empty() ? "no serial port has the name " : "several serial ports have in their names ") +
                    name + "; there are: " + (list.empty() ? "none" : list) + "; give more of the name, or a path");
}

SerialPort::SerialPort(const std::string& path, uint32_t baud_rate, const std::string& device)
  : path_(path), device_(device)
{
  checkBaudRate(baud_rate);
  // Without O_NONBLOCK the open would wait for the carrier of a modem.
  descriptor_ = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (descriptor_ < 0)
  {
    throw SerialError(reason(path_, device_, errno));
  }
  try
  {
    configure(baud_rate);
  }
  catch (...)
  {
    ::close(descriptor_);
    throw;
  }
}

void SerialPort::configure(uint32_t baud_rate)
{
  if (::isatty(descriptor_) == 0)
  {
    throw SerialError(path_ + " is not a serial port");
  }
  // The lock is seen by all that lock; TIOCEXCL keeps others but root from opening it.
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0 || ::ioctl(descriptor_, TIOCEXCL) != 0)
  {
    throw SerialError(reason(path_, device_, errno));
  }
  termios settings = {};
  if (::tcgetattr(descriptor_, &settings) != 0)
  {
    throw SerialError(reason(path_, device_, errno));
  }
  ::cfmakeraw(&settings);
  settings.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS);
  settings.c_cflag |= static_cast<tcflag_t>(CLOCAL | CREAD);
  settings.c_cc[VMIN] = 0;
  settings.c_cc[VTIME] = 0;
  const speed_t rate = rates().at(baud_rate);
  if (::cfsetispeed(&settings, rate) != 0 || ::cfsetospeed(&settings, rate) != 0 ||
      ::tcsetattr(descriptor_, TCSANOW, &settings) != 0)
  {
    throw SerialError(reason(path_, device_, errno));
  }
  termios taken = {};  // tcsetattr succeeds where any of the settings was taken
  if (::tcgetattr(descriptor_, &taken) != 0 || ::cfgetospeed(&taken) != rate)
  {
    throw SerialError("serial port " + path_ + " refuses " + std::to_string(baud_rate) +
                      " baud; take another baud_rate");
  }
  ::tcflush(descriptor_, TCIOFLUSH);
}

SerialPort::~SerialPort()
{
  ::ioctl(descriptor_, TIOCNXCL);
  ::close(descriptor_);
}

void SerialPort::throwGone() const
{
  throw SerialError("serial port " + path_ + " is gone; is " + device_ + " unplugged?");
}

size_t SerialPort::read(uint8_t* bytes, size_t size)
{
  const ssize_t count = ::read(descriptor_, bytes, size);
  if (count > 0)
  {
    return static_cast<size_t>(count);
  }
  if (count < 0 && errno != EAGAIN && errno != EINTR)
  {
    throwGone();
  }
  return 0;  // with VMIN 0 this may also be a line without bytes; poll() tells whether it hung up
}

size_t SerialPort::write(const uint8_t* bytes, size_t size)
{
  const ssize_t count = ::write(descriptor_, bytes, size);
  if (count < 0 && errno != EAGAIN && errno != EINTR)
  {
    throwGone();
  }
  return count > 0 ? static_cast<size_t>(count) : 0;
}

}  // namespace pi_vehicle
