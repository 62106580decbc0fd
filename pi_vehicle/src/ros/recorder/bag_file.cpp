#include "ros/recorder/bag_file.h"

#include <fcntl.h>
#include <pi_node/ros/time.h>
#include <pi_node/unique_fd.h>
#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <rosbag/view.h>
#include <unistd.h>
#include <boost/make_shared.hpp>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>

namespace fs = std::filesystem;

// A kept message as rosbag writes it: of the type that its channel names.
namespace ros
{
namespace message_traits
{

using pi_vehicle::recorder::KeptMessage;

template <>
struct IsMessage<KeptMessage> : TrueType
{
};
template <>
struct MD5Sum<KeptMessage>
{
  static const char* value(const KeptMessage& message) { return message.channel->field("md5sum").c_str(); }
};
template <>
struct DataType<KeptMessage>
{
  static const char* value(const KeptMessage& message) { return message.channel->field("type").c_str(); }
};
template <>
struct Definition<KeptMessage>
{
  static const char* value(const KeptMessage& message) { return message.channel->field("message_definition").c_str(); }
};

}  // namespace message_traits

namespace serialization
{

template <>
struct Serializer<pi_vehicle::recorder::KeptMessage>
{
  template <typename Stream>
  static void write(Stream& stream, const pi_vehicle::recorder::KeptMessage& message)
  {
    if (!message.bytes.empty())
    {
      std::memcpy(stream.advance(static_cast<uint32_t>(message.bytes.size())), message.bytes.data(),
                  message.bytes.size());
    }
  }
  static uint32_t serializedLength(const pi_vehicle::recorder::KeptMessage& message)
  {
    return static_cast<uint32_t>(message.bytes.size());
  }
};

}  // namespace serialization
}  // namespace ros

namespace pi_vehicle::recorder
{
namespace
{

constexpr uint32_t LARGEST_CHUNK = 768 * 1024;  // [bytes] rosbag's default

/// Lets a descriptor of this process that writes to a file write to /dev/null. rosbag tries again to write what a full
/// disk refused when it closes, throws in its destructor, and so ends the process.
void divert(const fs::path& file)
{
  std::error_code error;
  const std::string target = fs::weakly_canonical(file, error).string();
  const pi_node::UniqueFd nowhere(::open("/dev/null", O_RDWR | O_CLOEXEC));
  for (fs::directory_iterator entry("/proc/self/fd", error), end; !error && entry != end; entry.increment(error))
  {
    std::error_code gone;
    const std::string link = fs::read_symlink(entry->path(), gone).string();
    if (!gone && (link == target || link == target + " (deleted)"))
    {
      ::dup3(nowhere.get(), std::stoi(entry->path().filename().string()), O_CLOEXEC);
    }
  }
}

/// Waits until the content of a file or folder is on the disk.
void synchronize(const fs::path& path)
{
  const pi_node::UniqueFd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file || ::fsync(file.get()) != 0)
  {
    throw std::runtime_error(path.string() + ": " + std::strerror(errno));
  }
}

}  // namespace

std::optional<uint64_t> messagesIn(const fs::path& file)
{
  try
  {
    const rosbag::Bag bag(file.string());
    return rosbag::View(bag).size();
  }
  catch (const std::exception&)
  {
    return std::nullopt;
  }
}

BagFile::BagFile(const fs::path& active) : path_(active)
{
  try
  {
    attempt([this] { bag_->open(path_.string(), rosbag::bagmode::Write); });
  }
  catch (const std::exception&)
  {
    abandon();
    throw;
  }
}

BagFile::~BagFile()
{
  if (!closed_)
  {
    abandon();
  }
}

void BagFile::abandon()
{
  divert(path_);
  try
  {
    bag_->close();
  }
  catch (const std::exception&)
  {
    // What is written goes nowhere.
  }
  std::error_code ignored;
  if (!holds_messages_)
  {
    fs::remove(path_, ignored);
  }
}

template <typename Action>
void BagFile::attempt(const Action& action)
{
  errno = 0;
  try
  {
    action();
  }
  catch (const std::exception& error)
  {
    throw std::runtime_error(path_.string() + ": " + (errno != 0 ? std::strerror(errno) : error.what()));
  }
}

void BagFile::write(const std::vector<KeptMessagePtr>& messages)
{
  if (messages.empty())
  {
    return;
  }
  attempt(
      [&]
      {
        for (size_t i = 0; i + 1 < messages.size(); ++i)
        {
          writeOne(*messages[i]);
        }
        // Ends the chunk. The last message gets a chunk of its own: writing it hands all before it to the system, and
        // lets rosbag forget what it buffers.
        bag_->setChunkThreshold(0);
        writeOne(*messages.back());
        bag_->setChunkThreshold(LARGEST_CHUNK);
      });
  holds_messages_ = true;
}

void BagFile::writeOne(const KeptMessage& message)
{
  boost::shared_ptr<ros::M_string>& header = headers_[message.channel];
  if (!header)
  {
    header = boost::make_shared<ros::M_string>(message.channel->header);
  }
  const ros::Time stamp = pi_node::toTime(message.stamp_ns);
  bag_->write(message.channel->topic, std::max(stamp, ros::TIME_MIN), message, header);
}

void BagFile::finish(const fs::path& finished)
{
  attempt(
      [this]
      {
        try
        {
          bag_->close();
        }
        catch (const rosbag::BagIOException& error)
        {
          if (std::string(error.what()).rfind("Error closing", 0) == 0)
          {
            bag_.release();  // it holds a stream that is no more, and would close it again
            closed_ = true;
          }
          throw;
        }
      });
  closed_ = true;
  attempt(
      [&]
      {
        synchronize(path_);
        fs::rename(path_, finished);
        synchronize(finished.parent_path());
      });
}

}  // namespace pi_vehicle::recorder
