/// The nodes of bench_zero_copy: a talker and a listener of sensor_msgs/Image, each either as every roscpp node is
/// written or with the zero-copy API, and the floor that both are measured against, without ROS.
///
/// Usage: bench_zero_copy_node talker|listener stock|zero_copy, or bench_zero_copy_node floor COUNT RATE
///
/// Commands come as lines on standard input, answers go as lines "@ {json}" to standard output.
/// The talker:
///   latency COUNT SIZE RATE      publishes at RATE [Hz]; every byte is written before the clock starts
///   throughput COUNT SIZE WINDOW FILL   back to back, at most WINDOW ahead of the listener; FILL "all" writes every
///                                byte, "pages" one of each page
///   Both answer "published" with the time that publishing took [ns], filling included.
/// The listener:
///   expect COUNT EVERY           answers "ready", and "complete" with the latencies [ns] after COUNT messages;
///                                acknowledges every EVERY-th one (0: none); touches one byte of every page
///   quit                         (or end of input), both
/// The floor prints one "complete" with the times from FUTEX_WAKE in one process to the return of FUTEX_WAIT in
/// another.

#include "bench_commands.h"

#include <linux/futex.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <signal.h>
#include <std_msgs/UInt64.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "pi_os_transport/zero_copy/publisher.h"
#include "pi_os_transport/zero_copy/subscriber.h"

namespace pi_os_transport_bench
{
namespace
{

namespace zero_copy = pi_os_transport::zero_copy;
using sensor_msgs::Image;

constexpr size_t PAGE = 4096;
constexpr uint32_t QUEUE_SIZE = 100;

uint64_t nowNs()
{
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<uint64_t>(now.tv_sec) * 1000000000 + static_cast<uint64_t>(now.tv_nsec);
}

void sleepUntilNs(uint64_t time)
{
  const timespec until{static_cast<time_t>(time / 1000000000), static_cast<long>(time % 1000000000)};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

void say(const std::string& json)
{
  std::cout << "@ " << json << std::endl;
}

void sayComplete(const std::vector<uint64_t>& latencies)
{
  std::string list;
  for (const uint64_t latency : latencies)
  {
    list += (list.empty() ? "" : ", ") + std::to_string(latency);
  }
  say("{\"event\": \"complete\", \"latencies_ns\": [" + list + "]}");
}

/// Writes the content of a message, whichever form it has.
template <typename Form>
void fill(Form* image, size_t bytes, bool every_byte, uint8_t value)
{
  image->header.frame_id = "camera_optical";
  image->encoding = "mono8";
  image->step = static_cast<uint32_t>(bytes);
  image->data.resize(bytes);
  if (every_byte)
  {
    std::memset(image->data.data(), value, bytes);
    return;
  }
  for (size_t i = 0; i < bytes; i += PAGE)
  {
    image->data[i] = value;
  }
}

class Talker
{
public:
  explicit Talker(bool zero_copy)
    : zero_copy_(zero_copy)
    , publisher_(node_, "data", QUEUE_SIZE)
    , acks_(node_.subscribe("ack", 100, &Talker::onAck, this))
  {
  }

  bool obey(const std::string& command, std::istream& words)
  {
    size_t count = 0;
    size_t bytes = 0;
    words >> count >> bytes;
    const uint64_t start = nowNs();
    if (command == "latency")
    {
      double rate = 0;
      words >> rate;
      for (size_t i = 0; i < count; ++i)
      {
        sleepUntilNs(start + static_cast<uint64_t>(static_cast<double>(i + 1) * 1e9 / rate));
        publish(bytes, true);
      }
    }
    else if (command == "throughput")
    {
      uint64_t window = 0;
      std::string extent;
      words >> window >> extent;
      const uint64_t before = published_;
      for (size_t i = 0; i < count; ++i)
      {
        {
          std::unique_lock<std::mutex> lock(mutex_);
          acknowledged_changed_.wait(lock, [&]() { return published_ - acknowledged_ < window; });
        }
        publish(bytes, extent == "all");
      }
      std::unique_lock<std::mutex> lock(mutex_);
      acknowledged_changed_.wait(lock, [&]() { return acknowledged_ >= before + count; });
    }
    else
    {
      return false;
    }
    say("{\"event\": \"published\", \"ns\": " + std::to_string(nowNs() - start) + "}");
    return true;
  }

private:
  void publish(size_t bytes, bool every_byte)
  {
    ++published_;
    if (zero_copy_)
    {
      zero_copy::Loan<Image> image = publisher_.borrow();
      fill(image.get(), bytes, every_byte, static_cast<uint8_t>(published_));
      stamp(image.get());
      publisher_.publish(std::move(image));
    }
    else
    {
      const auto image = boost::make_shared<Image>();
      fill(image.get(), bytes, every_byte, static_cast<uint8_t>(published_));
      stamp(image.get());
      publisher_.rosPublisher().publish(image);
    }
  }
  template <typename Form>
  void stamp(Form* image) const
  {
    image->header.stamp.sec = static_cast<uint32_t>(published_);
    const uint64_t now = nowNs();
    image->height = static_cast<uint32_t>(now >> 32);
    image->width = static_cast<uint32_t>(now);
  }
  void onAck(const std_msgs::UInt64ConstPtr& total)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    acknowledged_ = total->data;
    acknowledged_changed_.notify_all();
  }

  const bool zero_copy_;
  ros::NodeHandle node_;
  zero_copy::Publisher<Image> publisher_;
  std::mutex mutex_;
  std::condition_variable acknowledged_changed_;
  uint64_t acknowledged_ = 0;  ///< messages that the listener has had in all
  std::atomic<uint64_t> published_{0};
  ros::Subscriber acks_;
};

class Listener
{
public:
  explicit Listener(bool zero_copy) : ack_(node_.advertise<std_msgs::UInt64>("ack", 100))
  {
    if (zero_copy)
    {
      subscriber_ = node_.subscribe("data", QUEUE_SIZE, &Listener::receive<zero_copy::Message<Image>>, this);
    }
    else
    {
      subscriber_ = node_.subscribe("data", QUEUE_SIZE, &Listener::receive<Image>, this);
    }
  }

  bool obey(const std::string& command, std::istream& words)
  {
    if (command != "expect")
    {
      return false;
    }
    {
      std::lock_guard<std::mutex> lock(mutex_);
      words >> expected_ >> every_;
      latencies_.clear();
      latencies_.reserve(expected_);
    }
    say("{\"event\": \"ready\"}");
    return true;
  }

private:
  template <typename Form>
  void receive(const boost::shared_ptr<Form const>& image)
  {
    const uint64_t arrival = nowNs();
    std::lock_guard<std::mutex> lock(mutex_);
    latencies_.push_back(arrival - (uint64_t{image->height} << 32 | image->width));
    if (image->header.stamp.sec != ++received_)
    {
      complain("is missing: " + std::to_string(image->header.stamp.sec) + " came");
      return;
    }
    for (size_t i = 0; i < image->data.size(); i += PAGE)
    {
      if (image->data[i] != static_cast<uint8_t>(received_))
      {
        complain("is damaged at byte " + std::to_string(i));
        return;
      }
    }
    if (every_ > 0 && latencies_.size() % every_ == 0)
    {
      std_msgs::UInt64 total;
      total.data = received_;
      ack_.publish(total);
    }
    if (latencies_.size() == expected_)
    {
      sayComplete(latencies_);
    }
  }

  void complain(const std::string& what) const
  {
    say("{\"event\": \"error\", \"text\": \"message " + std::to_string(received_) + " " + what + "\"}");
  }

  ros::NodeHandle node_;
  ros::Publisher ack_;
  std::mutex mutex_;
  size_t expected_ = 0;
  size_t every_ = 0;
  uint64_t received_ = 0;  ///< in all
  std::vector<uint64_t> latencies_;
  ros::Subscriber subscriber_;
};

struct FutexPage
{
  std::atomic<uint32_t> turn{0};
  std::atomic<uint64_t> sent_ns{0};
};

int runFloor(size_t count, double rate)
{
  void* const memory = mmap(nullptr, sizeof(FutexPage), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED)
  {
    return 1;
  }
  auto* const page = new (memory) FutexPage;
  auto* const word = reinterpret_cast<uint32_t*>(&page->turn);
  const pid_t child = fork();
  if (child == 0)
  {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    std::vector<uint64_t> latencies;
    for (uint32_t turn = 0; latencies.size() < count; ++turn)
    {
      while (page->turn.load(std::memory_order_acquire) == turn)
      {
        syscall(SYS_futex, word, FUTEX_WAIT, turn, nullptr, nullptr, 0);
      }
      latencies.push_back(nowNs() - page->sent_ns.load(std::memory_order_relaxed));
    }
    sayComplete(latencies);
    _exit(0);
  }
  const uint64_t start = nowNs();
  for (size_t i = 0; i < count; ++i)
  {
    sleepUntilNs(start + static_cast<uint64_t>(static_cast<double>(i + 1) * 1e9 / rate));
    page->sent_ns.store(nowNs(), std::memory_order_relaxed);
    page->turn.fetch_add(1, std::memory_order_release);
    syscall(SYS_futex, word, FUTEX_WAKE, 1, nullptr, nullptr, 0);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

}  // namespace
}  // namespace pi_os_transport_bench

int main(int argc, char** argv)
{
  std::vector<std::string> words;
  ros::removeROSArgs(argc, argv, words);
  words.erase(words.begin());
  if (words.size() >= 3 && words[0] == "floor")
  {
    return pi_os_transport_bench::runFloor(std::stoul(words[1]), std::stod(words[2]));
  }
  if (words.size() < 2 || (words[1] != "stock" && words[1] != "zero_copy"))
  {
    std::cerr
        << "usage: bench_zero_copy_node talker|listener stock|zero_copy, or bench_zero_copy_node floor COUNT RATE\n";
    return 2;
  }
  ros::init(argc, argv, "bench_zero_copy", ros::init_options::AnonymousName);
  if (words[0] == "talker")
  {
    pi_os_transport_bench::Talker talker(words[1] == "zero_copy");
    pi_os_transport_bench::serveCommands(&talker);
  }
  else
  {
    pi_os_transport_bench::Listener listener(words[1] == "zero_copy");
    pi_os_transport_bench::serveCommands(&listener);
  }
  return 0;
}
