#include "pi_os_transport/zero_copy/image_subscriber.h"

#include <ros/this_node.h>

#include <algorithm>

#include "pi_os_transport/zero_copy/statistics.h"

namespace pi_os_transport::zero_copy
{

bool isStockTopicOfThisProcess(const std::string& topic)
{
  ros::V_string advertised;
  ros::this_node::getAdvertisedTopics(advertised);
  return std::find(advertised.begin(), advertised.end(), topic) != advertised.end() && !isZeroCopyTopic(topic);
}

}  // namespace pi_os_transport::zero_copy
