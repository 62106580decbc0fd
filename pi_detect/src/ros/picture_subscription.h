#pragma once

#include <image_transport/image_transport.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <ros/ros.h>

#include <boost/function.hpp>
#include <cstdint>
#include <string>

namespace pi_detect
{

/// Checks that a transport is installed, because transports are loaded only when somebody listens.
/// @param parameter  name of the parameter, for the message.
/// @throws std::invalid_argument with the list of installed transports.
void requireTransport(const image_transport::ImageTransport& transport, const std::string& name,
                      const std::string& parameter);

/// Subscribes to pictures: raw ones are read in the publisher's memory, others come by image_transport. Not thread
/// safe.
class PictureSubscription
{
public:
  using ImageHandle = pi_os_transport::zero_copy::ImageHandle;
  using Callback = boost::function<void(const ImageHandle&)>;

  /// @param node       for raw pictures, with the queue of `transport`.
  /// @param zero_copy  false: raw pictures come by image_transport, too.
  /// @throws as image_transport::ImageTransport::subscribe().
  void subscribe(ros::NodeHandle& node, image_transport::ImageTransport& transport, const std::string& topic,
                 uint32_t queue_size, bool zero_copy, const image_transport::TransportHints& hints,
                 const Callback& callback);
  void shutdown();

private:
  ros::Subscriber raw_;
  image_transport::Subscriber transported_;
};

}  // namespace pi_detect
