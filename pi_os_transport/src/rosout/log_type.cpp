#include "rosout/log_type.h"

#include <rosgraph_msgs/Log.h>

namespace pi_os_transport
{

const char* LogType::name()
{
  return ros::message_traits::DataType<rosgraph_msgs::Log>::value();
}

const char* LogType::md5sum()
{
  return ros::message_traits::MD5Sum<rosgraph_msgs::Log>::value();
}

const char* LogType::definition()
{
  return ros::message_traits::Definition<rosgraph_msgs::Log>::value();
}

}  // namespace pi_os_transport
