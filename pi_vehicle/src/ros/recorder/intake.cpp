#include "ros/recorder/intake.h"

#include "ros/recorder/picture_compression.h"

#include <pi_node/ros/time.h>
#include <sensor_msgs/CompressedImage.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace pi_vehicle::recorder
{
namespace
{

constexpr uint32_t INTAKE_QUEUE = 1000;  // messages of a topic that wait for take()
constexpr uint32_t INTAKE_PICTURES = 4;
constexpr size_t MOST_SOURCES = 1000;            // publishers that ended are forgotten beyond
constexpr int64_t LONGEST_WAIT_NS = 1000000000;  // of a message for take(); a larger difference is a jump of the clock

}  // namespace

Intake::Intake(const ros::NodeHandle& node, const IntakeOptions& options, MessageMemory* memory,
               pi_node::WarningBoard* warnings)
  : options_(options), memory_(memory), warnings_(warnings), node_(node)
{
  node_.setCallbackQueue(&queue_);
  for (const std::string& topic : options_.topics)
  {
    ros::SubscribeOptions subscription;
    subscription.initByFullCallbackType<const ShapeEvent&>(
        topic, INTAKE_QUEUE, [this, topic](const ShapeEvent& event) { onMessage(topic, event); });
    subscription.transport_hints = ros::TransportHints().tcpNoDelay();
    subscribers_.push_back(node_.subscribe(subscription));
  }
  for (const std::string& topic : options_.pictures)
  {
    const auto limit = std::make_shared<pi_node::RateLimit>(options_.picture_rate_hz);
    ros::SubscribeOptions subscription;
    subscription.initByFullCallbackType<const PictureEvent&>(topic, INTAKE_PICTURES,
                                                             [this, topic, limit](const PictureEvent& event)
                                                             { onPicture(topic, limit.get(), event); });
    subscribers_.push_back(node_.subscribe(subscription));
  }
}

Intake::~Intake()
{
  queue_.disable();
}

void Intake::take(int64_t elapsed_ns)
{
  now_ = ros::Time::now();
  elapsed_ns_ = elapsed_ns;
  queue_.callAvailable();
  memory_->advance(elapsed_ns);
}

void Intake::onMessage(const std::string& topic, const ShapeEvent& event)
{
  Source* const source = sourceOf(topic, event);
  if (source == nullptr)
  {
    warnings_->warn("a message on " + topic + " came without type or definition; it is left out");
    return;
  }
  heard_.insert(topic);
  if ((event.getReceiptTime() - now_).toNSec() > LONGEST_WAIT_NS)
  {
    return;  // it waited while the clock went back: neither in this time nor in that one
  }
  if (source->is_picture)
  {
    warnings_->warn(topic + " has pictures, which are left out; name it in the parameter pictures, not in topics");
    return;
  }
  const topic_tools::ShapeShifter& shape = *event.getConstMessage();
  auto kept = std::make_shared<KeptMessage>();
  kept->channel = source->channel;
  kept->slim = source->slim && source->limit.take(arrival(event.getReceiptTime()));
  kept->bytes.resize(shape.size());
  ros::serialization::OStream stream(kept->bytes.data(), static_cast<uint32_t>(kept->bytes.size()));
  shape.write(stream);
  add(std::move(kept), event.getReceiptTime(), arrival(event.getReceiptTime()));
}

Intake::Source* Intake::sourceOf(const std::string& topic, const ShapeEvent& event)
{
  const boost::shared_ptr<ros::M_string>& header = event.getConnectionHeaderPtr();
  if (!header || header->count("type") == 0 || header->count("md5sum") == 0 || header->count("message_definition") == 0)
  {
    return nullptr;
  }
  const auto known = sources_.find({topic, header.get()});
  if (known != sources_.end())
  {
    return &known->second;
  }
  if (sources_.size() >= MOST_SOURCES)
  {
    sources_.clear();
  }
  const Source source{header, std::make_shared<const Channel>(Channel{topic, *header}),
                      options_.slim_topics.count(topic) > 0,
                      header->at("type") == ros::message_traits::datatype<sensor_msgs::Image>(),
                      pi_node::RateLimit(options_.thinned_topics.count(topic) > 0 ? options_.thinned_hz : 0.0)};
  return &sources_.emplace(std::make_pair(topic, header.get()), source).first->second;
}

void Intake::onPicture(const std::string& topic, pi_node::RateLimit* limit, const PictureEvent& event)
{
  const sensor_msgs::Image& picture = *event.getConstMessage();
  heard_.insert(topic);
  // By the stamp, so that of a stereo pair both are taken.
  if (!limit->take(picture.header.stamp.isZero() ? elapsed_ns_ : pi_node::fromMsg(picture.header.stamp)))
  {
    return;
  }
  try
  {
    keep(topic + "/compressed", toJpeg(picture, options_.jpeg_quality), event.getReceiptTime(),
         arrival(event.getReceiptTime()), event.getPublisherName(), false);
  }
  catch (const std::exception& error)
  {
    warnings_->warn("pictures on " + topic + " are left out: " + error.what());
  }
}

std::shared_ptr<const Channel> Intake::ownChannel(const std::string& topic, const char* type, const char* md5sum,
                                                  const char* definition, const std::string& publisher)
{
  std::shared_ptr<const Channel>& channel = own_channels_[{topic, publisher}];
  if (!channel)
  {
    channel = std::make_shared<const Channel>(Channel{
        topic, {{"type", type}, {"md5sum", md5sum}, {"message_definition", definition}, {"callerid", publisher}}});
  }
  return channel;
}

KeptMessagePtr Intake::add(std::shared_ptr<KeptMessage> message, const ros::Time& stamp, int64_t elapsed_ns)
{
  message->stamp_ns = pi_node::fromMsg(stamp.isZero() ? now_ : stamp);
  last_elapsed_ns_ = std::max(last_elapsed_ns_, elapsed_ns);
  message->elapsed_ns = last_elapsed_ns_;
  memory_->add(message);
  return message;
}

int64_t Intake::arrival(const ros::Time& receipt) const
{
  const int64_t waited_ns = (now_ - receipt).toNSec();
  return elapsed_ns_ - (waited_ns > 0 && waited_ns < LONGEST_WAIT_NS ? waited_ns : 0);
}

std::vector<std::string> Intake::silent() const
{
  std::vector<std::string> topics = options_.topics;
  topics.insert(topics.end(), options_.pictures.begin(), options_.pictures.end());
  std::vector<std::string> silent;
  for (size_t i = 0; i < topics.size(); ++i)
  {
    if (heard_.count(topics[i]) == 0)
    {
      silent.push_back(topics[i] + (subscribers_[i].getNumPublishers() == 0 ? " (nobody publishes it)" : ""));
    }
  }
  return silent;
}

}  // namespace pi_vehicle::recorder
