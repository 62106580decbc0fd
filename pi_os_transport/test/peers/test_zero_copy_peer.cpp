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
#include <deque>
#include <functional>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "pi_os_transport/zero_copy/publisher.h"
#include "pi_os_transport/zero_copy/subscriber.h"

#include "peers/message_pattern.h"
#include "peers/peer_verbs.h"

namespace
{
namespace zero_copy = pi_os_transport::zero_copy;
using sensor_msgs::Image;
using Clock = std::chrono::steady_clock;

class Node
{
public:
  static const Verbs<Node> VERBS;

  ~Node()
  {
    stop_ = true;
    if (job_.joinable())
    {
      job_.join();
    }
  }

private:
  bool advertise(const Command& c, JsonObject*)
  {
    id_ = static_cast<uint32_t>(c.integer("id", 1));
    publisher_ = zero_copy::Publisher<Image>(node_, c.text("topic"), static_cast<uint32_t>(c.integer("queue", 100)),
                                             c.integer("latch", 0) != 0);
    return static_cast<bool>(publisher_);
  }

  zero_copy::Loan<Image> fill(uint64_t seq, size_t bytes) const
  {
    zero_copy::Loan<Image> image = publisher_.borrow();
    fillImage(id_, seq, bytes, &*image);
    return image;
  }

  bool publish(const Command& c, JsonObject* report)
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
  bool join(const Command&, JsonObject*)
  {
    stop_ = true;
    job_.join();
    stop_ = false;
    return true;
  }
  bool awaitSubscribers(const Command& c, JsonObject*)
  {
    const uint32_t wanted = static_cast<uint32_t>(c.integer("n", 1));
    return awaitState(c.deadline(), [&] { return publisher_.getNumSubscribers() == wanted; });
  }
  bool unadvertise(const Command&, JsonObject*)
  {
    publisher_.shutdown();
    return true;
  }

  bool borrow(const Command& c, JsonObject*)
  {
    for (long i = 0; i < c.integer("count", 1); ++i)
    {
      loans_.push_back(fill(++last_, static_cast<size_t>(c.integer("size", 100000))));
    }
    return true;
  }
  bool publishLoans(const Command&, JsonObject*)
  {
    for (zero_copy::Loan<Image>& loan : loans_)
    {
      publisher_.publish(std::move(loan));
    }
    loans_.clear();
    return true;
  }
  bool dropLoans(const Command&, JsonObject*)
  {
    loans_.clear();
    return true;
  }

  bool subscribe(const Command& c, JsonObject*)
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

  void describe(JsonObject* report) const
  {
    report->number("received", received_).number("corrupt", corrupt_).number("views", views_);
    report->number("reordered", reordered_).number("highest", highest_).number("held", held_.size());
  }
  bool awaitReceived(const Command& c, JsonObject* report)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    const uint64_t seq = static_cast<uint64_t>(c.integer("seq", 0));
    const uint64_t n = static_cast<uint64_t>(c.integer("n", 0));
    const bool reached = changed_.wait_until(lock, c.deadline(), [&]() { return highest_ >= seq && received_ >= n; });
    describe(report);
    return reached;
  }
  bool checkHeld(const Command&, JsonObject* report)
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
  bool dropHeld(const Command&, JsonObject*)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    held_.clear();
    return true;
  }
  bool unsubscribe(const Command&, JsonObject*)
  {
    subscriber_.shutdown();
    return true;
  }
  bool shutdownRos(const Command&, JsonObject*)
  {
    ros::shutdown();
    return true;
  }

  bool statistics(const Command&, JsonObject* report)
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

const Verbs<Node> Node::VERBS = {
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

}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "test_zero_copy_peer");
  Node node;
  ros::AsyncSpinner spinner(argc > 1 ? static_cast<uint32_t>(std::stoul(argv[1])) : 1);
  spinner.start();
  // Not until ros::ok() is false: the judge looks at messages that outlive the node.
  serveCommands(ros::this_node::getName(), Node::VERBS, &node, [] { return true; });
  ros::shutdown();
  return 0;
}
