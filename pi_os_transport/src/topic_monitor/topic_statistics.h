#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace pi_os_transport
{

/// Distribution of durations in bounded memory. Buckets have 1/64 octave, so a quantile is at most 1.6 % too high; the
/// maximum and the mean are exact. Not thread safe.
class DurationHistogram
{
public:
  /// @param duration_ns  negative values (clocks differ) count as 0, and in negativeCount().
  void record(int64_t duration_ns);
  void clear();

  uint64_t count() const { return count_; }
  uint64_t negativeCount() const { return negative_count_; }
  int64_t maxNs() const { return max_ns_; }
  /// 0 if empty.
  double meanNs() const;
  /// Upper bound of the bucket that holds the quantile, never above maxNs(); 0 if empty.
  /// @param q in [0, 1].
  int64_t quantileNs(double q) const;

private:
  static constexpr size_t SUB_BUCKETS = 64;
  static constexpr size_t OCTAVES = 58;  ///< values below 64 ns have a bucket each, above that up to 2^63 ns

  static size_t bucketOf(uint64_t duration_ns);
  static int64_t upperBound(size_t bucket);

  std::array<uint32_t, SUB_BUCKETS * OCTAVES> buckets_{};
  uint64_t count_ = 0;
  uint64_t negative_count_ = 0;
  int64_t max_ns_ = 0;
  double sum_ns_ = 0.0;
};

/// Counts lost messages of one sender by their sequence numbers.
class SequenceTracker
{
public:
  /// @param connection  changes when the link is made again; numbers may then restart.
  void record(uint32_t seq, uint64_t connection);

  /// Numbers missing between the first and the last message. A late message is subtracted.
  uint64_t lost() const { return lost_; }
  /// Messages that came twice, or after one with a higher number on the same connection.
  uint64_t outOfOrder() const { return out_of_order_; }

private:
  bool started_ = false;
  uint32_t next_ = 0;
  uint64_t connection_ = 0;
  uint64_t lost_ = 0;
  uint64_t out_of_order_ = 0;
};

/// std_msgs/Header at the start of a serialised message.
struct StampedHeader
{
  uint32_t seq = 0;
  int64_t stamp_ns = 0;
};

/// Reads the header at the start of a serialised message that is known to begin with one.
/// @return nullopt if the buffer is too short to hold it.
std::optional<StampedHeader> readHeader(const uint8_t* data, size_t size);

/// True if the first field of a message definition (from the connection header) is a std_msgs/Header.
bool beginsWithHeader(const std::string& message_definition);

/// Figures of one topic over a time span.
struct TopicFigures
{
  uint64_t messages = 0;
  uint64_t bytes = 0;
  double span_s = 0.0;  ///< first to last message, or the length of the window
  double rate_hz = 0.0;
  double bytes_per_second = 0.0;
  bool has_stamps = false;  ///< latency is known
  double latency_mean_ms = 0.0;
  double latency_p50_ms = 0.0;
  double latency_p99_ms = 0.0;
  double latency_max_ms = 0.0;
  bool has_sequence = false;  ///< lost and out_of_order are known
  uint64_t lost = 0;
  uint64_t out_of_order = 0;
};

/// Statistics of one topic with any number of publishers. Not thread safe.
class TopicStatistics
{
public:
  /// @param arrival_ns monotonic time of arrival.
  /// @param age_ns     arrival minus header stamp, nullopt if the message has none or it is 0.
  /// @param seq        header.seq, nullopt if the message has no header.
  void record(int64_t arrival_ns, uint64_t bytes, std::optional<int64_t> age_ns, std::optional<uint32_t> seq,
              const std::string& publisher, uint64_t connection);

  /// Since the first message.
  TopicFigures total() const;
  /// Since the last call, and starts a new window. Lost messages are those of the whole time.
  TopicFigures takeWindow(int64_t now_ns);

private:
  void addSequence(TopicFigures* figures) const;

  uint64_t messages_ = 0;
  uint64_t bytes_ = 0;
  int64_t first_ns_ = 0;
  int64_t last_ns_ = 0;
  DurationHistogram ages_;
  std::map<std::string, SequenceTracker> sequences_;  ///< by publisher

  uint64_t window_messages_ = 0;
  uint64_t window_bytes_ = 0;
  int64_t window_start_ns_ = 0;  ///< 0: no window taken yet
  DurationHistogram window_ages_;
};

/// Names from a text like "/a, /b" or "[/a, '/b']", as roscpp's command line passes a list on. Nothing is resolved.
/// Throws std::invalid_argument for unbalanced brackets or quotes, an empty element or a name with a space.
std::vector<std::string> parseTopicList(const std::string& text);

}  // namespace pi_os_transport
