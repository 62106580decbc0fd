#pragma once

#include <pi_bringup/ros/euroc_messages.h>
#include <pi_bringup/timeline.h>

#include <cstddef>
#include <functional>
#include <map>
#include <string>

namespace pi_bringup
{

struct BagWriterOptions
{
  std::string topic_prefix = "/";    ///< namespace of the topics in the bag, begins and ends with /
  std::string compression = "none";  ///< none, lz4 or bz2
  bool overwrite = false;            ///< replace an existing file
  TimelineOptions timeline;
  EurocFrames frames;

  /// @throws std::invalid_argument naming option, value and bound.
  void validate() const;
};

struct BagWriterResult
{
  bool complete = false;                  ///< false: `go_on` asked to stop; nothing is left on disk then
  std::map<std::string, size_t> written;  ///< messages by topic
  size_t skipped_pictures = 0;
  std::string first_skip_reason;
};

/// Writes a recording to a bag with the topics and messages of euroc_player, at recorded stamps. The bag grows under
/// `<bag>.part` and gets its name when it is complete; on failure or stop the partial file is removed.
/// @param go_on called with the messages done and their total, in the calling thread; false stops.
/// @throws std::invalid_argument if the bag exists and may not be replaced, std::runtime_error if it cannot be
/// written (with the reason).
BagWriterResult writeBag(const EurocDataset& dataset, const std::string& bag, const BagWriterOptions& options,
                         const std::function<bool(size_t, size_t)>& go_on);

}  // namespace pi_bringup
