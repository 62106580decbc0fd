#pragma once

#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/object_tracker.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/subscriber.h>
#include "ros/camera_turn.h"
#include "ros/tracker_ros_options.h"

#include <mutex>
#include <string>

namespace pi_detect
{

/// Tracks the objects of `detections` and publishes `tracks`. The ssd node does this for its own detections; this node
/// is for detections of other nodes, for example on another computer. Names and the network's scores come from
/// `labels`, the camera's calibration from `camera_info`, its turn from tf. All callbacks run on one own thread.
class TrackerRos
{
public:
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  TrackerRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~TrackerRos();
  TrackerRos(const TrackerRos&) = delete;
  TrackerRos& operator=(const TrackerRos&) = delete;

private:
  void updateSubscription();
  void onDetections(const Detection2DArrayConstPtr& message);
  void onLabels(const LabelArrayConstPtr& message);

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  const TrackerRosOptions options_;
  const std::string topic_;
  pi_node::WarningBoard warnings_;
  CameraTurn turn_;
  ObjectTracker tracker_;
  ros::Time last_followed_;
  Labels labels_;
  TrackerScores scores_;
  std::mutex subscription_mutex_;  // callbacks of advertise() may come while it is called
  ros::Publisher tracks_;
  ros::Subscriber detections_;
  ros::Subscriber labels_input_;
};

}  // namespace pi_detect
