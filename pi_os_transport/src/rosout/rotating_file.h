#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// A log file that is renamed when it is full: file, file.1 (the previous one), ... Not thread safe.
class RotatingFile
{
public:
  struct Limits
  {
    uint64_t bytes = 100 * 1024 * 1024;  ///< of one file
    int backups = 10;
  };
  using Log = std::function<void(const std::string& line)>;

  /// Starts an empty file. @param log  gets one line per series of failures.
  /// @throws std::runtime_error naming the file and the remedy
  RotatingFile(std::string path, Log log, const Limits& limits);

  /// Counts text that cannot be written as lost.
  void write(std::string_view text);
  uint64_t lost() const { return lost_; }
  const std::string& path() const { return path_; }

private:
  void rotate();
  void report(const std::string& what);

  std::string path_;
  Log log_;
  Limits limits_;
  FileDescriptor file_;
  uint64_t size_ = 0;
  uint64_t lost_ = 0;
  bool is_broken_ = false;
};

}  // namespace pi_os_transport
