#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace pi_vehicle::recorder
{

/// Where messages come from: a topic of one publisher.
struct Channel
{
  std::string topic;  ///< resolved name
  std::map<std::string, std::string>
      header;  ///< of the connection: type, md5sum, message_definition, latching, callerid

  const std::string& field(const std::string& name) const;  ///< empty if the header lacks it
  bool isLatching() const { return field("latching") == "1"; }
};

/// A message as it came, with its time of arrival in two clocks.
struct KeptMessage
{
  std::shared_ptr<const Channel> channel;
  int64_t stamp_ns = 0;    ///< time of ROS, for the bag; may jump
  int64_t elapsed_ns = 0;  ///< of the vehicle's clock; never goes back
  bool slim = false;       ///< also for the continuous recording
  std::vector<uint8_t> bytes;

  /// What it takes of the memory, with its share of the containers [bytes].
  size_t cost() const { return bytes.size() + sizeof(KeptMessage) + 64; }
};
using KeptMessagePtr = std::shared_ptr<const KeptMessage>;

/// The newest messages of all topics, bounded in time and in bytes. Readers have cursors: numbers of messages, in the
/// order of arrival. Thread safe.
class MessageMemory
{
public:
  /// @param max_bytes  of all messages with their overhead; the oldest go first, also those that a reader still needs.
  /// @param keep_ns  older messages go unless a reader needs them.
  MessageMemory(size_t max_bytes, int64_t keep_ns);

  /// @param message  its elapsed_ns is not below that of the one before.
  void add(KeptMessagePtr message);
  /// All that came up to now is in.
  void advance(int64_t now_ns);
  /// Readers need the messages from this number on.
  void pin(uint64_t from);

  struct Batch
  {
    std::vector<KeptMessagePtr> messages;
    uint64_t next = 0;        ///< where to read on
    uint64_t missed = 0;      ///< messages at and behind `from` that are gone
    int64_t complete_ns = 0;  ///< all messages up to this time are in the memory, and below `next` if it is the end
    bool at_end = false;
  };
  /// @param most  messages at once. @param until_ns  messages that came later are left.
  Batch read(uint64_t from, size_t most, int64_t until_ns = INT64_MAX) const;

  /// The first message that came at this time or later.
  uint64_t firstSince(int64_t elapsed_ns) const;
  uint64_t end() const;
  int64_t completeNs() const;
  /// The last message of each latching channel, in the order of arrival. They stay however old they are, while
  /// they take a quarter of the memory at most.
  std::vector<KeptMessagePtr> latched() const;

  struct Usage
  {
    size_t bytes = 0;
    size_t messages = 0;
    double seconds = 0.0;    ///< from the oldest message to now
    uint64_t forgotten = 0;  ///< messages that had to go before their time, for want of bytes
    int64_t forgot_ns = -1;  ///< when the last of them went; -1: never
  };
  Usage usage() const;

private:
  void keepLatched(const KeptMessagePtr& message);
  void forget();

  const size_t max_bytes_;
  const int64_t keep_ns_;
  mutable std::mutex mutex_;
  std::deque<KeptMessagePtr> messages_;
  std::map<std::pair<std::string, std::string>, KeptMessagePtr> latched_;  ///< by topic and publisher
  size_t latched_bytes_ = 0;  ///< counted as if none of them were in messages_ as well
  uint64_t first_ = 0;        ///< number of messages_.front()
  uint64_t pinned_ = UINT64_MAX;
  int64_t now_ns_ = 0;
  Usage usage_;
};

}  // namespace pi_vehicle::recorder
