#pragma once

#include <ros/advertise_options.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

namespace pi_node
{

/// A latched topic whose last message reaches every subscriber. roscpp (1.15) sends a message to those who are
/// connected before it remembers it for those who come, so whoever comes between gets neither. Here a message is sent
/// again if somebody came meanwhile. Thread safe; copies are the same publisher.
template <typename Message>
class LatchedPublisher
{
public:
  LatchedPublisher() = default;
  LatchedPublisher(ros::NodeHandle node, const std::string& topic, uint32_t queue_size)
    : publisher_(node.advertise<Message>(topic, queue_size, true))
  {
  }
  /// @param options  of a message by another name.
  LatchedPublisher(ros::NodeHandle node, ros::AdvertiseOptions options)
  {
    options.latch = true;
    publisher_ = node.advertise(options);
  }

  void publish(const Message& message) const
  {
    const std::lock_guard<std::mutex> lock(*mutex_);
    uint32_t before = 0;
    do
    {
      before = publisher_.getNumSubscribers();
      publisher_.publish(message);
    } while (publisher_.getNumSubscribers() > before);
  }

private:
  ros::Publisher publisher_;
  std::shared_ptr<std::mutex> mutex_ = std::make_shared<std::mutex>();
};

}  // namespace pi_node
