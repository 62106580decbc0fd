/// A node of the benchmark of devices: publishes at fixed rates and records what arrives when, also where messages may
/// rightly be dropped. An ordinary roscpp node that knows only the topic API of roscpp.
///
/// Commands come as lines on standard input, answers go as lines "@ {json}" to standard output:
///   advertise TOPIC SIZE QUEUE  a publisher of payloads of SIZE bytes; answers "advertised"
///   start TOPIC RATE_HZ         publishes in a thread of its own until told to stop; answers "started"
///   published TOPIC             answers "published" with the number of messages so far
///   stop TOPIC                  answers "stopped" with the number of messages in all
///   subscribe TOPIC SIZE QUEUE  answers "subscribed"; "take" and "tally" tell of its messages
///   count TOPIC SIZE QUEUE      the same, but keeps nothing of single messages: only "tally" tells of them
///   links TOPIC                 answers "links" with the number of subscribers, or publishers, of the topic
///   take TOPIC                  answers "taken" with [sequence, publish_ns, arrival_ns] of every message since the
///                               last "take", in order of arrival, and the number of damaged ones
///   tally TOPIC                 answers "tallied" with the messages received so far: how many, the next sequence
///                               number, how many were missing, repeated or damaged, and their latency
///   quit                        (or end of input)
/// Option --tcp-no-delay: ask for tcpNoDelay in the TransportHints.

#include "bench_commands.h"
#include "payload_pattern.h"

#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace pi_os_transport_bench
{
namespace
{
constexpr std::uint64_t PERIOD = 3;  ///< different bodies of one topic, filled beforehand: filling takes no time later

class Outflow
{
public:
  Outflow(ros::NodeHandle* node, const std::string& topic, std::size_t size, std::uint32_t queue)
    : publisher_(node->advertise<sensor_msgs::Image>(topic, queue))
  {
    const PayloadPattern pattern;
    for (std::size_t i = 0; i < images_.size(); ++i)
    {
      shapeImage(&images_[i], size);
      pattern.fillBody(images_[i].data.data(), size, i);
    }
  }
  ~Outflow() { stop(); }

  void start(double rate_hz)
  {
    stop();
    stopped_ = false;
    thread_ = std::thread(
        [this, rate_hz]
        {
          const auto interval_ns = static_cast<std::int64_t>(1e9 / rate_hz);
          for (std::int64_t due_ns = monotonicNs(); !stopped_ && ros::ok(); due_ns += interval_ns)
          {
            sleepUntil(due_ns);
            publishOne();
          }
        });
  }

  void stop()
  {
    stopped_ = true;
    if (thread_.joinable())
    {
      thread_.join();
    }
  }

  std::uint64_t published() const { return published_; }
  std::uint32_t links() const { return publisher_.getNumSubscribers(); }

private:
  void publishOne()
  {
    const std::uint64_t sequence = published_;
    sensor_msgs::Image& image = images_[sequence % PERIOD];
    const PayloadHeader header{sequence, monotonicNs(), image.data.size(), sequence % PERIOD};
    std::memcpy(image.data.data(), &header, sizeof(header));
    publisher_.publish(image);
    published_ = sequence + 1;
  }

  std::array<sensor_msgs::Image, PERIOD> images_;
  ros::Publisher publisher_;
  std::atomic<std::uint64_t> published_{0};
  std::atomic<bool> stopped_{true};
  std::thread thread_;
};

class Inflow
{
public:
  /// @param rows  keep one for take() of every message
  Inflow(ros::NodeHandle* node, const std::string& topic, std::size_t size, std::uint32_t queue,
         const ros::TransportHints& hints, bool rows)
    : size_(size), keep_rows_(rows)
  {
    subscriber_ = node->subscribe(topic, queue, &Inflow::receive, this, hints);
  }

  std::uint32_t links() const { return subscriber_.getNumPublishers(); }

  /// JSON fields "rows" and "damaged" of what has come since the last call.
  std::string take()
  {
    std::vector<Row> rows;
    std::uint64_t damaged = 0;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      rows.swap(rows_);
      std::swap(damaged, damaged_);
    }
    std::ostringstream json;
    json << "\"damaged\": " << damaged << ", \"rows\": [";
    for (std::size_t i = 0; i < rows.size(); ++i)
    {
      json << (i == 0 ? "[" : ", [") << rows[i].sequence << ", " << rows[i].publish_ns << ", " << rows[i].arrival_ns
           << "]";
    }
    json << "]";
    return json.str();
  }

  /// JSON fields of all that has come. A message is missing if a later one has come before it.
  std::string tally()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    std::ostringstream json;
    json << "\"received\": " << tally_.received << ", \"next\": " << tally_.next << ", \"missing\": " << tally_.missing
         << ", \"repeated\": " << tally_.repeated << ", \"damaged\": " << damaged_
         << ", \"latency_ns\": " << tally_.latency_ns << ", \"slowest_ns\": " << tally_.slowest_ns;
    return json.str();
  }

private:
  struct Tally
  {
    std::uint64_t received = 0;
    std::uint64_t next = 0;
    std::uint64_t missing = 0;
    std::uint64_t repeated = 0;   ///< or out of order
    std::int64_t latency_ns = 0;  ///< of all together
    std::int64_t slowest_ns = 0;
  };

  struct Row
  {
    std::uint64_t sequence;
    std::int64_t publish_ns;
    std::int64_t arrival_ns;
  };

  void receive(const sensor_msgs::ImageConstPtr& image)
  {
    const std::int64_t arrival_ns = monotonicNs();
    PayloadHeader header{};
    bool intact = !findWrongField(*image, size_);
    if (intact)
    {
      std::memcpy(&header, image->data.data(), sizeof(header));
      intact = header.size == size_ && header.key == header.sequence % PERIOD &&
               !pattern_.findWrongSample(image->data.data(), size_, header.key, header.sequence);
    }
    std::lock_guard<std::mutex> lock(mutex_);
    if (!intact)
    {
      ++damaged_;
      return;
    }
    ++tally_.received;
    tally_.latency_ns += arrival_ns - header.publish_ns;
    tally_.slowest_ns = std::max(tally_.slowest_ns, arrival_ns - header.publish_ns);
    if (header.sequence < tally_.next)
    {
      ++tally_.repeated;
    }
    else
    {
      tally_.missing += header.sequence - tally_.next;
      tally_.next = header.sequence + 1;
    }
    if (keep_rows_)
    {
      rows_.push_back({header.sequence, header.publish_ns, arrival_ns});
    }
  }

  const std::size_t size_;
  const bool keep_rows_;
  const PayloadPattern pattern_;
  std::mutex mutex_;  ///< guards rows_, tally_ and damaged_
  std::vector<Row> rows_;
  Tally tally_;
  std::uint64_t damaged_ = 0;
  ros::Subscriber subscriber_;  // last: its callback uses the members above
};

class BenchFlow
{
public:
  explicit BenchFlow(const ros::TransportHints& hints) : hints_(hints) {}

  /// Carries out one command. @return false for "quit" and anything unknown, also an unknown topic.
  bool obey(const std::string& command, std::istream& words)
  {
    std::string topic;
    words >> topic;
    if (command == "advertise" || command == "subscribe" || command == "count")
    {
      std::size_t size = 0;
      std::uint32_t queue = 0;
      words >> size >> queue;
      if (size < MIN_PAYLOAD_SIZE)
      {
        ROS_FATAL("bench_flow: size %zu of %s, must be at least %zu", size, topic.c_str(), MIN_PAYLOAD_SIZE);
        return false;
      }
      if (command == "advertise")
      {
        outflows_[topic] = std::make_unique<Outflow>(&node_, topic, size, queue);
        return answer("advertised");
      }
      inflows_[topic] = std::make_unique<Inflow>(&node_, topic, size, queue, hints_, command == "subscribe");
      return answer("subscribed");
    }
    const auto outflow = outflows_.find(topic);
    const auto inflow = inflows_.find(topic);
    if (inflow != inflows_.end())
    {
      return command == "take"    ? answer("taken", ", " + inflow->second->take())
             : command == "tally" ? answer("tallied", ", " + inflow->second->tally())
             : command == "links" ? answer("links", ", \"links\": " + std::to_string(inflow->second->links()))
                                  : false;
    }
    if (outflow == outflows_.end())
    {
      return false;
    }
    Outflow& flow = *outflow->second;
    if (command == "start")
    {
      double rate_hz = 0.0;
      words >> rate_hz;
      flow.start(rate_hz);
      return answer("started");
    }
    if (command == "stop")
    {
      flow.stop();
      return answer("stopped", ", \"published\": " + std::to_string(flow.published()));
    }
    return command == "published" ? answer("published", ", \"published\": " + std::to_string(flow.published()))
           : command == "links"   ? answer("links", ", \"links\": " + std::to_string(flow.links()))
                                  : false;
  }

private:
  static bool answer(const std::string& event, const std::string& fields = "")
  {
    std::cout << "@ {\"event\": \"" << event << "\"" << fields << "}" << std::endl;
    return true;
  }

  const ros::TransportHints hints_;
  ros::NodeHandle node_;
  std::map<std::string, std::unique_ptr<Outflow>> outflows_;
  std::map<std::string, std::unique_ptr<Inflow>> inflows_;
};
}  // namespace
}  // namespace pi_os_transport_bench

int main(int argc, char** argv)
{
  ros::init(argc, argv, "bench_flow");
  ros::TransportHints hints;
  if (std::find(argv + 1, argv + argc, std::string("--tcp-no-delay")) != argv + argc)
  {
    hints.tcpNoDelay();
  }
  pi_os_transport_bench::BenchFlow flow(hints);
  pi_os_transport_bench::serveCommands(&flow);
  return 0;
}
