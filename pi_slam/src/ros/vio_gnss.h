#pragma once

#include <pi_node/input_topic.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <sensor_msgs/NavSatFix.h>

#include "ros/vio_session.h"

namespace pi_slam
{

/// Brings positions by GNSS (sensor_msgs/NavSatFix on gnss_topic) to the map. Off without a topic.
class VioGnss
{
public:
  /// Callbacks come on the queue of the handle. The other arguments outlive it. @param topic  gets the name.
  VioGnss(const VioRosOptions& options, ros::NodeHandle node, VioSession* session, pi_node::InputTopic* topic,
          pi_node::WarningBoard* warnings);

private:
  void onFix(const sensor_msgs::NavSatFix& message);

  const VioRosOptions& options_;
  VioSession& session_;
  pi_node::InputTopic& topic_;
  pi_node::WarningBoard& warnings_;
  ros::Subscriber fixes_;
};

}  // namespace pi_slam
