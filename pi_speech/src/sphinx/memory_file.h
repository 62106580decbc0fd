#pragma once

#include <string>

namespace pi_speech
{

/// A file that is in memory only and goes with the object: for a library that wants a path.
class MemoryFile
{
public:
  /// @throws std::runtime_error if the system has no room for it.
  explicit MemoryFile(const std::string& content);
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  int descriptor() const { return descriptor_; }
  /// Good in this process only.
  std::string path() const;

private:
  int descriptor_;
};

}  // namespace pi_speech
