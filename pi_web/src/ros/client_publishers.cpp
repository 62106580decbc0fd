#include "ros/client_publishers.h"

#include "graph/graph_reader.h"

#include <stdexcept>
#include <utility>

namespace pi_web
{

ClientPublishers::ClientPublishers(const ros::NodeHandle& node, std::set<std::string> topics)
  : node_(node), topics_(std::move(topics))
{
}

void ClientPublishers::advertise(Client* client, const request::ClientChannel& channel,
                                 const std::map<std::string, MessageType>& types)
{
  std::string problem;
  const std::string topic = !channel.topic.empty() && ros::names::validate(channel.topic, problem)
                                ? node_.resolveName(channel.topic)
                                : channel.topic;
  if (topics_.count(topic) == 0)
  {
    throw std::invalid_argument("topic " + topic + " may not be published; see publish_topics");
  }
  const auto type = types.find(channel.type);
  if (channel.encoding != "ros1" || type == types.end())
  {
    throw std::invalid_argument("type " + channel.type + " with encoding " + channel.encoding +
                                ": the encoding must be ros1, the type one that is on the graph");
  }
  if (publishers_.count({client, channel.id}) != 0)
  {
    throw std::invalid_argument("client channel " + std::to_string(channel.id) + " exists");
  }
  ros::AdvertiseOptions options(topic, 10, type->second.md5sum, type->first, type->second.definition);
  ros::Publisher publisher = node_.advertise(options);
  if (!publisher)
  {
    throw std::invalid_argument("topic " + topic + " has another type than " + type->first);
  }
  publishers_[{client, channel.id}] = publisher;
}

void ClientPublishers::unadvertise(Client* client, uint32_t channel)
{
  if (publishers_.erase({client, channel}) == 0)
  {
    throw std::invalid_argument("client channel " + std::to_string(channel) + " does not exist");
  }
}

void ClientPublishers::publish(Client* client, const request::Publish& message)
{
  const auto publisher = publishers_.find({client, message.channel});
  if (publisher == publishers_.end())
  {
    throw std::invalid_argument("client channel " + std::to_string(message.channel) + " does not exist");
  }
  publisher->second.publish(RawMessage{std::make_shared<Bytes>(message.payload.begin(), message.payload.end())});
}

void ClientPublishers::remove(Client* client)
{
  auto entry = publishers_.lower_bound({client, 0});
  while (entry != publishers_.end() && entry->first.first == client)
  {
    entry = publishers_.erase(entry);
  }
}

}  // namespace pi_web
