#pragma once

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pi_node/ros/warning_board.h>
#include <pi_offload/SetEta.h>
#include <ros/ros.h>
#include <sensor_msgs/BatteryState.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "client/offload_client.h"
#include "ros/coordinator_diagnostics.h"
#include "ros/coordinator_ros_options.h"
#include "ros/map_frame.h"

namespace pi_offload
{

/// Tells the engine where the vehicle is, where it goes, and how much time weighs against energy: from `odometry`,
/// `route`, `battery` and ~set_eta. Runs on the service thread.
class VehicleInputs
{
public:
  /// @param options, client, map, warnings  outlive this object.
  VehicleInputs(ros::NodeHandle node, const CoordinatorRosOptions* options, OffloadClient* client, MapFrame* map,
                pi_node::WarningBoard* warnings);

  /// Forgets the position if no odometry came for too long. Call this regularly.
  void watch();
  const VehicleState& vehicle() const { return vehicle_; }
  bool setEta(SetEta::Request& request, SetEta::Response& response);
  void fill(CoordinatorFigures* figures) const;

private:
  void onOdometry(const nav_msgs::OdometryConstPtr& message);
  void onRoute(const nav_msgs::PathConstPtr& message);
  void onBattery(const sensor_msgs::BatteryStateConstPtr& message);

  const CoordinatorRosOptions* const options_;
  OffloadClient* const client_;
  MapFrame* const map_;
  pi_node::WarningBoard* const warnings_;
  VehicleState vehicle_;
  int64_t odometry_at_ns_ = 0;  ///< 0: none came
  bool eta_by_battery_ = true;
  std::optional<double> charge_;
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace pi_offload
