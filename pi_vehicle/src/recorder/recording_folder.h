#pragma once

#include <pi_node/unique_fd.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle::recorder
{

/// The folder of the recordings: `incident_TIME_CAUSE.bag` and `slim_TIME.bag`, TIME in UTC. A file that is being
/// written ends in `.bag.active`. One recorder at a time holds the folder. Not thread safe, except for the names.
class RecordingFolder
{
public:
  static constexpr char INCIDENT[] = "incident_";
  static constexpr char SLIM[] = "slim_";

  /// @param path  "~" at the begin is the user's home.
  explicit RecordingFolder(const std::string& path);

  const std::filesystem::path& path() const { return path_; }

  /// Creates the folder and takes hold of it, unless that is done. @throws std::runtime_error naming the way out.
  void open();

  /// A name without ending that no file has, also none of an earlier life. @param kind  INCIDENT or SLIM.
  /// @param cause  empty: none.
  std::string unusedName(const char* kind, int64_t stamp_ns, const std::string& cause) const;
  /// The same, or the same with a number behind it.
  std::string unused(const std::string& name) const;
  std::filesystem::path finished(const std::string& name) const { return path_ / (name + ".bag"); }
  std::filesystem::path active(const std::string& name) const { return path_ / (name + ".bag.active"); }

  /// Space that is left to this user on the disk [bytes].
  uint64_t freeBytes() const;
  /// Files `*.bag.active`, which a recorder left that did not end well, or this one if writing failed.
  /// @param own  names of files that are being written.
  std::vector<std::filesystem::path> unfinished(const std::vector<std::string>& own) const;

  struct Usage
  {
    uint64_t bytes = 0;
    size_t files = 0;
  };
  Usage usage(const char* kind) const;
  /// Deletes the oldest finished files of a kind until all files of the kind take no more than the budget. What is
  /// being written stays. @return the files that were deleted.
  std::vector<std::filesystem::path> keepWithin(const char* kind, uint64_t budget_bytes) const;

private:
  const std::filesystem::path path_;
  pi_node::UniqueFd lock_;
};

/// Completes a file that a killed recorder left, by `rosbag reindex`; what the kill cut off is left out. A file without
/// a message is deleted.
/// @return text for the log. @throws std::runtime_error if that fails, for example for want of room; the file stays.
/// @param count  messages of a bag; nullopt: it is none, or has no index.
std::string recoverFile(const std::filesystem::path& file,
                        const std::function<std::optional<uint64_t>(const std::filesystem::path&)>& count);

}  // namespace pi_vehicle::recorder
