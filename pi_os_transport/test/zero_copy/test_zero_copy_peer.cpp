// A node that publishes and receives sensor_msgs/Image through the zero-copy API, steered as test_peer.cpp is and with
// the same content, so that each can judge the other: commands on stdin, answers as lines of JSON behind '@' on stdout.
//
//   verb key=value key=value ...        ->  @{"reply":"verb","ok":true,...}
//
// The node ends at "exit", at the end of stdin (the judge died) and at a signal.

#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <deque>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "pi_os_transport/zero_copy/publisher.h"
#include "pi_os_transport/zero_copy/subscriber.h"

namespace
{
namespace zero_copy = pi_os_transport::zero_copy;
using sensor_msgs::Image;
using Clock = std::chrono::steady_clock;

constexpr auto POLL_INTERVAL = std::chrono::milliseconds(5);  ///< the number of subscribers is signalled by no event

/// As in test_peer.cpp.
uint64_t patternWord(uint32_t id, uint64_t seq, uint64_t index)
{
  return ((static_cast<uint64_t>(id) << 40) + (seq << 20) + index + 1) * 0x9E3779B97F4A7C15ull;
}

void fillPattern(uint32_t id, uint64_t seq, uint8_t* data, size_t bytes)
{
  for (size_t i = 0; 8 * i < bytes; ++i)
  {
    const uint64_t word = patternWord(id, seq, i);
    std::memcpy(data + 8 * i, &word, std::min<size_t>(8, bytes - 8 * i));
  }
}

bool isIntact(const zero_copy::Message<Image>& image)
{
  bool same = image.step == image.data.size() && image.encoding == "8UC1" && image.header.frame_id == "pi_os_test";
  for (size_t i = 0; same && 8 * i < image.data.size(); ++i)
  {
    const uint64_t word = patternWord(image.height, image.width, i);
    same = std::memcmp(image.data.data() + 8 * i, &word, std::min<size_t>(8, image.data.size() - 8 * i)) == 0;
  }
  return same;
}

class Command
{
public:
  explicit Command(const std::string& line)
  {
    std::istringstream in(line);
    in >> verb_;
    for (std::string token; in >> token;)
    {
      const size_t equal = token.find('=');
      if (equal == std::string::npos)
      {
        throw std::invalid_argument("argument \"" + token + "\" of " + verb_ + " is not key=value");
      }
      values_[token.substr(0, equal)] = token.substr(equal + 1);
    }
  }
  const std::string& verb() const { return verb_; }
  std::string text(const std::string& key, const std::string& fallback = "") const
  {
    const auto found = values_.find(key);
    return found != values_.end() ? found->second : fallback;
  }
  long integer(const std::string& key, long fallback) const
  {
    return values_.count(key) != 0 ? std::stol(text(key)) : fallback;
  }
  Clock::time_point deadline() const { return Clock::now() + std::chrono::seconds(integer("timeout", 30)); }

private:
  std::string verb_;
  std::map<std::string, std::string> values_;
};

/// Numbers by name, as JSON.
class Report
{
public:
  Report& number(const std::string& key, uint64_t value)
  {
    body_ += ",\"" + key + "\":" + std::to_string(value);
    return *this;
  }
  std::string json(const std::string& verb, bool ok) const
  {
    return "{\"reply\":\"" + verb + "\",\"ok\":" + (ok ? "true" : "false") + body_ + "}";
  }

private:
  std::string body_;
};

class Node
{
public:
  bool execute(const Command& c, Report* report)
  {
    using Verb = bool (Node::*)(const Command&, Report*);
    static const std::map<std::string, Verb> VERBS = {
        {"advertise", &Node::advertise},
        {"publish", &Node::publish},
        {"join", &Node::join},
        {"await_subscribers", &Node::awaitSubscribers},
        {"unadvertise", &Node::unadvertise},
        {"borrow", &Node::borrow},
        {"publish_loans", &Node::publishLoans},
        {"drop_loans", &Node::dropLoans},
        {"subscribe", &Node::subscribe},
        {"await_received", &Node::awaitReceived},
        {"check_held", &Node::checkHeld},
        {"drop_held", &Node::dropHeld},
        {"unsubscribe", &Node::unsubscribe},
        {"shutdown_ros", &Node::shutdownRos},
        {"statistics", &Node::statistics},
    };
    const auto found = VERBS.find(c.verb());
    if (found == VERBS.end())
    {
      throw std::invalid_argument("unknown verb \"" + c.verb() + "\"");
    }
    return (this->*found->second)(c, report);
  }

  ~Node()
  {
    stop_ = true;
    if (job_.joinable())
    {
      job_.join();
    }
  }

private:
  bool advertise(const Command& c, Report*)
  {
    id_ = static_cast<uint32_t>(c.integer("id", 1));
    publisher_ = zero_copy::Publisher<Image>(node_, c.text("topic"), static_cast<uint32_t>(c.integer("queue", 100)),
                                             c.integer("latch", 0) != 0);
    return static_cast<bool>(publisher_);
  }

  zero_copy::Loan<Image> fill(uint64_t seq, size_t bytes) const
  {
    zero_copy::Loan<Image> image = publisher_.borrow();
    image->data.resize(bytes);
    fillPattern(id_, seq, image->data.data(), bytes);
    image->header.frame_id = "pi_os_test";
    image->height = id_;
    image->width = static_cast<uint32_t>(seq);
    image->step = static_cast<uint32_t>(bytes);
    image->encoding = "8UC1";
    return image;
  }

  bool publish(const Command& c, Report* report)
  {
    std::vector<size_t> sizes;
    std::istringstream in(c.text("sizes", "64"));
    for (std::string size; std::getline(in, size, ',');)
    {
      sizes.push_back(std::stoul(size));
    }
    const uint64_t count = static_cast<uint64_t>(c.integer("count", 1));
    const long rate = c.integer("rate", 0);
    const auto job = [this, sizes, count, rate]()
    {
      auto next = Clock::now();
      for (uint64_t sent = 0; !stop_ && (count == 0 || sent < count); ++sent)
      {
        ++last_;
        publisher_.publish(fill(last_, sizes[last_ % sizes.size()]));
        if (rate > 0)
        {
          next += std::chrono::nanoseconds(1000000000 / rate);
          std::this_thread::sleep_until(next);
        }
      }
    };
    if (c.integer("background", 0) != 0)
    {
      job_ = std::thread(job);
      return true;
    }
    job();
    return statistics(c, report);
  }
  bool join(const Command&, Report*)
  {
    stop_ = true;
    job_.join();
    stop_ = false;
    return true;
  }
  bool awaitSubscribers(const Command& c, Report*)
  {
    const uint32_t wanted = static_cast<uint32_t>(c.integer("n", 1));
    while (publisher_.getNumSubscribers() != wanted)
    {
      if (Clock::now() > c.deadline())
      {
        return false;
      }
      std::this_thread::sleep_for(POLL_INTERVAL);
    }
    return true;
  }
  bool unadvertise(const Command&, Report*)
  {
    publisher_.shutdown();
    return true;
  }

  bool borrow(const Command& c, Report*)
  {
    for (long i = 0; i < c.integer("count", 1); ++i)
    {
      loans_.push_back(fill(++last_, static_cast<size_t>(c.integer("size", 100000))));
    }
    return true;
  }
  bool publishLoans(const Command&, Report*)
  {
    for (zero_copy::Loan<Image>& loan : loans_)
    {
      publisher_.publish(std::move(loan));
    }
    loans_.clear();
    return true;
  }
  bool dropLoans(const Command&, Report*)
  {
    loans_.clear();
    return true;
  }

  bool subscribe(const Command& c, Report*)
  {
    hold_ = static_cast<size_t>(c.integer("hold", 0));
    const auto receive = [this](const zero_copy::ConstPtr<Image>& image)
    {
      const bool intact = isIntact(*image);
      std::lock_guard<std::mutex> lock(mutex_);
      ++received_;
      corrupt_ += intact ? 0 : 1;
      views_ += zero_copy::isView(image->data) ? 1 : 0;
      reordered_ += image->width <= highest_ ? 1 : 0;
      highest_ = std::max<uint64_t>(highest_, image->width);
      if (held_.size() < hold_)
      {
        held_.push_back(image);
      }
      changed_.notify_all();
    };
    subscriber_ =
        node_.subscribe<zero_copy::Message<Image>>(c.text("topic"), static_cast<uint32_t>(c.integer("queue", 100)),
                                                   boost::function<void(const zero_copy::ConstPtr<Image>&)>(receive));
    return static_cast<bool>(subscriber_);
  }

  void describe(Report* report) const
  {
    report->number("received", received_).number("corrupt", corrupt_).number("views", views_);
    report->number("reordered", reordered_).number("highest", highest_).number("held", held_.size());
  }
  bool awaitReceived(const Command& c, Report* report)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    const uint64_t seq = static_cast<uint64_t>(c.integer("seq", 0));
    const uint64_t n = static_cast<uint64_t>(c.integer("n", 0));
    const bool reached = changed_.wait_until(lock, c.deadline(), [&]() { return highest_ >= seq && received_ >= n; });
    describe(report);
    return reached;
  }
  bool checkHeld(const Command&, Report* report)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    uint64_t intact = 0;
    uint64_t views = 0;
    for (const zero_copy::ConstPtr<Image>& image : held_)
    {
      intact += isIntact(*image) ? 1 : 0;
      views += zero_copy::isView(image->data) ? 1 : 0;
    }
    report->number("held", held_.size()).number("intact", intact).number("views", views);
    return true;
  }
  bool dropHeld(const Command&, Report*)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    held_.clear();
    return true;
  }
  bool unsubscribe(const Command&, Report*)
  {
    subscriber_.shutdown();
    return true;
  }
  bool shutdownRos(const Command&, Report*)
  {
    ros::shutdown();
    return true;
  }

  bool statistics(const Command&, Report* report)
  {
    zero_copy::TopicStatistics sum;
    for (const zero_copy::TopicStatistics& topic : zero_copy::statistics())
    {
      sum.in_place += topic.in_place;
      sum.small += topic.small;
      sum.no_room += topic.no_room;
      sum.from_heap += topic.from_heap;
      sum.viewed += topic.viewed;
      sum.copied += topic.copied;
      sum.misaligned += topic.misaligned;
      sum.without_large += topic.without_large;
    }
    report->number("in_place", sum.in_place).number("small", sum.small).number("no_room", sum.no_room);
    report->number("from_heap", sum.from_heap).number("viewed", sum.viewed).number("copied", sum.copied);
    report->number("misaligned", sum.misaligned).number("without_large", sum.without_large);
    return true;
  }

  ros::NodeHandle node_;
  uint32_t id_ = 1;
  uint64_t last_ = 0;  ///< number of the newest message; of one thread at a time
  zero_copy::Publisher<Image> publisher_;
  std::deque<zero_copy::Loan<Image>> loans_;
  std::thread job_;
  std::atomic<bool> stop_{false};

  std::mutex mutex_;
  std::condition_variable changed_;
  size_t hold_ = 0;
  std::vector<zero_copy::ConstPtr<Image>> held_;
  uint64_t received_ = 0;
  uint64_t corrupt_ = 0;
  uint64_t views_ = 0;
  uint64_t reordered_ = 0;
  uint64_t highest_ = 0;
  ros::Subscriber subscriber_;
};

void answer(const std::string& json)
{
  const std::string line = "@" + json + "\n";
  std::fwrite(line.data(), 1, line.size(), stdout);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "test_zero_copy_peer");
  Node node;
  ros::AsyncSpinner spinner(argc > 1 ? static_cast<uint32_t>(std::stoul(argv[1])) : 1);
  spinner.start();
  answer(Report().json("ready", true));
  for (std::string line; std::getline(std::cin, line) && line != "exit";)
  {
    Report report;
    try
    {
      const Command command(line);
      const bool ok = node.execute(command, &report);
      answer(report.json(command.verb(), ok));
    }
    catch (const std::exception& error)
    {
      std::cerr << line << ": " << error.what() << std::endl;
      answer(report.json("error", false));
    }
  }
  ros::shutdown();
  return 0;
}
