#include "ros/channels.h"

#include <pi_node/vehicle_clock.h>
#include <sensor_msgs/CompressedImage.h>

#include <algorithm>
#include <stdexcept>

namespace pi_web
{
namespace
{

constexpr const char* PICTURE_TYPE = "sensor_msgs/Image";
constexpr const char* TF_TYPE = "tf2_msgs/TFMessage";
constexpr size_t MAX_SUBSCRIPTIONS = 256;  // of a client
constexpr size_t MAX_FRAMES = 200;         // of tf whose rates are known

/// The frame of a tf2_msgs/TFMessage with its first transform: what a thinned channel tells streams apart by.
std::string childFrame(const Bytes& message)
{
  size_t at = 16;  // count, seq, stamp
  for (int text = 0; text < 2; ++text)
  {
    if (message.size() < at + 4)
    {
      return "";
    }
    const size_t length = readUint32(reinterpret_cast<const char*>(message.data()) + at);
    if (message.size() - at - 4 < length)
    {
      return "";
    }
    if (text == 1)
    {
      return std::string(message.begin() + static_cast<std::ptrdiff_t>(at) + 4,
                         message.begin() + static_cast<std::ptrdiff_t>(at + 4 + length));
    }
    at += 4 + length;
  }
  return "";
}

bool isLarge(const std::string& type)
{
  return type == PICTURE_TYPE || type == "sensor_msgs/CompressedImage" || type == "nav_msgs/OccupancyGrid" ||
         type == "sensor_msgs/PointCloud2" || type == "stereo_msgs/DisparityImage";
}

}  // namespace

Channels::Channels(const ros::NodeHandle& node, const WebViewRosOptions& options, pi_node::WarningBoard* warnings)
  : node_(node), options_(options), warnings_(warnings), encoder_(options.picture_width, options.jpeg_quality)
{
  for (const std::string& topic : options.thinned_topics)
  {
    thinned_.insert(node_.resolveName(topic));
  }
}

void Channels::add(Kind kind, const std::string& topic, const std::string& type, const MessageType& definition,
                   Change* change)
{
  auto channel = std::make_unique<Channel>();
  channel->kind = kind;
  channel->topic = topic;
  channel->type = type;
  channel->definition = definition;
  const auto known = by_name_.find(channel->name());
  if (known != by_name_.end())
  {
    const Channel& old = *channels_.at(known->second);
    if (old.type == type && old.definition.md5sum == definition.md5sum)
    {
      return;
    }
    change->removed.push_back(known->second);  // it has another type now
  }
  channel->id = ++last_id_;
  change->added.push_back(last_id_);
  by_name_[channel->name()] = last_id_;
  channels_[last_id_] = std::move(channel);
}

Channels::Change Channels::update(const GraphState& graph, const std::map<std::string, MessageType>& types)
{
  Change change;
  const auto unused = [&](const Channel& channel)
  { return graph.publishers.count(channel.topic) == 0 && channel.watchers.empty(); };
  for (const auto& [id, channel] : channels_)
  {
    if (unused(*channel))
    {
      change.removed.push_back(id);
    }
  }
  for (const auto& [topic, nodes] : graph.publishers)
  {
    const auto type = graph.types.find(topic);
    const auto definition = type == graph.types.end() ? types.end() : types.find(type->second);
    if (definition == types.end())
    {
      continue;
    }
    add(Kind::PLAIN, topic, type->second, definition->second, &change);
    if (type->second == PICTURE_TYPE)
    {
      using Jpeg = sensor_msgs::CompressedImage;
      static const MessageType jpeg = {ros::message_traits::md5sum<Jpeg>(), ros::message_traits::definition<Jpeg>()};
      add(Kind::PICTURE, topic, ros::message_traits::datatype<Jpeg>(), jpeg, &change);
    }
    else if (thinned_.count(topic) != 0)
    {
      add(Kind::THINNED, topic, type->second, definition->second, &change);
    }
  }
  for (const uint32_t id : change.removed)
  {
    const Channel& channel = *channels_.at(id);
    for (const auto& watcher : channel.watchers)
    {
      subscriptions_.erase(watcher);
      watcher.first->forget(watcher.second);
    }
    if (by_name_[channel.name()] == id)
    {
      by_name_.erase(channel.name());
    }
    channels_.erase(id);
  }
  return change;
}

nlohmann::json Channels::describe(const std::vector<uint32_t>& ids) const
{
  nlohmann::json list = nlohmann::json::array();
  for (const uint32_t id : ids)
  {
    const Channel& channel = *channels_.at(id);
    list.push_back({{"id", id},
                    {"topic", channel.name()},
                    {"encoding", "ros1"},
                    {"schemaName", channel.type},
                    {"schema", channel.definition.definition},
                    {"schemaEncoding", "ros1msg"}});
  }
  return list;
}

std::vector<uint32_t> Channels::ids() const
{
  std::vector<uint32_t> ids;
  for (const auto& [id, channel] : channels_)
  {
    ids.push_back(id);
  }
  return ids;
}

size_t Channels::watched() const
{
  return static_cast<size_t>(std::count_if(channels_.begin(), channels_.end(),
                                           [](const auto& entry) { return !entry.second->watchers.empty(); }));
}

size_t Channels::most(const Channel& channel) const
{
  if (channel.kind == Kind::PLAIN)
  {
    return isLarge(channel.type) ? 1 : static_cast<size_t>(options_.queue_length);
  }
  return channel.type == TF_TYPE ? static_cast<size_t>(options_.queue_length) : 1;
}

void Channels::subscribe(Client* client, uint32_t subscription, uint32_t id)
{
  const auto found = channels_.find(id);
  if (found == channels_.end())
  {
    throw std::invalid_argument("channel " + std::to_string(id) + " does not exist");
  }
  const auto first = subscriptions_.lower_bound({client, 0});
  const auto end =
      std::find_if(first, subscriptions_.end(), [&](const auto& one) { return one.first.first != client; });
  if (subscriptions_.count({client, subscription}) != 0 ||
      static_cast<size_t>(std::distance(first, end)) >= MAX_SUBSCRIPTIONS)
  {
    throw std::invalid_argument("subscription " + std::to_string(subscription) + " exists, or " +
                                std::to_string(MAX_SUBSCRIPTIONS) + " do");
  }
  Channel* const channel = found->second.get();
  subscriptions_[{client, subscription}] = id;
  channel->watchers.insert({client, subscription});
  for (const auto& [publisher, bytes] : channel->latched)
  {
    client->push(subscription, dataMessage(subscription, ros::Time::now().toNSec(), bytes),
                 std::max(most(*channel), channel->latched.size()));
  }
  if (channel->watchers.size() == 1)
  {
    const auto queue = static_cast<uint32_t>(isLarge(channel->type) || channel->kind == Kind::PICTURE ? 2 : 100);
    ros::SubscribeOptions subscribe_options;
    subscribe_options.initByFullCallbackType<const Event&>(
        channel->topic, queue, [this, channel](const Event& event) { onMessage(channel, event); });
    subscribe_options.transport_hints = ros::TransportHints().tcpNoDelay();
    channel->subscriber = node_.subscribe(subscribe_options);
  }
}

void Channels::leave(Channel* channel)
{
  if (channel->watchers.empty())
  {
    channel->subscriber.shutdown();
    channel->latched.clear();
    channel->limits.clear();
  }
}

void Channels::unsubscribe(Client* client, uint32_t subscription)
{
  const auto found = subscriptions_.find({client, subscription});
  if (found == subscriptions_.end())
  {
    return;  // its channel was withdrawn
  }
  Channel* const channel = channels_.at(found->second).get();
  channel->watchers.erase(found->first);
  client->forget(subscription);
  subscriptions_.erase(found);
  leave(channel);
}

void Channels::remove(Client* client)
{
  auto entry = subscriptions_.lower_bound({client, 0});
  while (entry != subscriptions_.end() && entry->first.first == client)
  {
    Channel* const channel = channels_.at(entry->second).get();
    channel->watchers.erase(entry->first);
    entry = subscriptions_.erase(entry);
    leave(channel);
  }
}

void Channels::onMessage(Channel* channel, const Event& event)
{
  const RawMessage& message = *event.getConstMessage();
  if (channel->kind == Kind::PICTURE)
  {
    onPicture(channel, message);
    return;
  }
  const ros::M_string& header = event.getConnectionHeader();
  if (const auto latching = header.find("latching"); latching != header.end() && latching->second == "1")
  {
    channel->latched[event.getPublisherName()] = message.bytes;
  }
  if (channel->kind == Kind::THINNED)
  {
    const std::string stream = channel->type == TF_TYPE ? childFrame(*message.bytes) : "";
    if (channel->limits.size() > MAX_FRAMES)
    {
      channel->limits.clear();
    }
    if (!channel->limits.try_emplace(stream, options_.web_hz).first->second.take(pi_node::vehicleNs()))
    {
      return;
    }
  }
  send(channel, message.bytes);
}

/// Encodes a picture if a client has taken the one before.
void Channels::onPicture(Channel* channel, const RawMessage& message)
{
  const auto ready = [](const auto& watcher) { return watcher.first->isReady(watcher.second); };
  if (std::none_of(channel->watchers.begin(), channel->watchers.end(), ready) ||
      !channel->limits.try_emplace("", options_.web_hz).first->second.take(pi_node::vehicleNs()))
  {
    return;
  }
  try
  {
    send(channel, encoder_.encode(*message.bytes));
  }
  catch (const std::invalid_argument& error)
  {
    warnings_->warn(channel->topic + ": " + error.what());
  }
}

void Channels::send(Channel* channel, const Payload& bytes)
{
  const uint64_t now_ns = ros::Time::now().toNSec();
  for (const auto& [client, subscription] : channel->watchers)
  {
    if (channel->kind != Kind::PICTURE || client->isReady(subscription))
    {
      client->push(subscription, dataMessage(subscription, now_ns, bytes), most(*channel));
    }
  }
}

}  // namespace pi_web
