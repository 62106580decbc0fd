#pragma once

#include "recorder/message_memory.h"

#include <pi_node/rate_limit.h>
#include <pi_node/ros/warning_board.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <topic_tools/shape_shifter.h>
#include <boost/shared_ptr.hpp>

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace pi_vehicle::recorder
{

struct IntakeOptions
{
  std::vector<std::string> topics;       ///< resolved; of any type but pictures
  std::vector<std::string> pictures;     ///< resolved; sensor_msgs/Image
  std::set<std::string> slim_topics;     ///< of topics, those of the continuous recording
  std::set<std::string> thinned_topics;  ///< of slim_topics, those that have a rate there
  double thinned_hz = 0.0;
  double picture_rate_hz = 0.0;
  int jpeg_quality = 0;
};

/// Subscribes topics and puts what comes into the memory; pictures as JPEG, on TOPIC/compressed. Callbacks wait in a
/// queue of their own, so that a message wakes nobody: take() calls them. One thread calls all methods.
class Intake
{
public:
  Intake(const ros::NodeHandle& node, const IntakeOptions& options, MessageMemory* memory,
         pi_node::WarningBoard* warnings);
  ~Intake();
  Intake(const Intake&) = delete;
  Intake& operator=(const Intake&) = delete;

  /// For subscribers of others, whose callbacks take() calls as well, in the order of arrival.
  ros::NodeHandle node() const { return node_; }

  /// Takes what came. @param elapsed_ns  now.
  void take(int64_t elapsed_ns);

  /// Puts a message into the memory that did not come as it is kept.
  /// @param slim  also for the continuous recording.
  template <typename Message>
  KeptMessagePtr keep(const std::string& topic, const Message& message, const ros::Time& stamp, int64_t elapsed_ns,
                      const std::string& publisher, bool slim)
  {
    auto kept = std::make_shared<KeptMessage>();
    kept->slim = slim;
    kept->channel = ownChannel(topic, ros::message_traits::datatype(message), ros::message_traits::md5sum(message),
                               ros::message_traits::definition(message), publisher);
    kept->bytes.resize(ros::serialization::serializationLength(message));
    ros::serialization::OStream stream(kept->bytes.data(), static_cast<uint32_t>(kept->bytes.size()));
    ros::serialization::serialize(stream, message);
    return add(std::move(kept), stamp, elapsed_ns);
  }

  /// Topics of which nothing came yet, and whether anybody publishes them.
  std::vector<std::string> silent() const;

private:
  using ShapeEvent = ros::MessageEvent<topic_tools::ShapeShifter const>;
  using PictureEvent = ros::MessageEvent<sensor_msgs::Image const>;

  /// What is known of a connection.
  struct Source
  {
    boost::shared_ptr<ros::M_string> header;  ///< holds the address, which is the key
    std::shared_ptr<const Channel> channel;
    bool slim = false;
    bool is_picture = false;
    pi_node::RateLimit limit{0.0};
  };

  void onMessage(const std::string& topic, const ShapeEvent& event);
  void onPicture(const std::string& topic, pi_node::RateLimit* limit, const PictureEvent& event);
  Source* sourceOf(const std::string& topic, const ShapeEvent& event);
  std::shared_ptr<const Channel> ownChannel(const std::string& topic, const char* type, const char* md5sum,
                                            const char* definition, const std::string& publisher);
  KeptMessagePtr add(std::shared_ptr<KeptMessage> message, const ros::Time& stamp, int64_t elapsed_ns);
  int64_t arrival(const ros::Time& receipt) const;

  const IntakeOptions options_;
  MessageMemory* const memory_;
  pi_node::WarningBoard* const warnings_;
  ros::CallbackQueue queue_;
  ros::NodeHandle node_;
  std::vector<ros::Subscriber> subscribers_;
  std::map<std::pair<std::string, const ros::M_string*>, Source> sources_;
  std::map<std::pair<std::string, std::string>, std::shared_ptr<const Channel>> own_channels_;
  std::set<std::string> heard_;
  ros::Time now_;                ///< of take()
  int64_t elapsed_ns_ = 0;       ///< of take()
  int64_t last_elapsed_ns_ = 0;  ///< of the last message
};

}  // namespace pi_vehicle::recorder
