#pragma once

#include <nav_msgs/OccupancyGrid.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

#include "ros/vio_session.h"

namespace pi_slam
{

/// Brings the grid around the vehicle (`grid`, nav_msgs/OccupancyGrid in odom, as pi_detect makes it) to the map, and
/// publishes what the map has of it: `map`, latched.
class VioGrid
{
public:
  /// Callbacks come on the queue of the handle. The other arguments outlive it.
  VioGrid(const VioRosOptions& options, ros::NodeHandle node, VioSession* session, pi_node::WarningBoard* warnings);

  /// On the thread of the handle's queue; while somebody listens.
  void publish();

private:
  void onGrid(const nav_msgs::OccupancyGrid& message);

  const VioRosOptions& options_;
  VioSession& session_;
  pi_node::WarningBoard& warnings_;
  ros::Time newest_;     ///< stamp of the last grid taken
  ros::Time published_;  ///< likewise, when the map was published last: without another one it is the same
  ros::Publisher map_;
  ros::Subscriber grid_;
};

}  // namespace pi_slam
