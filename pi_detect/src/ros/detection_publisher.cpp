#include <pi_detect/ros/detection_publisher.h>

#include <boost/algorithm/string/replace.hpp>
#include <vector>

namespace pi_detect
{
namespace
{

/// For messages of this package that go by the name of upstream's, which has the same fields in the same order.
template <typename Message>
ros::AdvertiseOptions upstreamOptions(const std::string& topic, uint32_t queue_size)
{
  ros::AdvertiseOptions options;
  options.init<Message>(topic, queue_size);
  boost::replace_first(options.datatype, "pi_detect/", "vision_msgs/");
  boost::replace_all(options.message_definition, "MSG: pi_detect/", "MSG: vision_msgs/");
  return options;
}

}  // namespace

DetectionPublisher::DetectionPublisher(ros::NodeHandle node, uint32_t queue_size,
                                       const ros::SubscriberStatusCallback& look)
  : detections_(node.advertise<Detection2DArray>("detections", queue_size, look, look))
{
  ros::AdvertiseOptions options = upstreamOptions<Detection2DArray>("detections_vision", queue_size);
  options.connect_cb = options.disconnect_cb = look;
  vision_ = node.advertise(options);
}

uint32_t DetectionPublisher::getNumSubscribers() const
{
  return detections_.getNumSubscribers() + vision_.getNumSubscribers();
}

void DetectionPublisher::publish(const Detection2DArrayConstPtr& message) const
{
  detections_.publish(message);
  vision_.publish(message);
}

VisionInfoPublisher::VisionInfoPublisher(const ros::NodeHandle& node, const ros::NodeHandle& private_node)
  : private_node_(private_node), info_(node, upstreamOptions<VisionInfo>("vision_info", 1))
{
}

void VisionInfoPublisher::publish(const ModelDescription& model)
{
  std::vector<std::string> names;
  for (const auto& [id, name] : model.labels)
  {
    names.resize(static_cast<size_t>(id));
    names.push_back(name);
  }
  private_node_.setParam("class_labels", names);
  VisionInfo info;
  info.header.stamp = ros::Time::now();
  info.method = model.name;
  info.database_location = private_node_.resolveName("class_labels");
  info.database_version = ++version_;
  info_.publish(info);
}

}  // namespace pi_detect
