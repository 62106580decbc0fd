#pragma once

#include "protocol/requests.h"
#include "ros/raw_message.h"
#include "server/client.h"

#include <ros/ros.h>

#include <map>
#include <set>
#include <string>

namespace pi_web
{

struct MessageType;

/// What clients publish. One thread calls all methods.
class ClientPublishers
{
public:
  /// @param topics  that may be published, resolved.
  ClientPublishers(const ros::NodeHandle& node, std::set<std::string> topics);

  const std::set<std::string>& topics() const { return topics_; }
  /// @throws std::invalid_argument for other topics, types that nobody knows, ids in use.
  void advertise(Client* client, const request::ClientChannel& channel,
                 const std::map<std::string, MessageType>& types);
  void unadvertise(Client* client, uint32_t channel);
  void publish(Client* client, const request::Publish& message);
  void remove(Client* client);

private:
  ros::NodeHandle node_;
  const std::set<std::string> topics_;
  std::map<std::pair<Client*, uint32_t>, ros::Publisher> publishers_;
};

}  // namespace pi_web
