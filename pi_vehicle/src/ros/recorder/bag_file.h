#pragma once

#include "recorder/message_memory.h"

#include <ros/datatypes.h>
#include <rosbag/bag.h>
#include <boost/shared_ptr.hpp>

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle::recorder
{

/// Messages of a bag; nullopt: the file is none, or has no index.
std::optional<uint64_t> messagesIn(const std::filesystem::path& file);

/// A bag that is being written. rosbag buffers, and a chunk without its end is lost after a kill: so flush() ends the
/// chunk. Not thread safe.
class BagFile
{
public:
  /// @throws std::runtime_error naming file and reason.
  explicit BagFile(const std::filesystem::path& active);
  /// Leaves the file as it is if it was not finished, for its recovery, or deletes it if nothing was flushed.
  ~BagFile();
  BagFile(const BagFile&) = delete;
  BagFile& operator=(const BagFile&) = delete;

  /// Writes messages and hands them to the system, so that they outlive this process. @throws std::runtime_error if
  /// that fails; the object is then of no more use.
  void write(const std::vector<KeptMessagePtr>& messages);
  /// Writes the index, and renames the file once it is on the disk. @throws std::runtime_error if that fails.
  void finish(const std::filesystem::path& finished);

  uint64_t bytes() const { return bag_->getSize(); }

private:
  void abandon();
  void writeOne(const KeptMessage& message);
  template <typename Action>
  void attempt(const Action& action);

  const std::filesystem::path path_;
  std::unique_ptr<rosbag::Bag> bag_ = std::make_unique<rosbag::Bag>();
  std::map<std::shared_ptr<const Channel>, boost::shared_ptr<ros::M_string>> headers_;
  bool holds_messages_ = false;
  bool closed_ = false;
};

}  // namespace pi_vehicle::recorder
