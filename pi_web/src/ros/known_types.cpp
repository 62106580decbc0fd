#include "ros/known_types.h"

#include <actionlib_msgs/GoalID.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/Twist.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Bool.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>
#include <std_srvs/Empty.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

namespace pi_web
{
namespace
{

template <typename... Message>
std::map<std::string, MessageType> typesOf()
{
  return {{ros::message_traits::datatype<Message>(),
           {ros::message_traits::md5sum<Message>(), ros::message_traits::definition<Message>()}}...};
}

template <typename... Service>
std::map<std::string, ServiceSchema> servicesOf()
{
  return {{ros::service_traits::datatype<Service>(),
           {ros::message_traits::definition<typename Service::Request>(),
            ros::message_traits::definition<typename Service::Response>()}}...};
}

}  // namespace

std::map<std::string, MessageType> knownTypes()
{
  return typesOf<actionlib_msgs::GoalID, geometry_msgs::PoseStamped, geometry_msgs::PoseWithCovarianceStamped,
                 geometry_msgs::Twist, sensor_msgs::CompressedImage, sensor_msgs::Image, std_msgs::Bool,
                 std_msgs::Empty, std_msgs::String>();
}

std::optional<ServiceSchema> knownService(const std::string& type)
{
  static const auto services = servicesOf<std_srvs::Empty, std_srvs::SetBool, std_srvs::Trigger>();
  const auto found = services.find(type);
  return found == services.end() ? std::nullopt : std::optional<ServiceSchema>(found->second);
}

}  // namespace pi_web
