// topic_restamper: passes on the topics of a bag that `rosbag play` plays, with stamps of now, as live sensors would
// send.
//
// It starts the playback once the subscribers that it is told to wait for are connected. A looped bag looks like one long
// recording: the stamps of each lap go on where the last lap ended.

#include <ros/ros.h>
#include <std_msgs/String.h>
#include <std_srvs/SetBool.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "topic_restamper/message_header.h"
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

struct RestamperOptions
{
  std::string recording = "recording";  ///< node of rosbag play; its parameter `topics` tells what it will send
  std::string prefix = "/recorded";     ///< what it puts before its topics
  bool stamp_at_handover = false;       ///< stamp: moment of publishing, one for all that was recorded together
  bool loop = false;                    ///< the end of the bag is not the end
  bool exit_when_done = true;
  std::vector<std::string> wait_for_subscribers;  ///< "topic" or "topic /node"; topic "*": all that are counted

  static RestamperOptions load(const ros::NodeHandle& node)
  {
    RestamperOptions options;
    const auto get = [&node](const std::string& name, auto* value)
    {
      if (node.hasParam(name) && !node.getParam(name, *value))
      {
        throw std::invalid_argument("parameter " + node.resolveName(name) + " has the wrong type, see README.md");
      }
    };
    get("recording", &options.recording);
    get("prefix", &options.prefix);
    get("stamp_at_handover", &options.stamp_at_handover);
    get("loop", &options.loop);
    get("exit_when_done", &options.exit_when_done);
    get("wait_for_subscribers", &options.wait_for_subscribers);
    return options;
  }
};

/// Everything runs in the thread of ros::spin().
class TopicRestamper
{
public:
  TopicRestamper(ros::NodeHandle node, ros::NodeHandle private_node)
    : node_(std::move(node)), options_(RestamperOptions::load(private_node)), stamps_(options_.stamp_at_handover)
  {
    status_ = private_node.advertise<std_msgs::String>("status", 5, true);
    publishStatus("waiting");
    timer_ = node_.createWallTimer(POLL, &TopicRestamper::onPoll, this);
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

  void onPoll(const ros::WallTimerEvent&)
  {
    if (topics_.empty())
    {
      advertise();
    }
    else if (!playing_)
    {
      start();
    }
  }

  /// Reads what the player wrote to the parameter server before it started, if it has.
  void advertise()
  {
    XmlRpc::XmlRpcValue topics;
    if (!node_.getParam(options_.recording + "/topics", topics) || topics.getType() != XmlRpc::XmlRpcValue::TypeArray)
    {
      return;
    }
    for (int i = 0; i < topics.size(); ++i)
    {
      add(topics[i]);
    }
    for (const std::string& text : options_.wait_for_subscribers)
    {
      require(text);
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
        options_.prefix + full_name, QUEUE_SIZE,
        boost::function<void(const boost::shared_ptr<RawMessage>&)>(
            [this, &topic](const boost::shared_ptr<RawMessage>& message) { onMessage(&topic, message.get()); }),
        ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  }

  void require(const std::string& text)
  {
    std::istringstream words(text);
    std::string topic, node;
    words >> topic >> node;
    bool known = false;
    for (const auto& [name, one] : topics_)
    {
      if (topic == "*" ? one.counted : topic == name || topic == "/" + name)
      {
        conditions_.emplace_back(name, node);
        known = true;
      }
    }
    if (!known)
    {
      throw std::invalid_argument("wait_for_subscribers: \"" + text + "\" names no topic of the recording; expected " +
                                  "\"topic\" or \"topic /node\"");
    }
  }

  /// Ends the pause of the player once it and the subscribers are there.
  void start()
  {
    std::string missing;
    for (const auto& [name, topic] : topics_)
    {
      missing += topic.subscriber.getNumPublishers() == 0 ? " " + name + " of the player" : "";
    }
    for (const auto& [name, node] : conditions_)
    {
      const std::map<std::string, int>& nodes = topics_.at(name).subscribers;
      const bool there = std::any_of(nodes.begin(), nodes.end(),
                                     [&node = node](const auto& one)
                                     { return one.second > 0 && (node.empty() || one.first == node); });
      missing += there ? "" : " " + name + (node.empty() ? "" : " to " + node);
    }
    std_srvs::SetBool pause;
    pause.request.data = 0;
    if (!missing.empty() || !ros::service::call(options_.recording + "/pause_playback", pause))
    {
      ROS_INFO_STREAM_DELAYED_THROTTLE_NAMED(5, "restamper", "still waiting for links:" << missing);
      return;
    }
    playing_ = true;
    publishStatus("playing");
  }

  void onMessage(Topic* topic, RawMessage* message)
  {
    if (!topic->publisher)
    {
      const bool begins = !message->bytes.empty() && message->bytes.front() != 0;
      if (!options_.loop && !begins)
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
      if (options_.exit_when_done)
      {
        exit_timer_ = node_.createWallTimer(
            LINGER, [](const ros::WallTimerEvent&) { ros::requestShutdown(); }, true);
      }
    }
  }

  void publishStatus(const std::string& state)
  {
    std::ostringstream json;
    json << "{\"state\": \"" << state << "\", \"published\": {";
    const char* separator = "";
    for (const auto& [name, topic] : topics_)
    {
      if (topic.counted)
      {
        json << std::exchange(separator, ", ") << "\"" << topic.publisher.getTopic() << "\": " << topic.published;
      }
    }
    json << "}, \"lateness_ms\": {\"mean\": " << (stamped_ == 0 ? 0.0 : 1e-6 * lateness_sum_ns_ / stamped_)
         << ", \"max\": " << 1e-6 * static_cast<double>(lateness_max_ns_) << "}}";
    std_msgs::String message;
    message.data = json.str();
    status_.publish(message);
    ROS_INFO_STREAM_NAMED("restamper", message.data);
  }

  ros::NodeHandle node_;
  const RestamperOptions options_;
  StampMap stamps_;
  ros::Publisher status_;
  ros::WallTimer timer_;
  ros::WallTimer exit_timer_;
  std::map<std::string, Topic> topics_;  ///< entries never move: callbacks hold pointers to them
  std::vector<std::pair<std::string, std::string>> conditions_;  ///< topic, node
  double lateness_sum_ns_ = 0.0;
  int64_t lateness_max_ns_ = 0;
  uint64_t stamped_ = 0;
  bool playing_ = false;
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
    pi_os_transport::TopicRestamper restamper(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& exception)
  {
    ROS_FATAL_STREAM_NAMED("restamper", exception.what());
    return 1;
  }
}
