#include "rosout/rotating_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace pi_os_transport
{
namespace
{

FileDescriptor openEmpty(const std::string& path)
{
  return FileDescriptor(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0666));
}

}  // namespace

RotatingFile::RotatingFile(std::string path, Log log, const Limits& limits)
  : path_(std::move(path)), log_(std::move(log)), limits_(limits), file_(openEmpty(path_))
{
  if (!file_)
  {
    throw std::runtime_error("cannot write the log file " + path_ + ": " + std::strerror(errno) +
                             "; set ROS_LOG_DIR to a folder that can be written to, or "
                             "ROSOUT_DISABLE_FILE_LOGGING=1");
  }
}

void RotatingFile::report(const std::string& what)
{
  if (!is_broken_)
  {
    is_broken_ = true;
    log_(what + " " + path_ + ": " + std::strerror(errno));
  }
}

void RotatingFile::write(std::string_view text)
{
  if (size_ > limits_.bytes)
  {
    rotate();
  }
  while (!text.empty())
  {
    const ssize_t size = ::write(file_.get(), text.data(), text.size());
    if (size < 0 && errno == EINTR)
    {
      continue;
    }
    if (size < 0)
    {
      report("messages are not written to the log file");
      ++lost_;
      return;
    }
    size_ += static_cast<uint64_t>(size);
    text.remove_prefix(static_cast<size_t>(size));
  }
  is_broken_ = false;
}

void RotatingFile::rotate()
{
  for (int index = limits_.backups; index > 0; --index)
  {
    const std::string from = index > 1 ? path_ + "." + std::to_string(index - 1) : path_;
    if (std::rename(from.c_str(), (path_ + "." + std::to_string(index)).c_str()) != 0 && errno != ENOENT)
    {
      report("the log file cannot be put aside:");
    }
  }
  FileDescriptor fresh = openEmpty(path_);
  if (fresh)
  {
    file_ = std::move(fresh);
  }
  else
  {
    report("no new log file");
  }
  size_ = 0;  // a file that could not be renamed is continued; the next attempt comes after as many bytes
}

}  // namespace pi_os_transport
