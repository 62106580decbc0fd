#pragma once

// For nodes that accept images of both forms: the callback gets the zero-copy form, and images of the standard form are
// shared, not copied.

#include <ros/node_handle.h>
#include <ros/transport_hints.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>

#include <boost/function.hpp>
#include <boost/shared_ptr.hpp>

#include <cstdint>
#include <memory>
#include <string>

#include "pi_os_transport/zero_copy/message.h"
#include "pi_os_transport/zero_copy/subscriber.h"

namespace pi_os_transport::zero_copy
{

/// A received image.
using ImageHandle = ConstPtr<sensor_msgs::Image>;

/// The standard header of a message of any form.
template <typename A>
std_msgs::Header standardHeader(const std_msgs::Header_<A>& header)
{
  std_msgs::Header standard;
  copyHeader(header, &standard);
  return standard;
}

/// Deleter of a handle on an image of the standard form; keeps that image.
struct StandardImageKeeper
{
  sensor_msgs::ImageConstPtr image;

  void operator()(const Message<sensor_msgs::Image>* shared) const { delete shared; }
};

/// A handle on an image of the standard form. Shares its data and keeps the image.
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

/// The image that was given to toHandle(), for publishing it as a pointer inside the process. Null for other handles.
inline sensor_msgs::ImageConstPtr standardOf(const ImageHandle& handle)
{
  const StandardImageKeeper* const keeper = boost::get_deleter<StandardImageKeeper>(handle);
  return keeper != nullptr ? keeper->image : nullptr;
}

/// True if only stock publishers of this process have advertised the topic. roscpp then passes pointers to subscribers
/// of the standard form, but would serialise messages for others. Any thread.
/// @param topic  full name
bool isStockTopicOfThisProcess(const std::string& topic);

/// Subscribes to images.
/// @param zero_copy  true: views where the transport allows; false: every image is copied, as roscpp does. Images of a
///                   stock publisher in this process are shared if it has advertised before.
/// @throws like ros::NodeHandle::subscribe().
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
