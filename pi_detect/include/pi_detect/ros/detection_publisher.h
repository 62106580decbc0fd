#pragma once

#include <pi_detect/Detection2DArray.h>
#include <pi_detect/VisionInfo.h>
#include <pi_detect/model_description.h>
#include <pi_node/ros/latched_publisher.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <cstdint>
#include <string>

namespace pi_detect
{

/// Detections under two names: `detections` (pi_detect/Detection2DArray) and, for tools that know upstream's messages,
/// `detections_vision` (vision_msgs/Detection2DArray of ROS noetic). The layout and so the md5 sum of both are the
/// same. A topic without subscribers costs nothing. Thread safe; copies are the same publisher.
class DetectionPublisher
{
public:
  DetectionPublisher() = default;
  /// @param look  called when somebody comes to either topic, or leaves.
  DetectionPublisher(ros::NodeHandle node, uint32_t queue_size, const ros::SubscriberStatusCallback& look);

  uint32_t getNumSubscribers() const;  ///< of both topics
  void publish(const Detection2DArrayConstPtr& message) const;

private:
  ros::Publisher detections_;
  ros::Publisher vision_;
};

/// The names of a network's classes for tools that know upstream's messages: `vision_info` (vision_msgs/VisionInfo of
/// ROS noetic), latched, names the parameter that has them: a list whose index is the class id, empty where there is
/// none.
class VisionInfoPublisher
{
public:
  /// @param private_node  of the parameter `class_labels`.
  VisionInfoPublisher(const ros::NodeHandle& node, const ros::NodeHandle& private_node);

  void publish(const ModelDescription& model);

private:
  ros::NodeHandle private_node_;
  int version_ = 0;
  pi_node::LatchedPublisher<VisionInfo> info_;
};

}  // namespace pi_detect
