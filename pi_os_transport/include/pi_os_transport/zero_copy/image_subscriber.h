#pragma once

// For nodes that work on images of either form: they know the zero-copy form alone, and what comes in the standard one
// is shared, not copied.

#include <ros/node_handle.h>
#include <ros/transport_hints.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>

#include <boost/function.hpp>
#include <boost/shared_ptr.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "pi_os_transport/zero_copy/message.h"
#include "pi_os_transport/zero_copy/subscriber.h"

namespace pi_os_transport::zero_copy
{

/// A received image.
using ImageHandle = ConstPtr<sensor_msgs::Image>;

/// The standard header of a message of either form.
template <typename A>
std_msgs::Header standardHeader(const std_msgs::Header_<A>& header)
{
  std_msgs::Header standard;
  copyHeader(header, &standard);
  return standard;
}

/// Deletes a handle on an image of the standard form, and keeps that image until then.
struct StandardImageKeeper
{
  sensor_msgs::ImageConstPtr image;

  void operator()(const Message<sensor_msgs::Image>* shared) const { delete shared; }
};

/// A handle on an image of the standard form, whose data it shares and which it keeps.
inline ImageHandle toHandle(const sensor_msgs::ImageConstPtr& image)
{
  auto* const made = new Message<sensor_msgs::Image>;
  const ImageHandle handle(made, StandardImageKeeper{image});
  Message<sensor_msgs::Image>& shared = *made;
  copyHeader(image->header, &shared.header);
  shared.height = image->height;
  shared.width = image->width;
  shared.encoding = image->encoding;
  shared.is_bigendian = image->is_bigendian;
  shared.step = image->step;
  const size_t bytes = image->data.size();
  if (bytes > 0)
  {
    shared.data = decltype(shared.data)(bytes, Allocator<uint8_t>::viewing(image->data.data(), bytes));
  }
  return handle;
}

/// The image that toHandle() was given: to pass it on within the process as the pointer that it is. Null for others.
inline sensor_msgs::ImageConstPtr standardOf(const ImageHandle& handle)
{
  const StandardImageKeeper* const keeper = boost::get_deleter<StandardImageKeeper>(handle);
  return keeper != nullptr ? keeper->image : nullptr;
}

/// True if a publisher of this process, and none of zero-copy messages, has advertised the topic: roscpp hands over its
/// messages as pointers to subscribers of the standard form, but would serialise them for others. Any thread.
/// @param topic  its full name.
bool isStockTopicOfThisProcess(const std::string& topic);

/// Subscribes to images.
/// @param zero_copy  views where the transport allows it; false: every image is copied, as roscpp always does. What a
///                   stock publisher of this process sends is shared as ever, if it has advertised before.
/// @throws as ros::NodeHandle::subscribe().
inline ros::Subscriber subscribeImages(ros::NodeHandle& node, const std::string& topic, uint32_t queue_size,
                                       bool zero_copy, const boost::function<void(const ImageHandle&)>& callback,
                                       const ros::TransportHints& hints = ros::TransportHints())
{
  if (zero_copy && !isStockTopicOfThisProcess(node.resolveName(topic)))
  {
    return node.subscribe<Message<sensor_msgs::Image>>(topic, queue_size, callback, ros::VoidConstPtr(), hints);
  }
  return node.subscribe<sensor_msgs::Image>(
      topic, queue_size, [callback](const sensor_msgs::ImageConstPtr& image) { callback(toHandle(image)); },
      ros::VoidConstPtr(), hints);
}

}  // namespace pi_os_transport::zero_copy
