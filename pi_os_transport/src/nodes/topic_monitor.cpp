// topic_monitor: reports rate, latency, lost messages, bandwidth and transports of any topics.

#include <XmlRpcClient.h>
#include <ros/network.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>
#include <std_msgs/String.h>
#include <topic_tools/shape_shifter.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "topic_monitor/topic_report.h"

namespace pi_os_transport
{

/// A ShapeShifter with access to its first bytes: the base class only copies whole messages.
struct ObservedMessage : topic_tools::ShapeShifter
{
  std::optional<StampedHeader> first_words;  ///< the header, if the type begins with one
};

}  // namespace pi_os_transport

namespace ros
{
namespace message_traits
{

template <>
struct IsMessage<pi_os_transport::ObservedMessage> : TrueType
{
};
template <>
struct IsMessage<const pi_os_transport::ObservedMessage> : TrueType
{
};
template <>
struct MD5Sum<pi_os_transport::ObservedMessage> : MD5Sum<topic_tools::ShapeShifter>
{
};
template <>
struct DataType<pi_os_transport::ObservedMessage> : DataType<topic_tools::ShapeShifter>
{
};
template <>
struct Definition<pi_os_transport::ObservedMessage> : Definition<topic_tools::ShapeShifter>
{
};

}  // namespace message_traits

namespace serialization
{

template <>
struct Serializer<pi_os_transport::ObservedMessage>
{
  template <typename Stream>
  static void read(Stream& stream, pi_os_transport::ObservedMessage& message)
  {
    message.first_words = pi_os_transport::readHeader(stream.getData(), stream.getLength());
    Serializer<topic_tools::ShapeShifter>::read(stream, message);
  }
};

template <>
struct PreDeserialize<pi_os_transport::ObservedMessage>
{
  static void notify(const PreDeserializeParams<pi_os_transport::ObservedMessage>& params)
  {
    PreDeserializeParams<topic_tools::ShapeShifter> base_params;
    base_params.message = params.message;
    base_params.connection_header = params.connection_header;
    PreDeserialize<topic_tools::ShapeShifter>::notify(base_params);
  }
};

}  // namespace serialization
}  // namespace ros

namespace pi_os_transport
{

namespace
{

struct MonitorOptions
{
  std::vector<std::string> topics;  ///< empty: all topics below topic_namespace
  std::string topic_namespace = "/";
  double period_s = 1.0;  ///< between two tables, and between two searches for new topics
  std::string report;     ///< JSON file written at the end; empty: none
  bool print_table = true;
  int queue_size = 1000;
  bool tcp_nodelay = false;  ///< as in stock subscribers

  static MonitorOptions load(const ros::NodeHandle& node)
  {
    MonitorOptions options;
    const auto get = [&node](const std::string& name, auto* value)
    {
      if (node.hasParam(name) && !node.getParam(name, *value))
      {
        throw std::invalid_argument("parameter " + node.resolveName(name) + " has the wrong type, see README.md");
      }
    };
    std::string list;
    if (node.getParam("topics", list))
    {
      options.topics = parseTopicList(list);
    }
    else
    {
      get("topics", &options.topics);
    }
    get("namespace", &options.topic_namespace);
    get("period_s", &options.period_s);
    get("report", &options.report);
    get("print_table", &options.print_table);
    get("queue_size", &options.queue_size);
    get("tcp_nodelay", &options.tcp_nodelay);
    if (!(options.period_s >= 0.1 && options.period_s <= 3600.0))
    {
      throw std::invalid_argument("period_s = " + std::to_string(options.period_s) + ", must be in [0.1, 3600]");
    }
    if (options.queue_size < 1)
    {
      throw std::invalid_argument("queue_size = " + std::to_string(options.queue_size) + ", must be 1 or more");
    }
    if (options.topic_namespace.empty() || options.topic_namespace.front() != '/')
    {
      throw std::invalid_argument("namespace = \"" + options.topic_namespace + "\", must begin with /");
    }
    if (options.topic_namespace.back() != '/')
    {
      options.topic_namespace += '/';
    }
    return options;
  }
};

/// Everything runs in the thread of ros::spin().
class TopicMonitor
{
public:
  TopicMonitor(ros::NodeHandle node, ros::NodeHandle private_node)
    : node_(std::move(node)), options_(MonitorOptions::load(private_node))
  {
    report_ = private_node.advertise<std_msgs::String>("report", 5, true);
    for (const std::string& topic : options_.topics)
    {
      subscribe(node_.resolveName(topic));
    }
    discover();
    start_ns_ = static_cast<int64_t>(ros::SteadyTime::now().toNSec());
    timer_ = node_.createSteadyTimer(ros::WallDuration(options_.period_s), &TopicMonitor::onPeriod, this);
  }

  void finish()
  {
    if (options_.report.empty())
    {
      return;
    }
    const std::string failure = writeFileAtomically(options_.report, json());
    if (failure.empty())
    {
      ROS_INFO_STREAM_NAMED("monitor", "report written to " << options_.report);
    }
    else
    {
      ROS_ERROR_STREAM_NAMED("monitor", "report not written: " << failure);
    }
  }

private:
  struct Topic
  {
    ros::Subscriber subscriber;
    std::string type;
    std::string definition;
    bool has_header = false;
    TopicStatistics statistics;
    std::map<std::string, size_t> transports;  ///< last known links, kept when they close
  };

  void subscribe(const std::string& name)
  {
    if (topics_.count(name) > 0)
    {
      return;
    }
    Topic& topic = topics_[name];
    ros::SubscribeOptions subscription;
    subscription.initByFullCallbackType<const ros::MessageEvent<ObservedMessage const>&>(
        name, static_cast<uint32_t>(options_.queue_size),
        [this, &topic](const ros::MessageEvent<ObservedMessage const>& event) { onMessage(&topic, event); });
    subscription.transport_hints = ros::TransportHints().tcpNoDelay(options_.tcp_nodelay);
    topic.subscriber = node_.subscribe(subscription);
  }

  /// Without a list of topics: subscribes to topics that appeared since the last call. The master sends no event.
  void discover()
  {
    if (!options_.topics.empty())
    {
      return;
    }
    ros::master::V_TopicInfo published;
    if (!ros::master::getTopics(published))
    {
      ROS_WARN_THROTTLE_NAMED(60, "monitor", "the master does not answer; new topics are not seen");
      return;
    }
    for (const ros::master::TopicInfo& info : published)
    {
      if (info.name.rfind(options_.topic_namespace, 0) == 0 && info.name != report_.getTopic())
      {
        subscribe(info.name);
      }
    }
  }

  void onMessage(Topic* topic, const ros::MessageEvent<ObservedMessage const>& event)
  {
    const auto arrival_ns = static_cast<int64_t>(ros::SteadyTime::now().toNSec());
    // With /use_sim_time this is the simulated clock, like the stamps.
    const ros::Time now = ros::Time::now();
    const ObservedMessage& message = *event.getConstMessage();
    if (topic->definition != message.getMessageDefinition())
    {
      topic->definition = message.getMessageDefinition();
      topic->type = message.getDataType();
      topic->has_header = beginsWithHeader(topic->definition);
    }
    std::optional<uint32_t> seq;
    std::optional<int64_t> age_ns;
    if (topic->has_header && message.first_words)
    {
      seq = message.first_words->seq;
      if (message.first_words->stamp_ns != 0)
      {
        age_ns = static_cast<int64_t>(now.toNSec()) - message.first_words->stamp_ns;
      }
    }
    // Each connection has its own header object. Holding the object keeps its address unique.
    const boost::shared_ptr<ros::M_string>& connection = event.getConnectionHeaderPtr();
    const uint64_t id = connections_.try_emplace(connection, connections_.size()).first->second;
    topic->statistics.record(arrival_ns, message.size(), age_ns, seq, event.getPublisherName(), id);
  }

  /// Asks this node's slave API for the transports of its links, like `rosnode info`.
  void updateTransports()
  {
    std::string host;
    uint32_t port = 0;
    if (!ros::network::splitURI(ros::XMLRPCManager::instance()->getServerURI(), host, port))
    {
      return;
    }
    XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
    XmlRpc::XmlRpcValue request;
    request[0] = ros::this_node::getName();
    XmlRpc::XmlRpcValue response;
    // Elements: [id, peer, direction, transport, topic, connected, text]
    if (!client.execute("getBusInfo", request, response) || response.getType() != XmlRpc::XmlRpcValue::TypeArray ||
        response.size() != 3 || response[2].getType() != XmlRpc::XmlRpcValue::TypeArray)
    {
      return;
    }
    std::map<std::string, std::map<std::string, size_t>> transports;
    XmlRpc::XmlRpcValue& links = response[2];
    for (int i = 0; i < links.size(); ++i)
    {
      XmlRpc::XmlRpcValue& link = links[i];
      if (link.getType() == XmlRpc::XmlRpcValue::TypeArray && link.size() >= 5 &&
          link[2].getType() == XmlRpc::XmlRpcValue::TypeString && std::string(link[2]) == "i")
      {
        ++transports[std::string(link[4])][std::string(link[3])];
      }
    }
    for (auto& [name, links_by_transport] : transports)
    {
      const auto topic = topics_.find(name);
      if (topic != topics_.end())
      {
        topic->second.transports = links_by_transport;
      }
    }
  }

  void onPeriod(const ros::SteadyTimerEvent&)
  {
    discover();
    updateTransports();
    const auto now_ns = static_cast<int64_t>(ros::SteadyTime::now().toNSec());
    std::vector<TopicReport> reports;
    for (auto& [name, topic] : topics_)
    {
      reports.push_back({name, topic.type, topic.transports, topic.statistics.takeWindow(now_ns)});
      reports.back().figures.messages = topic.statistics.total().messages;
    }
    if (options_.print_table)
    {
      std::cout << "\n" + formatTable(reports) << std::flush;
    }
    std_msgs::String message;
    message.data = json();
    report_.publish(message);
  }

  std::string json() const
  {
    std::vector<TopicReport> reports;
    for (const auto& [name, topic] : topics_)
    {
      reports.push_back({name, topic.type, topic.transports, topic.statistics.total()});
    }
    const int64_t span_ns = static_cast<int64_t>(ros::SteadyTime::now().toNSec()) - start_ns_;
    return formatJson(ros::this_node::getName(), static_cast<double>(span_ns) * 1e-9, reports);
  }

  ros::NodeHandle node_;
  const MonitorOptions options_;
  ros::Publisher report_;
  ros::SteadyTimer timer_;
  std::map<std::string, Topic> topics_;  ///< entries never move: callbacks hold pointers to them
  std::map<boost::shared_ptr<ros::M_string>, uint64_t> connections_;
  int64_t start_ns_ = 0;
};

}  // namespace

}  // namespace pi_os_transport

int main(int argc, char** argv)
{
  ros::init(argc, argv, "topic_monitor");
  const ros::NodeHandle node;  // logging needs a handle until the end
  try
  {
    pi_os_transport::TopicMonitor monitor(node, ros::NodeHandle("~"));
    ros::spin();
    monitor.finish();
    return 0;
  }
  catch (const std::exception& exception)
  {
    ROS_FATAL_STREAM_NAMED("monitor", exception.what());
    return 1;
  }
}
