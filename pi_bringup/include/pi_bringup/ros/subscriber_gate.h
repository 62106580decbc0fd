#pragma once

#include <ros/ros.h>

#include <condition_variable>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

namespace pi_bringup
{

/// Holds playback back until the subscribers it is meant for are connected. It learns of them from roscpp's connect
/// callbacks, so it needs a thread that serves the callback queue of the node handle. Thread safe.
class SubscriberGate
{
public:
  /// Advertises a topic that the gate knows about.
  /// @param in_wildcard whether the condition "*" means this topic too.
  template <typename Message>
  ros::Publisher advertise(ros::NodeHandle& node, const std::string& topic, uint32_t queue_size,
                           bool in_wildcard = true)
  {
    addTopic(topic, in_wildcard);
    return node.advertise<Message>(
        topic, queue_size,
        [this, topic](const ros::SingleSubscriberPublisher& link) { connected(topic, link.getSubscriberName()); },
        [this, topic](const ros::SingleSubscriberPublisher& link) { disconnected(topic, link.getSubscriberName()); });
  }

  /// Sets what wait() waits for, after the last advertise().
  /// @param conditions "topic" (any subscriber) or "topic /node" (this one); topic "*": every one in the wildcard.
  /// @throws std::invalid_argument for an empty condition or a topic that was not advertised.
  void require(const std::vector<std::string>& conditions);

  /// Blocks until all conditions hold, and logs every five seconds which do not. @return false after stop().
  bool wait();

  /// Ends wait(). Any thread.
  void stop();

private:
  struct Condition
  {
    std::string topic;
    std::string node;  ///< empty: any
  };

  void addTopic(const std::string& topic, bool in_wildcard);
  void connected(const std::string& topic, const std::string& node);
  void disconnected(const std::string& topic, const std::string& node);
  /// What is not yet there, as text; empty if nothing is missing. Caller holds the mutex.
  std::string missing() const;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, std::multiset<std::string>> subscribers_;  ///< by topic as given to advertise()
  std::vector<std::string> wildcard_;                              ///< topics that "*" stands for
  std::vector<Condition> conditions_;
  bool stopped_ = false;
};

}  // namespace pi_bringup
