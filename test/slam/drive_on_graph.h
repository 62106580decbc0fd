#pragma once

#include <pi_node/test_support/on_graph.h>
#include <pi_slam/imu_simulator.h>
#include <pi_slam/stereo_calibration.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include "renderer/stereo_renderer.h"

#include <functional>
#include <string>
#include <vector>

namespace pi_slam
{

using pi_node::test_support::Collector;
using pi_node::test_support::LogCollector;
using pi_node::test_support::until;

/// A short drive through a hall, rendered with 320x240 px at 15 Hz, IMU at 200 Hz: 0.8 s at rest, then 1.5 m/s.
struct SyntheticDrive
{
  StereoCalibration calibration;
  std::vector<ImuSample> imu;
  std::vector<pi_simulation::StereoFrame> frames;
  std::vector<Eigen::Isometry3d> T_world_body;  ///< at each sample of the IMU

  static SyntheticDrive make(double duration_s);
};

/// Publishes a drive as the sensors of a vehicle do, in place of its drivers.
class DriveOnGraph
{
public:
  /// What is done to a message before it goes out; false: it does not.
  struct Faults
  {
    std::function<bool(int camera, sensor_msgs::Image*)> image;
    std::function<bool(sensor_msgs::Imu*)> imu;
    std::function<void(int camera, sensor_msgs::CameraInfo*)> info;
  };

  explicit DriveOnGraph(SyntheticDrive drive);

  const SyntheticDrive& drive() const { return drive_; }
  /// IMU in base_link as tf has it.
  static Eigen::Isometry3d T_base_body();
  /// Waits until somebody listens to all sensors. @return false if nobody does.
  bool waitForListeners(double timeout_s);
  bool waitForNoListeners(double timeout_s);

  /// Publishes the part [from_s, to_s) of the drive, `speed` times as fast as it was, then goes on with the next call.
  /// @param later_s  added to all stamps.
  void play(double from_s, double to_s, double speed, double later_s, const Faults& faults);
  void play(double from_s, double to_s, double speed, double later_s = 0.0) { play(from_s, to_s, speed, later_s, {}); }
  /// Until a condition holds, in steps of 0.2 s; then returns true. The end of the drive: false.
  bool playUntil(double from_s, double speed, double later_s, const std::function<bool()>& condition,
                 const Faults& faults);

  sensor_msgs::CameraInfo info(int camera) const;

private:
  void publishInfo(const ros::Time& stamp, const Faults& faults);

  const SyntheticDrive drive_;
  ros::NodeHandle node_;
  tf2_ros::StaticTransformBroadcaster tf_static_;
  ros::Publisher imu_;
  ros::Publisher images_[2];
  ros::Publisher infos_[2];
};

}  // namespace pi_slam
