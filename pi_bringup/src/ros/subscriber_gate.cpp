#include <pi_bringup/ros/subscriber_gate.h>

#include <chrono>
#include <sstream>
#include <stdexcept>

namespace pi_bringup
{

void SubscriberGate::addTopic(const std::string& topic, bool in_wildcard)
{
  std::lock_guard<std::mutex> lock(mutex_);
  subscribers_[topic];
  if (in_wildcard)
  {
    wildcard_.push_back(topic);
  }
}

void SubscriberGate::require(const std::vector<std::string>& conditions)
{
  std::lock_guard<std::mutex> lock(mutex_);
  conditions_.clear();
  for (const std::string& text : conditions)
  {
    std::istringstream words(text);
    Condition condition;
    words >> condition.topic >> condition.node;
    if (condition.topic.empty())
    {
      throw std::invalid_argument("wait_for_subscribers: empty entry, expected \"topic\" or \"topic /node\"");
    }
    if (condition.topic == "*")
    {
      for (const std::string& topic : wildcard_)
      {
        conditions_.push_back({topic, condition.node});
      }
    }
    else if (subscribers_.count(condition.topic) == 0)
    {
      std::string known;
      for (const auto& [topic, nodes] : subscribers_)
      {
        known += " " + topic;
      }
      throw std::invalid_argument("wait_for_subscribers: \"" + condition.topic +
                                  "\" is not published; there are:" + known);
    }
    else
    {
      conditions_.push_back(condition);
    }
  }
}

bool SubscriberGate::wait()
{
  std::unique_lock<std::mutex> lock(mutex_);
  const auto ready = [this] { return stopped_ || missing().empty(); };
  while (!changed_.wait_for(lock, std::chrono::seconds(5), ready))
  {
    ROS_INFO_STREAM_NAMED("gate", "still waiting for subscribers:" << missing());
  }
  return !stopped_;
}

void SubscriberGate::stop()
{
  std::lock_guard<std::mutex> lock(mutex_);
  stopped_ = true;
  changed_.notify_all();
}

void SubscriberGate::connected(const std::string& topic, const std::string& node)
{
  std::lock_guard<std::mutex> lock(mutex_);
  subscribers_[topic].insert(node);
  changed_.notify_all();
}

void SubscriberGate::disconnected(const std::string& topic, const std::string& node)
{
  std::lock_guard<std::mutex> lock(mutex_);
  std::multiset<std::string>& nodes = subscribers_[topic];
  const auto link = nodes.find(node);
  if (link != nodes.end())
  {
    nodes.erase(link);
  }
}

std::string SubscriberGate::missing() const
{
  std::string text;
  for (const Condition& condition : conditions_)
  {
    const std::multiset<std::string>& nodes = subscribers_.at(condition.topic);
    if (condition.node.empty() ? nodes.empty() : nodes.count(condition.node) == 0)
    {
      text += " " + condition.topic + (condition.node.empty() ? std::string() : " of " + condition.node);
    }
  }
  return text;
}

}  // namespace pi_bringup
