#pragma once

#include <nav_msgs/Path.h>
#include <pi_bringup/euroc_dataset.h>
#include <pi_bringup/ros/conversions.h>
#include <tf2_msgs/TFMessage.h>

#include <optional>
#include <string>
#include <vector>

namespace pi_bringup
{

/// Frame names and the mounting of the recording's body frame on the vehicle.
struct EurocFrames
{
  std::string map_frame = "map";              ///< world frame of the ground truth
  std::string base_link_frame = "base_link";  ///< x forward, y left, z up
  std::string imu_frame = "imu_link";
  std::string left_frame = "left_optical";
  std::string right_frame = "right_optical";
  /// x y z [m], qx qy qz qw of the body frame in the base frame. The MAVs' body frame has x up, y right, z forward.
  std::vector<double> body_in_base = {0.0, 0.0, 0.0, 0.70710678, 0.0, 0.70710678, 0.0};

  /// @throws std::invalid_argument naming the field, its value and the bound.
  void validate() const;
  /// body_in_base as a transform; validate() has passed.
  Eigen::Isometry3d T_base_body() const;
};

/// Everything a recording becomes on topics, apart from when it is due: shared by the player and by euroc_to_bag, so
/// that both give the same messages.
class EurocMessages
{
public:
  /// @throws std::invalid_argument for invalid frames or a stereo pair of unequal sizes.
  /// @param dataset must outlive the object.
  EurocMessages(const EurocDataset& dataset, const EurocFrames& frames);

  bool hasRight() const { return dataset_.right.has_value(); }
  sensor_msgs::ImagePtr image(bool left, Frame&& frame, const ros::Time& stamp) const;
  void image(bool left, const Frame& frame, const ros::Time& stamp,
             pi_os_transport::zero_copy::Message<sensor_msgs::Image>* image) const;
  sensor_msgs::CameraInfo cameraInfo(bool left, const ros::Time& stamp) const;
  sensor_msgs::Imu imu(size_t index, const ros::Time& stamp) const;
  nav_msgs::Odometry groundTruth(size_t index, const ros::Time& stamp) const;
  /// map -> base_link of an odometry message made by groundTruth().
  static geometry_msgs::TransformStamped baseTransform(const nav_msgs::Odometry& odometry);
  /// base_link -> imu_link, left_optical, right_optical.
  tf2_msgs::TFMessage staticTransforms(const ros::Time& stamp) const;

private:
  const EurocDataset& dataset_;
  const EurocFrames frames_;
  Eigen::Isometry3d T_base_body_;
  sensor_msgs::CameraInfo left_info_;
  sensor_msgs::CameraInfo right_info_;
};

}  // namespace pi_bringup
