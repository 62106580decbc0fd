#include "ros/picture_subscription.h"
#include <sensor_msgs/Image.h>

#include <stdexcept>

namespace pi_detect
{

void requireTransport(const image_transport::ImageTransport& transport, const std::string& name,
                      const std::string& parameter)
{
  std::string all;
  for (std::string known : transport.getLoadableTransports())
  {
    const std::string package = "image_transport/";
    known = known.rfind(package, 0) == 0 ? known.substr(package.size()) : known;
    if (known == name)
    {
      return;
    }
    all += (all.empty() ? "" : ", ") + known;
  }
  throw std::invalid_argument("parameter " + parameter + " = \"" + name + "\", must be one that is installed: " + all);
}

void PictureSubscription::subscribe(ros::NodeHandle& node, image_transport::ImageTransport& transport,
                                    const std::string& topic, uint32_t queue_size, bool zero_copy,
                                    const image_transport::TransportHints& hints, const Callback& callback)
{
  shutdown();
  if (zero_copy && hints.getTransport() == "raw")
  {
    raw_ = pi_os_transport::zero_copy::subscribeImages(node, topic, queue_size, true, callback, hints.getRosHints());
    return;
  }
  transported_ = transport.subscribe(
      topic, queue_size,
      [callback](const sensor_msgs::ImageConstPtr& message)
      { callback(pi_os_transport::zero_copy::toHandle(message)); },
      ros::VoidPtr(), hints);
}

void PictureSubscription::shutdown()
{
  raw_.shutdown();
  transported_.shutdown();
}

}  // namespace pi_detect
