#pragma once

#include <pi_node/unique_fd.h>

#include <string>

namespace pi_speech
{

/// A folder for temporary files that exists as long as the object. A process that was killed leaves its folder behind;
/// the next process that makes a folder in the same place removes it. A lock tells which folders are in use.
class HeldFolder
{
public:
  /// In the first of TMPDIR or /tmp, /dev/shm and /run/user/UID with room.
  /// @throws std::runtime_error if there is none.
  HeldFolder();
  ~HeldFolder();
  HeldFolder(const HeldFolder&) = delete;
  HeldFolder& operator=(const HeldFolder&) = delete;

  const std::string& path() const { return path_; }

private:
  bool make(const std::string& place);

  std::string path_;
  pi_node::UniqueFd lock_;
};

}  // namespace pi_speech
