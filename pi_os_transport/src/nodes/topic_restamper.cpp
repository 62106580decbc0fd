// topic_restamper: passes on the topics of a bag that `rosbag play` plays, with stamps of now, as live sensors would
// send.
//
// It starts the playback once the subscribers that it is told to wait for are connected. A looped bag looks like one
// long recording: the stamps of each lap go on where the last lap ended.

#include <ros/ros.h>
#include <std_msgs/String.h>
#include <std_srvs/SetBool.h>
#include "topic_monitor/topic_statistics.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "topic_monitor/topic_statistics.h"
#include "topic_restamper/stamp_map.h"

namespace pi_os_transport
{

/// Any message as its bytes.
struct RawMessage
{
  std::vector<uint8_t> bytes;

  int64_t stampAt(size_t position) const
  {
    uint32_t words[2] = {};
    std::memcpy(words, bytes.data() + position, sizeof(words));
    return int64_t{words[0]} * 1000000000 + words[1];
  }
  void setStampAt(size_t position, int64_t stamp_ns)
  {
    const uint32_t words[2] = {static_cast<uint32_t>(stamp_ns / 1000000000),
                               static_cast<uint32_t>(stamp_ns % 1000000000)};
    std::memcpy(bytes.data() + position, words, sizeof(words));
  }
};

}  // namespace pi_os_transport

namespace ros
{
namespace message_traits
{

// What a subscriber takes any type with; the publisher gets those of the bag in its AdvertiseOptions.
template <>
struct MD5Sum<pi_os_transport::RawMessage>
{
  static const char* value() { return "*"; }
  static const char* value(const pi_os_transport::RawMessage&) { return "*"; }
};
template <>
struct DataType<pi_os_transport::RawMessage>
{
  static const char* value() { return "*"; }
  static const char* value(const pi_os_transport::RawMessage&) { return "*"; }
};

}  // namespace message_traits

namespace serialization
{

template <>
struct Serializer<pi_os_transport::RawMessage>
{
  template <typename Stream>
  static void read(Stream& stream, pi_os_transport::RawMessage& message)
  {
    message.bytes.assign(stream.getData(), stream.getData() + stream.getLength());
  }
  template <typename Stream>
  static void write(Stream& stream, const pi_os_transport::RawMessage& message)
  {
    std::memcpy(stream.advance(serializedLength(message)), message.bytes.data(), message.bytes.size());
  }
  static uint32_t serializedLength(const pi_os_transport::RawMessage& message)
  {
    return static_cast<uint32_t>(message.bytes.size());
  }
};

}  // namespace serialization
}  // namespace ros

namespace pi_os_transport
{

namespace
{

constexpr size_t HEADER_STAMP_AT = 4;  ///< behind header.seq
constexpr size_t TF_STAMP_AT = 8;      ///< of the first transform: behind the number of transforms and its header.seq
constexpr uint32_t QUEUE_SIZE = 200;
const char* const BORDER_TOPIC = "recording_border";  // std_msgs/Bool: true at the begin, false at the end
const ros::WallDuration POLL(0.1);                    // the parameter server tells nobody of what is new
const ros::WallDuration LINGER(0.5);                  // a node that shuts down drops what is still in its queues

/// @throws std::invalid_argument if the parameter is set, but not to a value of this type.
template <typename Value>
Value parameter(const ros::NodeHandle& node, const std::string& name, Value value)
{
  if (node.hasParam(name) && !node.getParam(name, value))
  {
    throw std::invalid_argument("parameter " + node.resolveName(name) + " has the wrong type, see README.md");
  }
  return value;
}

/// Everything runs in the thread of ros::spin().
class TopicRestamper
{
public:
  explicit TopicRestamper(const ros::NodeHandle& private_node)
    : recording_(parameter<std::string>(private_node, "recording", "recording"))
    , prefix_(parameter<std::string>(private_node, "prefix", "/recorded"))
    , loop_(parameter(private_node, "loop", false))
    , exit_when_done_(parameter(private_node, "exit_when_done", true))
    , wait_for_(parameter(private_node, "wait_for_subscribers", std::vector<std::string>()))
    , stamps_(parameter(private_node, "stamp_at_handover", false))
    , status_(ros::NodeHandle(private_node).advertise<std_msgs::String>("status", 5, true))
  {
    publishStatus("waiting");
    timer_ =
        node_.createWallTimer(POLL, [this](const ros::WallTimerEvent&) { topics_.empty() ? advertise() : start(); });
  }

private:
  struct Topic
  {
    bool counted = false;  ///< sensor topics are; not what is latched, and not tf
    size_t stamp_at = 0;   ///< position of the stamp in the message; 0: none
    ros::Subscriber subscriber;
    ros::Publisher publisher;
    std::map<std::string, int> subscribers;  ///< links by name of the node
    uint64_t published = 0;
  };

  /// Reads what the player wrote to the parameter server before it started, if it has.
  void advertise()
  {
    XmlRpc::XmlRpcValue topics;
    if (node_.getParam(recording_ + "/topics", topics) && topics.getType() == XmlRpc::XmlRpcValue::TypeArray)
    {
      for (int i = 0; i < topics.size(); ++i)
      {
        add(topics[i]);
      }
      missingLinks();  // checks the names
    }
  }

  void add(XmlRpc::XmlRpcValue& description)
  {
    const std::string full_name = description["topic"];
    const std::string type = description["type"];
    const std::string definition = description["definition"];
    const bool latching = static_cast<int>(description["latching"]) != 0;
    const bool is_tf = type == "tf2_msgs/TFMessage";
    const bool has_header = beginsWithHeader(definition);
    Topic& topic = topics_[full_name.substr(1)];
    topic.stamp_at = has_header ? HEADER_STAMP_AT : is_tf && !latching ? TF_STAMP_AT : 0;
    topic.counted = has_header && !latching;
    if (full_name.substr(1) != BORDER_TOPIC)
    {
      ros::AdvertiseOptions advertisement(
          is_tf ? full_name : full_name.substr(1), QUEUE_SIZE, description["md5sum"], type, definition,
          [&topic](const ros::SingleSubscriberPublisher& link) { ++topic.subscribers[link.getSubscriberName()]; },
          [&topic](const ros::SingleSubscriberPublisher& link) { --topic.subscribers[link.getSubscriberName()]; });
      advertisement.latch = latching;
      advertisement.has_header = has_header;  // roscpp then numbers the messages, lap after lap
      topic.publisher = node_.advertise(advertisement);
    }
    topic.subscriber = node_.subscribe<RawMessage>(
        prefix_ + full_name, QUEUE_SIZE,
        boost::function<void(const boost::shared_ptr<RawMessage>&)>(
            [this, &topic](const boost::shared_ptr<RawMessage>& message) { onMessage(&topic, message.get()); }),
        ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  }

  /// The links of the player and of the subscribers to wait for that are not there yet.
  /// @throws std::invalid_argument if wait_for_subscribers names an unknown topic.
  std::string missingLinks() const
  {
    std::string missing;
    for (const auto& [name, topic] : topics_)
    {
      missing += topic.subscriber.getNumPublishers() == 0 ? " " + name + " of the player" : "";
    }
    for (const std::string& text : wait_for_)
    {
      std::istringstream words(text);
      std::string wanted, node;
      words >> wanted >> node;
      bool known = false;
      for (const auto& [name, topic] : topics_)
      {
        if (wanted == "*" ? topic.counted : wanted == name || wanted == "/" + name)
        {
          known = true;
          const bool there =
              std::any_of(topic.subscribers.begin(), topic.subscribers.end(),
                          [&node](const auto& one) { return one.second > 0 && (node.empty() || one.first == node); });
          missing += there ? "" : " " + name + (node.empty() ? "" : " to " + node);
        }
      }
      if (!known)
      {
        throw std::invalid_argument("wait_for_subscribers: \"" + text +
                                    "\" names no topic of the recording; expected " + "\"topic\" or \"topic /node\"");
      }
    }
    return missing;
  }

  /// Ends the pause of the player once it and the subscribers are there.
  void start()
  {
    const std::string missing = missingLinks();
    std_srvs::SetBool pause;
    pause.request.data = 0;
    if (!missing.empty() || !ros::service::call(recording_ + "/pause_playback", pause))
    {
      ROS_INFO_STREAM_DELAYED_THROTTLE_NAMED(5, "restamper", "still waiting for links:" << missing);
      return;
    }
    timer_.stop();
    publishStatus("playing");
  }

  void onMessage(Topic* topic, RawMessage* message)
  {
    if (!topic->publisher)
    {
      const bool begins = !message->bytes.empty() && message->bytes.front() != 0;
      if (!loop_ && !begins)
      {
        finish();
      }
      return;
    }
    if (topic->stamp_at != 0 && message->bytes.size() >= topic->stamp_at + 8)
    {
      const auto now_ns = static_cast<int64_t>(ros::WallTime::now().toNSec());
      message->setStampAt(topic->stamp_at, stamps_.stampOf(message->stampAt(topic->stamp_at), now_ns));
      lateness_sum_ns_ += static_cast<double>(stamps_.latenessNs());
      lateness_max_ns_ = std::max(lateness_max_ns_, stamps_.latenessNs());
      ++stamped_;
    }
    topic->publisher.publish(*message);
    ++topic->published;
  }

  void finish()
  {
    if (!std::exchange(finished_, true))
    {
      publishStatus("finished");
      if (exit_when_done_)
      {
        timer_ = node_.createWallTimer(
            LINGER, [](const ros::WallTimerEvent&) { ros::requestShutdown(); }, true);
      }
    }
  }

  void publishStatus(const std::string& state)
  {
    nlohmann::ordered_json status{
        {"state", state},
        {"published", nlohmann::ordered_json::object()},
        {"lateness_ms",
         {{"mean", stamped_ == 0 ? 0.0 : 1e-6 * lateness_sum_ns_ / static_cast<double>(stamped_)},
          {"max", 1e-6 * static_cast<double>(lateness_max_ns_)}}}};
    for (const auto& [name, topic] : topics_)
    {
      if (topic.counted)
      {
        status["published"][topic.publisher.getTopic()] = topic.published;
      }
    }
    std_msgs::String message;
    message.data = status.dump();
    status_.publish(message);
    ROS_INFO_STREAM_NAMED("restamper", message.data);
  }

  ros::NodeHandle node_;
  const std::string recording_;  ///< node of rosbag play; its parameter `topics` tells what it will send
  const std::string prefix_;     ///< what it puts before its topics
  const bool loop_;              ///< the end of the bag is not the end
  const bool exit_when_done_;
  const std::vector<std::string> wait_for_;  ///< "topic" or "topic /node"; topic "*": all that are counted
  StampMap stamps_;
  ros::Publisher status_;
  ros::WallTimer timer_;
  std::map<std::string, Topic> topics_;  ///< entries never move: callbacks hold pointers to them
  double lateness_sum_ns_ = 0.0;
  int64_t lateness_max_ns_ = 0;
  uint64_t stamped_ = 0;
  bool finished_ = false;
};

}  // namespace

}  // namespace pi_os_transport

int main(int argc, char** argv)
{
  ros::init(argc, argv, "player");
  const ros::NodeHandle node;  // to the end: logging stops when the last handle goes
  try
  {
    pi_os_transport::TopicRestamper restamper(ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& exception)
  {
    ROS_FATAL_STREAM_NAMED("restamper", exception.what());
    return 1;
  }
}
