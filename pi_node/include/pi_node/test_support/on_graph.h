#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Log.h>
#include <sys/types.h>
#include <xmlrpcpp/XmlRpcClient.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_node::test_support
{

/// Longest that a test waits for what must come [s].
constexpr double TIMEOUT_S = 30.0;

/// Asks again and again. @return true once it holds.
inline bool until(double timeout_s, const std::function<bool()>& condition)
{
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  while (std::chrono::steady_clock::now() < deadline)
  {
    if (condition())
    {
      return true;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return condition();
}

/// Process of a node; 0 if it does not answer.
inline pid_t processOf(const std::string& node)
{
  XmlRpc::XmlRpcValue request, response, payload;
  request[0] = ros::this_node::getName();
  request[1] = node;
  std::string host;
  uint32_t port = 0;
  if (!ros::master::execute("lookupNode", request, response, payload, false) ||
      !ros::network::splitURI(payload, host, port))
  {
    return 0;
  }
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  XmlRpc::XmlRpcValue caller, pid;
  caller[0] = ros::this_node::getName();
  return client.execute("getPid", caller, pid) ? static_cast<int>(pid[2]) : 0;
}

/// Keeps what comes on a topic.
template <typename Message>
class Collector
{
public:
  explicit Collector(const std::string& topic, uint32_t queue_size = 1000)
  {
    subscriber_ = ros::NodeHandle().subscribe<Message>(
        topic, queue_size,
        [this](const boost::shared_ptr<const Message>& message)
        {
          std::lock_guard<std::mutex> lock(mutex_);
          messages_.push_back(message);
          changed_.notify_all();
        },
        ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  }
  ~Collector() { subscriber_.shutdown(); }
  Collector(const Collector&) = delete;
  Collector& operator=(const Collector&) = delete;

  std::vector<boost::shared_ptr<const Message>> messages() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return messages_;
  }
  boost::shared_ptr<const Message> last() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return messages_.empty() ? nullptr : messages_.back();
  }
  size_t count() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return messages_.size();
  }
  void clear()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    messages_.clear();
  }
  uint32_t publishers() const { return subscriber_.getNumPublishers(); }
  bool waitForPublisher() const
  {
    return until(TIMEOUT_S, [this] { return publishers() > 0; });
  }

  /// @return true once a message fits, also one that came before.
  bool waitFor(const std::function<bool(const Message&)>& fits, double timeout_s = TIMEOUT_S) const
  {
    std::unique_lock<std::mutex> lock(mutex_);
    size_t looked_at = 0;
    return changed_.wait_for(lock, std::chrono::duration<double>(timeout_s),
                             [&]
                             {
                               for (; looked_at < messages_.size(); ++looked_at)
                               {
                                 if (fits(*messages_[looked_at]))
                                 {
                                   return true;
                                 }
                               }
                               return false;
                             });
  }
  bool waitForStamp(const ros::Time& stamp) const
  {
    return waitFor([&stamp](const Message& message) { return message.header.stamp == stamp; });
  }

private:
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  std::vector<boost::shared_ptr<const Message>> messages_;
  ros::Subscriber subscriber_;
};

/// What nodes log.
class LogCollector : public Collector<rosgraph_msgs::Log>
{
public:
  LogCollector() : Collector("/rosout") {}
  /// Waits until a node is heard beside this process itself.
  bool waitForNode(double timeout_s = TIMEOUT_S) const
  {
    return until(timeout_s, [this] { return publishers() >= 2; });
  }
  bool waitForText(const std::string& part, double timeout_s = TIMEOUT_S) const
  {
    return waitFor([&part](const rosgraph_msgs::Log& log) { return log.msg.find(part) != std::string::npos; },
                   timeout_s);
  }
  /// All of it, for the message of a failed test.
  std::string text() const
  {
    std::string text = "logged:\n";
    for (const auto& log : messages())
    {
      text += "  " + log->name + ": " + log->msg + "\n";
    }
    return text;
  }
};

/// What nodes say in the diagnostics.
class DiagnosticCollector : public Collector<diagnostic_msgs::DiagnosticArray>
{
public:
  using Status = diagnostic_msgs::DiagnosticStatus;

  DiagnosticCollector() : Collector("/diagnostics") {}

  /// @param name  end of the status' name, as "detection". @param part  of its summary.
  bool waitForSummary(const std::string& name, int level, const std::string& part) const
  {
    return waitForStatus(name, [level, &part](const Status& status)
                         { return status.level == level && status.message.find(part) != std::string::npos; });
  }
  bool waitForValue(const std::string& name, const std::string& key, const std::string& value) const
  {
    return waitForStatus(name,
                         [&key, &value](const Status& status)
                         {
                           for (const diagnostic_msgs::KeyValue& pair : status.values)
                           {
                             if (pair.key == key && pair.value == value)
                             {
                               return true;
                             }
                           }
                           return false;
                         });
  }
  bool waitForStatus(const std::string& name, const std::function<bool(const Status&)>& fits) const
  {
    return waitFor(
        [&name, &fits](const diagnostic_msgs::DiagnosticArray& array)
        {
          for (const Status& status : array.status)
          {
            if (status.name.size() >= name.size() &&
                status.name.compare(status.name.size() - name.size(), name.size(), name) == 0 && fits(status))
            {
              return true;
            }
          }
          return false;
        });
  }
  /// The newest of each, for the message of a failed test.
  std::string text() const
  {
    std::map<std::string, std::string> newest;
    for (const auto& array : messages())
    {
      for (const Status& status : array->status)
      {
        newest[status.name] = std::to_string(status.level) + " " + status.message;
      }
    }
    std::string text = "diagnosed:\n";
    for (const auto& [name, summary] : newest)
    {
      text += "  " + name + ": " + summary + "\n";
    }
    return text;
  }
};

inline bool loadNodelet(const std::string& name, const std::string& type)
{
  nodelet::NodeletLoad request;
  request.request.name = name;
  request.request.type = type;
  return ros::service::waitForService("/manager/load_nodelet", ros::Duration(TIMEOUT_S)) &&
         ros::service::call("/manager/load_nodelet", request) && request.response.success != 0;
}

inline bool unloadNodelet(const std::string& name)
{
  nodelet::NodeletUnload request;
  request.request.name = name;
  return ros::service::call("/manager/unload_nodelet", request) && request.response.success != 0;
}

/// main() of a test that is a node.
inline int runOnGraph(int argc, char** argv, const std::string& name)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, name);
  ros::NodeHandle node;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}

}  // namespace pi_node::test_support
