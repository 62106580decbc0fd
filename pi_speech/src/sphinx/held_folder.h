#pragma once

#include <string>

namespace pi_speech
{

/// A folder for temporary files that exists as long as the object. What a process left that was killed is removed by
/// the next one that makes a folder in the same place; which are dead is known by a lock that ends with its process.
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
  int lock_ = -1;
};

}  // namespace pi_speech
