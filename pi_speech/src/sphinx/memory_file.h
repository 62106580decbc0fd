#pragma once

#include <pi_node/unique_fd.h>

#include <string>

namespace pi_speech
{

/// A file in memory, for a library that wants a path. The file ends with the object.
class MemoryFile
{
public:
  /// @throws std::runtime_error if the system has no room for it.
  explicit MemoryFile(const std::string& content);

  int descriptor() const { return descriptor_.get(); }
  /// Valid in this process only.
  std::string path() const;

private:
  pi_node::UniqueFd descriptor_;
};

}  // namespace pi_speech
