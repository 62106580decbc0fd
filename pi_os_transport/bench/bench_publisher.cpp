/// One end of the benchmark: an ordinary roscpp node that publishes images and knows only the topic API of roscpp.
///
/// Commands come as lines on standard input, answers go as lines "@ {json}" to standard output:
///   run COUNT SIZE RATE_HZ WINDOW PERIOD WORK_US
///                                          publish COUNT payloads of SIZE bytes. RATE_HZ > 0: at that fixed rate,
///                                          each after WORK_US of computing.
///                                          RATE_HZ 0: back to back, at most WINDOW beyond the slowest
///                                          acknowledgement, from PERIOD messages filled beforehand.
///   advertise COUNT                        COUNT further publishers, on extra_0, extra_1, ...
///   touch SIZE                             one message of SIZE bytes from each of them
///   drip COUNT SIZE RATE_HZ                COUNT messages of SIZE bytes from them in turn, at that rate in all
///   quit                                   (or end of input)
/// Option --fault byte|drop|order at sequence number 5, for the test of the checks.

#include "bench_commands.h"
#include "payload_pattern.h"

#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/UInt64.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <iostream>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace pi_os_transport_bench
{
namespace
{
constexpr std::uint64_t FAULT_SEQUENCE = 5;

class BenchPublisher
{
public:
  explicit BenchPublisher(std::string fault) : fault_(std::move(fault))
  {
    publisher_ = node_.advertise<sensor_msgs::Image>("data", QUEUE_SIZE);
    // Acknowledgements are control traffic: without the hint, stock TCPROS would hold them back (Nagle).
    acks_ = node_.subscribe("ack", QUEUE_SIZE, &BenchPublisher::acknowledge, this, ros::TransportHints().tcpNoDelay());
  }

  /// Carries out one command. @return false for "quit" and anything unknown.
  bool obey(const std::string& command, std::istream& words)
  {
    if (command == "run")
    {
      std::uint64_t count = 0, window = 0, period = 1;
      std::size_t size = 0;
      double rate_hz = 0.0;
      std::int64_t work_us = 0;
      words >> count >> size >> rate_hz >> window >> period >> work_us;
      run(count, size, rate_hz, window, std::max<std::uint64_t>(period, 1), work_us * 1000);
    }
    else if (command == "advertise")
    {
      std::size_t count = 0;
      words >> count;
      for (std::size_t i = 0; i < count; ++i)
      {
        extra_.push_back(node_.advertise<sensor_msgs::Image>("extra_" + std::to_string(i), 10));
      }
      std::cout << "@ {\"event\": \"advertised\"}" << std::endl;
    }
    else if (command == "touch")
    {
      std::size_t size = 0;
      words >> size;
      sensor_msgs::Image image;
      shapeImage(&image, size);
      for (ros::Publisher& publisher : extra_)
      {
        publisher.publish(image);
      }
      std::cout << "@ {\"event\": \"touched\"}" << std::endl;
    }
    else if (command == "drip")
    {
      std::uint64_t count = 0;
      std::size_t size = 0;
      double rate_hz = 0.0;
      words >> count >> size >> rate_hz;
      drip(count, size, rate_hz);
    }
    else
    {
      return false;
    }
    return true;
  }

private:
  void acknowledge(const ros::MessageEvent<const std_msgs::UInt64>& event)
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      acknowledged_[event.getPublisherName()] = event.getMessage()->data;
    }
    changed_.notify_one();
  }

  /// Waits until every subscriber has acknowledged all but `window` of the messages before `sequence`.
  /// Acknowledgements carry the number of messages received so far.
  void awaitWindow(std::uint64_t sequence, std::uint64_t window)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    while (ros::ok())
    {
      if (acknowledged_.size() >= publisher_.getNumSubscribers() &&
          std::all_of(acknowledged_.begin(), acknowledged_.end(),
                      [&](const auto& ack) { return sequence < ack.second + window; }))
      {
        return;
      }
      changed_.wait_for(lock, std::chrono::milliseconds(100));  // the time-out only serves to notice ros::shutdown
    }
  }

  void publishOne(sensor_msgs::Image* image, std::uint64_t sequence, std::uint64_t period)
  {
    PayloadHeader header{sequence, 0, image->data.size(), sequence % period};
    header.publish_ns = monotonicNs();
    std::memcpy(image->data.data(), &header, sizeof(header));
    publisher_.publish(*image);
    publish_ns_.push_back(monotonicNs() - header.publish_ns);
  }

  void drip(std::uint64_t count, std::size_t size, double rate_hz)
  {
    sensor_msgs::Image image;
    shapeImage(&image, size);
    const std::int64_t start_ns = monotonicNs();
    for (std::uint64_t i = 0; i < count && !extra_.empty() && ros::ok(); ++i)
    {
      sleepUntil(start_ns + static_cast<std::int64_t>(static_cast<double>(i) * 1e9 / rate_hz));
      extra_[i % extra_.size()].publish(image);
    }
    std::cout << "@ {\"event\": \"dripped\"}" << std::endl;
  }

  void run(std::uint64_t count, std::size_t size, double rate_hz, std::uint64_t window, std::uint64_t period,
           std::int64_t work_ns)
  {
    const bool paced = rate_hz > 0.0;
    std::vector<sensor_msgs::Image> images(paced ? 1 : period);
    for (std::size_t i = 0; i < images.size(); ++i)
    {
      shapeImage(&images[i], size);
      pattern_.fillBody(images[i].data.data(), size, i);
    }
    publish_ns_.clear();
    publish_ns_.reserve(count);
    std::int64_t fill_cpu_ns = 0;
    std::uint64_t late = 0;
    const auto interval_ns = paced ? static_cast<std::int64_t>(1e9 / rate_hz) : 0;
    const std::int64_t start_ns = monotonicNs();
    for (std::uint64_t i = 0; i < count && ros::ok(); ++i)
    {
      std::uint64_t sequence = next_sequence_ + i;
      sensor_msgs::Image& image = images[paced ? 0 : sequence % period];
      if (paced)
      {
        const std::int64_t due_ns = start_ns + static_cast<std::int64_t>(i) * interval_ns;
        late += monotonicNs() > due_ns + interval_ns;
        sleepUntil(due_ns);
        // Filled right before publishing, as by a driver that has just written the image; not part of the latency,
        // and its CPU time is reported so that it can be taken off.
        const std::int64_t before_ns = threadCpuNs();
        pattern_.fillBody(image.data.data(), size, sequence % period);
        while (threadCpuNs() - before_ns < work_ns)
        {
        }
        fill_cpu_ns += threadCpuNs() - before_ns;
      }
      else
      {
        awaitWindow(sequence, window);
      }
      if (fault_ == "drop" && sequence == FAULT_SEQUENCE)
      {
        continue;
      }
      if (fault_ == "byte" && sequence == FAULT_SEQUENCE)
      {
        image.data[size - 1] ^= 0x10;
      }
      if (fault_ == "order" && (sequence == FAULT_SEQUENCE || sequence == FAULT_SEQUENCE + 1))
      {
        sequence = 2 * FAULT_SEQUENCE + 1 - sequence;
        pattern_.fillBody(image.data.data(), size, sequence % period);
      }
      publishOne(&image, sequence, period);
    }
    next_sequence_ += count;
    std::sort(publish_ns_.begin(), publish_ns_.end());
    std::cout << "@ {\"event\": \"done\", \"start_ns\": " << start_ns << ", \"late\": " << late
              << ", \"bench_cpu_ns\": " << fill_cpu_ns
              << ", \"publish_p50_ns\": " << (publish_ns_.empty() ? 0 : publish_ns_[publish_ns_.size() / 2]) << "}"
              << std::endl;
  }

  const std::string fault_;
  const PayloadPattern pattern_;
  std::uint64_t next_sequence_ = 0;
  std::vector<std::int64_t> publish_ns_;  ///< duration of each publish() of the current run [ns]

  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, std::uint64_t> acknowledged_;  ///< by node name: messages received; guarded by mutex_

  ros::NodeHandle node_;
  ros::Publisher publisher_;
  std::vector<ros::Publisher> extra_;
  ros::Subscriber acks_;  // last: its callback uses the members above
};
}  // namespace
}  // namespace pi_os_transport_bench

int main(int argc, char** argv)
{
  ros::init(argc, argv, "bench_publisher");
  std::string fault;
  for (int i = 1; i < argc; ++i)
  {
    if (std::string(argv[i]) == "--fault" && i + 1 < argc)
    {
      fault = argv[++i];
    }
  }
  if (!fault.empty() && fault != "byte" && fault != "drop" && fault != "order")
  {
    ROS_FATAL("bench_publisher: --fault %s, must be byte, drop or order", fault.c_str());
    return 2;
  }
  pi_os_transport_bench::BenchPublisher publisher(fault);
  pi_os_transport_bench::serveCommands(&publisher);
  return 0;
}
