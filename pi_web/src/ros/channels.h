#pragma once

#include "graph/graph_reader.h"
#include "pictures/jpeg_encoder.h"
#include "ros/raw_message.h"
#include "ros/web_view_ros_options.h"
#include "server/client.h"

#include <pi_node/rate_limit.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <nlohmann/json.hpp>

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace pi_web
{

/// The channels that clients see: every topic whose type is known, and beside pictures and frequent topics one
/// TOPIC/web for pages. Subscribes while somebody watches. One thread calls all methods, and the callbacks of the node
/// handle.
class Channels
{
public:
  Channels(const ros::NodeHandle& node, const WebViewRosOptions& options, pi_node::WarningBoard* warnings);

  struct Change
  {
    std::vector<uint32_t> added;
    std::vector<uint32_t> removed;
  };
  /// A channel of a topic that is gone stays while somebody watches it: the publisher may start again.
  Change update(const GraphState& graph, const std::map<std::string, MessageType>& types);
  /// The "channels" of an advertisement.
  nlohmann::json describe(const std::vector<uint32_t>& ids) const;
  std::vector<uint32_t> ids() const;

  /// @throws std::invalid_argument if there is no such channel, or the id is taken.
  void subscribe(Client* client, uint32_t subscription, uint32_t channel);
  void unsubscribe(Client* client, uint32_t subscription);
  void remove(Client* client);

  size_t size() const { return channels_.size(); }
  size_t watched() const;

private:
  using Event = ros::MessageEvent<RawMessage const>;
  enum class Kind
  {
    PLAIN,
    PICTURE,
    THINNED
  };
  struct Channel
  {
    uint32_t id = 0;
    Kind kind = Kind::PLAIN;
    std::string topic;
    std::string type;
    MessageType definition;  ///< of what is sent
    ros::Subscriber subscriber;
    std::set<std::pair<Client*, uint32_t>> watchers;   ///< with their subscription
    std::map<std::string, Payload> latched;            ///< by publisher
    std::map<std::string, pi_node::RateLimit> limits;  ///< "", of tf by frame

    std::string name() const { return kind == Kind::PLAIN ? topic : topic + "/web"; }
  };

  void add(Kind kind, const std::string& topic, const std::string& type, const MessageType& definition, Change* change);
  void onMessage(Channel* channel, const Event& event);
  void onPicture(Channel* channel, const RawMessage& message);
  void send(Channel* channel, const Payload& bytes);
  size_t most(const Channel& channel) const;
  void leave(Channel* channel);

  ros::NodeHandle node_;
  const WebViewRosOptions options_;
  pi_node::WarningBoard* const warnings_;
  JpegEncoder encoder_;
  std::set<std::string> thinned_;
  std::map<uint32_t, std::unique_ptr<Channel>> channels_;
  std::map<std::string, uint32_t> by_name_;
  std::map<std::pair<Client*, uint32_t>, uint32_t> subscriptions_;  ///< to their channel
  uint32_t last_id_ = 0;
};

}  // namespace pi_web
