#include "chassis/pseudo_terminal.h"

#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <system_error>

namespace pi_simulation
{

PseudoTerminal::PseudoTerminal(const std::string& link) : link_(link)
{
  namespace fs = std::filesystem;
  descriptor_ = ::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  std::array<char, 128> name = {};
  termios settings = {};
  if (descriptor_ < 0 || ::grantpt(descriptor_) != 0 || ::unlockpt(descriptor_) != 0 ||
      ::ptsname_r(descriptor_, name.data(), name.size()) != 0 || ::tcgetattr(descriptor_, &settings) != 0)
  {
    const int error = errno;
    ::close(descriptor_);
    throw std::system_error(error, std::generic_category(), "no pseudo-terminal; is /dev/pts mounted?");
  }
  ::cfmakeraw(&settings);  // no echo before the other end has set it up
  ::tcsetattr(descriptor_, TCSANOW, &settings);
  path_ = name.data();
  if (!link_.empty())
  {
    std::error_code error;
    const fs::path beside = link_ + "." + std::to_string(::getpid());
    if (fs::exists(fs::symlink_status(link_, error)) && !fs::is_symlink(fs::symlink_status(link_, error)))
    {
      error = std::make_error_code(std::errc::file_exists);
    }
    else
    {
      fs::remove(beside, error);
      fs::create_symlink(path_, beside, error);
      if (!error)
      {
        fs::rename(beside, link_, error);
      }
    }
    if (error)
    {
      ::close(descriptor_);
      throw std::runtime_error("link " + link_ + " cannot be made: " + error.message() + "; give another path");
    }
  }
}

PseudoTerminal::~PseudoTerminal()
{
  if (!link_.empty())
  {
    std::error_code error;
    if (std::filesystem::read_symlink(link_, error) == path_)
    {
      std::filesystem::remove(link_, error);
    }
  }
  ::close(descriptor_);
}

size_t PseudoTerminal::read(uint8_t* bytes, size_t size)
{
  const ssize_t count = ::read(descriptor_, bytes, size);
  return count > 0 ? static_cast<size_t>(count) : 0;  // EIO: nobody has opened the other end
}

size_t PseudoTerminal::write(const uint8_t* bytes, size_t size)
{
  const ssize_t count = ::write(descriptor_, bytes, size);
  return count > 0 ? static_cast<size_t>(count) : 0;
}

}  // namespace pi_simulation
