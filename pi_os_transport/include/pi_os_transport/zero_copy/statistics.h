#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace pi_os_transport::zero_copy
{

/// Counts the messages of one topic that this process published or received through this library.
struct TopicStatistics
{
  std::string topic;
  bool publisher = false;  ///< false: of a subscriber

  // Of a publisher: messages with subscribers, by the treatment of their largest array.
  uint64_t in_place = 0;   ///< sent from where the user wrote the array
  uint64_t small = 0;      ///< copied: no array has Arena::SMALLEST_ARRAY bytes
  uint64_t no_room = 0;    ///< copied: strings or other arrays need more room than there is around the array
  uint64_t from_heap = 0;  ///< of in_place, not in shared memory: no subscriber there, or the pool is full

  // Of a subscriber: messages.
  uint64_t viewed = 0;         ///< all large arrays are views
  uint64_t without_large = 0;  ///< there was no large array
  uint64_t misaligned = 0;     ///< a large array was copied: misaligned for its type
  uint64_t copied = 0;         ///< all arrays were copied: the message came over TCPROS, or too many were held

  /// One line of text.
  std::string toString() const;
};

/// The counters behind TopicStatistics. Thread safe.
class TopicCounters
{
public:
  TopicCounters(std::string topic, bool publisher) : topic_(std::move(topic)), publisher_(publisher) {}

  enum Sent
  {
    IN_PLACE,
    SMALL,
    NO_ROOM,
  };
  /// Warns once about problems that the user can solve.
  void countSent(Sent what, bool from_heap);
  enum Received
  {
    VIEWED,
    WITHOUT_LARGE,
    MISALIGNED,
    COPIED,
  };
  void countReceived(Received what) { received_[what].fetch_add(1, std::memory_order_relaxed); }

  TopicStatistics read() const;

private:
  const std::string topic_;
  const bool publisher_;
  std::atomic<uint64_t> sent_[NO_ROOM + 1]{};
  std::atomic<uint64_t> from_heap_{0};
  std::atomic<uint64_t> received_[COPIED + 1]{};
  std::atomic<bool> warned_{false};
};

/// The counters of a topic and direction, shared by all its publishers or subscribers. Any thread.
std::shared_ptr<TopicCounters> countersOf(const std::string& topic, bool publisher);

/// True if this process has published zero-copy messages on the topic. Any thread.
bool isZeroCopyTopic(const std::string& topic);

/// All topics of this process so far. Any thread.
std::vector<TopicStatistics> statistics();

}  // namespace pi_os_transport::zero_copy
