/// The other end of the benchmark: an ordinary roscpp node that receives images, checks every one of them and measures.
///
/// Commands come as lines on standard input, answers go as lines "@ {json}" to standard output:
///   expect COUNT SIZE CHECK WINDOW PERIOD  the next COUNT messages; CHECK is "full" (every byte) or "sample"; WINDOW
///                                          > 0: acknowledge every quarter of it. Answers "ready", later "complete"
///                                          with the latencies in order of arrival, or "error".
///   listen COUNT                           COUNT further subscriptions, to extra_0, extra_1, ...; answers "listening",
///                                          and "heard" once each of them has had a message
///   report                                 answers "report" with the number of expected messages that have come, and
///                                          of those of the further subscriptions
///   quit                                   (or end of input)
/// Option --tcp-no-delay: ask for tcpNoDelay in the TransportHints.

#include "bench_commands.h"
#include "payload_pattern.h"

#include <pthread.h>
#include <ros/ros.h>
#include <sched.h>
#include <semaphore.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/UInt64.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <mutex>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace pi_os_transport_bench
{
namespace
{
/// Payloads above this are checked by a thread that runs only when a core is idle, so that one subscriber's check does
/// not delay the next subscriber's message [bytes].
constexpr std::size_t MAX_INLINE_CHECK = 64 * 1024;

struct Expectation
{
  std::uint64_t count = 0;   ///< messages
  std::size_t size = 0;      ///< [bytes]
  bool full = true;          ///< every byte, else samples
  std::uint64_t window = 0;  ///< 0: no acknowledgements
  std::uint64_t period = 1;
};

class BenchSubscriber
{
public:
  explicit BenchSubscriber(const ros::TransportHints& hints) : hints_(hints)
  {
    sem_init(&work_, 0, 0);
    checker_ = std::thread([this] { checkWhenIdle(); });
    ack_publisher_ = node_.advertise<std_msgs::UInt64>("ack", QUEUE_SIZE);
    subscriber_ = node_.subscribe("data", QUEUE_SIZE, &BenchSubscriber::receive, this, hints_);
  }

  ~BenchSubscriber()
  {
    subscriber_.shutdown();
    sem_post(&work_);
    checker_.join();
    sem_destroy(&work_);
  }

  /// Carries out one command. @return false for "quit" and anything unknown.
  bool obey(const std::string& command, std::istream& words)
  {
    if (command == "expect")
    {
      Expectation expectation;
      std::string check;
      words >> expectation.count >> expectation.size >> check >> expectation.window >> expectation.period;
      expectation.full = check != "sample";
      expectation.period = std::max<std::uint64_t>(expectation.period, 1);
      expect(expectation);
    }
    else if (command == "listen")
    {
      std::size_t count = 0;
      words >> count;
      listen(count);
    }
    else if (command == "report")
    {
      std::lock_guard<std::mutex> lock(mutex_);
      say("{\"event\": \"report\", \"received\": " + std::to_string(latencies_ns_.size()) +
          ", \"heard\": " + std::to_string(heard_in_all_) + "}");
    }
    else
    {
      return false;
    }
    return true;
  }

private:
  void expect(const Expectation& expectation)
  {
    std_msgs::UInt64 ack;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      expectation_ = expectation;
      latencies_ns_.clear();
      latencies_ns_.reserve(expectation.count);
      checked_ = 0;
      check_cpu_ns_ = 0;
      ack.data = next_sequence_;
    }
    if (expectation.window > 0)
    {
      ack_publisher_.publish(ack);  // before the answer: after it, messages come, and a later count must not be undone
    }
    say("{\"event\": \"ready\"}");
  }

  void listen(std::size_t count)
  {
    for (std::size_t i = 0; i < count; ++i)
    {
      const std::string topic = "extra_" + std::to_string(i);
      extra_.push_back(node_.subscribe<sensor_msgs::Image>(
          topic, 10, [this, i, count](const sensor_msgs::ImageConstPtr& /*image*/) { hear(i, count); },
          ros::VoidConstPtr(), hints_));
    }
    say("{\"event\": \"listening\"}");
  }

  void hear(std::size_t topic, std::size_t count)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    ++heard_in_all_;
    if (heard_.insert(topic).second && heard_.size() == count)
    {
      say("{\"event\": \"heard\"}");
    }
  }

  void receive(const sensor_msgs::ImageConstPtr& image)
  {
    const std::int64_t arrival_ns = monotonicNs();
    std::unique_lock<std::mutex> lock(mutex_);
    if (failed_)
    {
      return;
    }
    PayloadHeader header{};
    if (latencies_ns_.size() >= expectation_.count)
    {
      return fail("unannounced message: " + std::to_string(next_sequence_) + " messages were announced and received");
    }
    if (const auto wrong = findWrongField(*image, expectation_.size))
    {
      return fail("message " + std::to_string(next_sequence_) + ": " + *wrong);
    }
    std::memcpy(&header, image->data.data(), sizeof(header));
    if (header.sequence != next_sequence_)
    {
      return fail((header.sequence > next_sequence_ ? "lost or reordered message: sequence number "
                                                    : "repeated or reordered message: sequence number ") +
                  std::to_string(header.sequence) + " arrived, " + std::to_string(next_sequence_) + " was next");
    }
    if (next_sequence_ > 0 && image->header.seq != header_seq_ + 1)
    {
      return fail("message " + std::to_string(next_sequence_) + ": header.seq is " + std::to_string(image->header.seq) +
                  " after " + std::to_string(header_seq_));
    }
    header_seq_ = image->header.seq;
    if (header.size != expectation_.size || header.key != header.sequence % expectation_.period)
    {
      return fail("message " + std::to_string(next_sequence_) + ": wrong size or key in the payload's header");
    }
    ++next_sequence_;
    latencies_ns_.push_back(arrival_ns - header.publish_ns);
    last_arrival_ns_ = arrival_ns;
    const std::uint64_t window = expectation_.window;
    lock.unlock();

    if (window > 0 && (header.sequence + 1) % std::max<std::uint64_t>(window / 4, 1) == 0)
    {
      std_msgs::UInt64 ack;
      ack.data = header.sequence + 1;
      ack_publisher_.publish(ack);
    }
    if (window > 0 || image->data.size() <= MAX_INLINE_CHECK || !checkLater(image))
    {
      check(*image);
    }
  }

  /// Compares the body and reports. Takes no lock: the low-priority thread must not be able to hold one that the
  /// callback needs. What it reads of expectation_ stays as it is until the last message has been checked.
  void check(const sensor_msgs::Image& image)
  {
    const bool timed = expectation_.window == 0;  // the clock costs as much as a small message: not when back to back
    const std::int64_t before_ns = timed ? threadCpuNs() : 0;
    const std::uint8_t* payload = image.data.data();
    const std::size_t size = image.data.size();
    PayloadHeader header{};
    std::memcpy(&header, payload, sizeof(header));
    const auto wrong = expectation_.full ? pattern_.findWrongByte(payload, size, header.key)
                                         : pattern_.findWrongSample(payload, size, header.key, header.sequence);
    if (timed)
    {
      check_cpu_ns_.fetch_add(threadCpuNs() - before_ns, std::memory_order_relaxed);
    }
    if (wrong)
    {
      fail("wrong byte: message " + std::to_string(header.sequence) + " of " + std::to_string(size) +
           " bytes differs from its pattern at byte " + std::to_string(*wrong));
    }
    else if (checked_.fetch_add(1, std::memory_order_acq_rel) + 1 == expectation_.count && !failed_)
    {
      complete();
    }
  }

  /// All messages have been received and checked: the callback is at rest until the next expect().
  void complete()
  {
    std::ostringstream json;
    json << "{\"event\": \"complete\", \"last_ns\": " << last_arrival_ns_
         << ", \"bench_cpu_ns\": " << check_cpu_ns_.load() << ", \"latencies_ns\": [";
    if (expectation_.window == 0)
    {
      for (std::size_t i = 0; i < latencies_ns_.size(); ++i)
      {
        json << (i == 0 ? "" : ", ") << latencies_ns_[i];
      }
    }
    json << "]}";
    say(json.str());
  }

  /// Hands a message to the low-priority thread. Called by the callback only.
  /// @return false if as many wait as are allowed to.
  bool checkLater(const sensor_msgs::ImageConstPtr& image)
  {
    const std::uint64_t handed_over = handed_over_.load(std::memory_order_relaxed);
    if (handed_over - taken_.load(std::memory_order_acquire) >= unchecked_.size())
    {
      return false;
    }
    unchecked_[handed_over % unchecked_.size()] = image;
    handed_over_.store(handed_over + 1, std::memory_order_release);
    sem_post(&work_);
    return true;
  }

  void checkWhenIdle()
  {
    const sched_param parameters{};
    pthread_setschedparam(pthread_self(), SCHED_IDLE, &parameters);
    while (true)
    {
      while (sem_wait(&work_) != 0)  // interrupted by a signal
      {
      }
      const std::uint64_t taken = taken_.load(std::memory_order_relaxed);
      if (taken == handed_over_.load(std::memory_order_acquire))
      {
        return;  // woken without work: the destructor
      }
      const sensor_msgs::ImageConstPtr image = std::move(unchecked_[taken % unchecked_.size()]);
      taken_.store(taken + 1, std::memory_order_release);
      check(*image);
    }
  }

  void fail(const std::string& text)
  {
    if (!failed_.exchange(true))
    {
      say("{\"event\": \"error\", \"text\": \"" + text + "\"}");
    }
  }

  void say(const std::string& json)
  {
    std::lock_guard<std::mutex> lock(output_mutex_);
    std::cout << "@ " << json << std::endl;
  }

  const PayloadPattern pattern_;
  const ros::TransportHints hints_;

  std::mutex output_mutex_;
  std::mutex mutex_;  ///< between callback and commands; guards everything down to heard_in_all_
  Expectation expectation_;
  std::uint64_t next_sequence_ = 0;  ///< of the next message; equals the number of messages received
  std::uint32_t header_seq_ = 0;     ///< of the last message
  std::vector<std::int64_t> latencies_ns_;
  std::int64_t last_arrival_ns_ = 0;
  std::set<std::size_t> heard_;
  std::uint64_t heard_in_all_ = 0;

  std::atomic<std::uint64_t> checked_{0};
  std::atomic<std::int64_t> check_cpu_ns_{0};
  std::atomic<bool> failed_{false};

  // Queue of one producer (the callback) and one consumer (checker_), so short that memory stays bounded and the heap
  // of the node looks like that of a node that keeps only its current image.
  std::array<sensor_msgs::ImageConstPtr, 2> unchecked_;
  std::atomic<std::uint64_t> handed_over_{0};
  std::atomic<std::uint64_t> taken_{0};
  sem_t work_;

  std::thread checker_;
  ros::NodeHandle node_;
  ros::Publisher ack_publisher_;
  std::vector<ros::Subscriber> extra_;
  ros::Subscriber subscriber_;  // last: its callback uses the members above
};
}  // namespace
}  // namespace pi_os_transport_bench

int main(int argc, char** argv)
{
  ros::init(argc, argv, "bench_subscriber");
  ros::TransportHints hints;
  if (std::find(argv + 1, argv + argc, std::string("--tcp-no-delay")) != argv + argc)
  {
    hints.tcpNoDelay();
  }
  pi_os_transport_bench::BenchSubscriber subscriber(hints);
  pi_os_transport_bench::serveCommands(&subscriber);
  return 0;
}
