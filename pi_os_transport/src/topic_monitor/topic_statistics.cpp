#include "topic_monitor/topic_statistics.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <sstream>
#include <stdexcept>

namespace pi_os_transport
{

size_t DurationHistogram::bucketOf(uint64_t duration_ns)
{
  if (duration_ns < SUB_BUCKETS)
  {
    return duration_ns;
  }
  // duration = (64 + sub) * 2^shift + rest
  const auto shift = static_cast<unsigned>(63 - __builtin_clzll(duration_ns)) - 6U;
  return (shift + 1) * SUB_BUCKETS + ((duration_ns >> shift) - SUB_BUCKETS);
}

int64_t DurationHistogram::upperBound(size_t bucket)
{
  if (bucket < SUB_BUCKETS)
  {
    return static_cast<int64_t>(bucket);
  }
  const size_t shift = bucket / SUB_BUCKETS - 1;
  const uint64_t first = (SUB_BUCKETS + bucket % SUB_BUCKETS) << shift;
  return static_cast<int64_t>(first + ((uint64_t{1} << shift) - 1));
}

void DurationHistogram::record(int64_t duration_ns)
{
  negative_count_ += duration_ns < 0 ? 1 : 0;
  const int64_t value = std::max<int64_t>(duration_ns, 0);
  ++buckets_[bucketOf(static_cast<uint64_t>(value))];
  ++count_;
  max_ns_ = std::max(max_ns_, value);
  sum_ns_ += static_cast<double>(value);
}

void DurationHistogram::clear()
{
  *this = DurationHistogram();
}

double DurationHistogram::meanNs() const
{
  return count_ == 0 ? 0.0 : sum_ns_ / static_cast<double>(count_);
}

int64_t DurationHistogram::quantileNs(double q) const
{
  if (count_ == 0)
  {
    return 0;
  }
  const auto rank =
      std::max<uint64_t>(1, static_cast<uint64_t>(std::ceil(std::clamp(q, 0.0, 1.0) * static_cast<double>(count_))));
  uint64_t below = 0;
  for (size_t bucket = 0; bucket < buckets_.size(); ++bucket)
  {
    below += buckets_[bucket];
    if (below >= rank)
    {
      return std::min(upperBound(bucket), max_ns_);
    }
  }
  return max_ns_;
}

void SequenceTracker::record(uint32_t seq, uint64_t connection)
{
  const bool same_connection = started_ && connection == connection_;
  connection_ = connection;
  if (!started_)
  {
    started_ = true;
    next_ = seq + 1;
    return;
  }
  // Modulo 2^32, so that an overflow of the number is not a gap.
  const auto distance = static_cast<int32_t>(seq - next_);
  if (distance >= 0)
  {
    lost_ += static_cast<uint64_t>(distance);
    next_ = seq + 1;
  }
  else if (same_connection)
  {
    ++out_of_order_;
    lost_ -= lost_ > 0 ? 1 : 0;
  }
  else
  {
    next_ = seq + 1;  // the publisher was restarted
  }
}

std::optional<StampedHeader> readHeader(const uint8_t* data, size_t size)
{
  // uint32 seq, uint32 secs, uint32 nsecs, uint32 length of frame_id; little endian
  if (size < 16)
  {
    return std::nullopt;
  }
  uint32_t words[3];
  std::memcpy(words, data, sizeof(words));
  StampedHeader header;
  header.seq = words[0];
  header.stamp_ns = static_cast<int64_t>(words[1]) * 1000000000LL + words[2];
  return header;
}

bool beginsWithHeader(const std::string& message_definition)
{
  std::istringstream lines(message_definition);
  std::string line;
  while (std::getline(lines, line))
  {
    line = line.substr(0, line.find('#'));
    std::istringstream words(line);
    std::string type;
    std::string name;
    words >> type >> name;
    if (type.empty())
    {
      continue;
    }
    if (type.rfind("===", 0) == 0)
    {
      return false;  // definitions of parts begin here: the message has no field
    }
    std::string rest;
    std::getline(words, rest);
    if (name.find('=') != std::string::npos || rest.find('=') != std::string::npos)
    {
      continue;  // a constant is not part of the message
    }
    return type == "Header" || type == "std_msgs/Header" || type == "roslib/Header";
  }
  return false;
}

namespace
{

void setLatency(const DurationHistogram& ages, TopicFigures* figures)
{
  figures->has_stamps = ages.count() > 0;
  figures->latency_mean_ms = ages.meanNs() * 1e-6;
  figures->latency_p50_ms = static_cast<double>(ages.quantileNs(0.5)) * 1e-6;
  figures->latency_p99_ms = static_cast<double>(ages.quantileNs(0.99)) * 1e-6;
  figures->latency_max_ms = static_cast<double>(ages.maxNs()) * 1e-6;
}

}  // namespace

void TopicStatistics::record(int64_t arrival_ns, uint64_t bytes, std::optional<int64_t> age_ns,
                             std::optional<uint32_t> seq, const std::string& publisher, uint64_t connection)
{
  if (messages_ == 0)
  {
    first_ns_ = arrival_ns;
  }
  if (window_start_ns_ == 0)
  {
    window_start_ns_ = arrival_ns;
  }
  last_ns_ = arrival_ns;
  ++messages_;
  bytes_ += bytes;
  ++window_messages_;
  window_bytes_ += bytes;
  if (age_ns)
  {
    ages_.record(*age_ns);
    window_ages_.record(*age_ns);
  }
  if (seq)
  {
    sequences_[publisher].record(*seq, connection);
  }
}

void TopicStatistics::addSequence(TopicFigures* figures) const
{
  figures->has_sequence = !sequences_.empty();
  for (const auto& [publisher, sequence] : sequences_)
  {
    figures->lost += sequence.lost();
    figures->out_of_order += sequence.outOfOrder();
  }
}

TopicFigures TopicStatistics::total() const
{
  TopicFigures figures;
  figures.messages = messages_;
  figures.bytes = bytes_;
  figures.span_s = static_cast<double>(last_ns_ - first_ns_) * 1e-9;
  if (messages_ > 1 && figures.span_s > 0.0)
  {
    // The intervals between n messages are n - 1.
    figures.rate_hz = static_cast<double>(messages_ - 1) / figures.span_s;
    figures.bytes_per_second = figures.rate_hz * static_cast<double>(bytes_) / static_cast<double>(messages_);
  }
  setLatency(ages_, &figures);
  addSequence(&figures);
  return figures;
}

TopicFigures TopicStatistics::takeWindow(int64_t now_ns)
{
  TopicFigures figures;
  figures.messages = window_messages_;
  figures.bytes = window_bytes_;
  figures.span_s = window_start_ns_ == 0 ? 0.0 : static_cast<double>(now_ns - window_start_ns_) * 1e-9;
  if (figures.span_s > 0.0)
  {
    figures.rate_hz = static_cast<double>(window_messages_) / figures.span_s;
    figures.bytes_per_second = static_cast<double>(window_bytes_) / figures.span_s;
  }
  setLatency(window_ages_, &figures);
  addSequence(&figures);
  window_messages_ = 0;
  window_bytes_ = 0;
  window_start_ns_ = messages_ == 0 ? 0 : now_ns;
  window_ages_.clear();
  return figures;
}

namespace
{

constexpr const char* SPACES = " \t\r\n";

std::string trimmed(const std::string& text)
{
  const size_t begin = text.find_first_not_of(SPACES);
  return begin == std::string::npos ? "" : text.substr(begin, text.find_last_not_of(SPACES) + 1 - begin);
}

}  // namespace

std::vector<std::string> parseTopicList(const std::string& text)
{
  const auto refuse = [&text](const std::string& reason) -> std::invalid_argument
  { return std::invalid_argument("topics = \"" + text + "\": " + reason + "; write them like [/a, /b]"); };
  std::string list = trimmed(text);
  const bool opened = !list.empty() && list.front() == '[';
  const bool closed = !list.empty() && list.back() == ']';
  if (opened != closed)
  {
    throw refuse("a bracket is missing");
  }
  if (opened)
  {
    list = trimmed(list.substr(1, list.size() - 2));
  }
  std::vector<std::string> topics;
  if (list.empty())
  {
    return topics;
  }
  for (size_t begin = 0; begin <= list.size();)
  {
    const size_t end = std::min(list.find(',', begin), list.size());
    std::string topic = trimmed(list.substr(begin, end - begin));
    begin = end + 1;
    if (topic.size() >= 2 && (topic.front() == '\'' || topic.front() == '"') && topic.front() == topic.back())
    {
      topic = topic.substr(1, topic.size() - 2);
    }
    if (topic.empty())
    {
      throw refuse("a name is empty");
    }
    const size_t wrong = topic.find_first_of(std::string(SPACES) + "[]'\"");
    if (wrong != std::string::npos)
    {
      throw refuse("\"" + topic + "\" is no name of a topic");
    }
    topics.push_back(topic);
  }
  return topics;
}

}  // namespace pi_os_transport
