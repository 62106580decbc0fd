#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_bringup/euroc_dataset.h>
#include <pi_bringup/frame_prefetcher.h>
#include <pi_bringup/stereo_rectification.h>
#include <pi_os_transport/zero_copy/message.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>

#include <cstdint>
#include <string>

namespace pi_bringup
{

/// @throws std::invalid_argument unless 0 <= stamp_ns < 2^32 s.
ros::Time toTime(int64_t stamp_ns);

/// mono8 or bgr8 by the number of channels. Moves the pixels out of the frame, copies nothing.
sensor_msgs::ImagePtr toImage(Frame&& frame, const ros::Time& stamp, const std::string& frame_id);
/// The same into a message that is lent out, to whose memory the pixels are copied.
void toImage(const Frame& frame, const ros::Time& stamp, const std::string& frame_id,
             pi_os_transport::zero_copy::Message<sensor_msgs::Image>* image);

/// Header left empty. distortion_model is plumb_bob, whose fifth coefficient is 0.
sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& camera, const Rectification& rectification);

/// An ideal pinhole with its principal point in the middle: for cameras nobody has calibrated. Header left empty.
/// @param horizontal_fov_rad opening angle over the width of the picture, in (0, pi).
sensor_msgs::CameraInfo nominalCameraInfo(int width, int height, double horizontal_fov_rad);

/// orientation_covariance[0] = -1: there is no orientation. The other covariances come from the noise densities at
/// the nominal rate, or stay 0 (unknown) where the calibration has none.
sensor_msgs::Imu toImu(const ImuSample& sample, const ImuCalibration& calibration, const ros::Time& stamp,
                       const std::string& frame_id);

/// Pose of the base in the world, twist in the base frame.
/// @param T_base_body body frame of the recording in the base frame. The linear velocity is that of the body's origin,
/// expressed in the base frame. twist.covariance[0] = -1 if the recording has no velocity, [21] = -1 as it never has
/// angular velocity.
nav_msgs::Odometry toOdometry(const GroundTruthPose& pose, const Eigen::Isometry3d& T_base_body, const ros::Time& stamp,
                              const std::string& world_frame, const std::string& base_link_frame);

/// Maps child coordinates into the parent frame.
geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& T_parent_child, const ros::Time& stamp,
                                            const std::string& parent_frame, const std::string& child_frame);

}  // namespace pi_bringup
