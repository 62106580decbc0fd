#pragma once

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/Twist.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/ros/time.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <pi_slam/camera_model.h>
#include <pi_slam/imu_sample.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>
#include "inertial/imu_propagator.h"
#include "inertial/wheels.h"
#include "map/mapper.h"

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace pi_slam
{

using pi_node::fromMsg;  // of stamps
using pi_node::toTime;

/// @throws std::invalid_argument for a message without angular velocity or acceleration (first element
///         of the covariance is -1).
ImuSample fromMsg(const sensor_msgs::Imu& imu);

/// Speed and yaw rate of a base, in its own frame.
WheelSample toWheelSample(const ros::Time& stamp, const geometry_msgs::Twist& twist);

/// The picture in grey levels, CV_8UC1. mono8 and 8UC1 stay where they are: the result shares the message's buffer and
/// keeps the message alive, and must not be written to. bgr8, rgb8, bgra8, rgba8, mono16, bayer_* and YUV are
/// converted.
/// @throws std::invalid_argument naming encoding, size or step that cannot be used.
cv::Mat fromMsg(const sensor_msgs::ImageConstPtr& image);
cv::Mat fromMsg(const pi_os_transport::zero_copy::ImageHandle& image);

/// Camera of a camera_info: K and D of the picture as the lens shows it, or P of the rectified one; binning and region
/// of interest are taken into account.
/// @throws std::invalid_argument naming the field that is wrong: not calibrated, a distortion that is not plumb_bob,
///         rational_polynomial without thin prism and tilt, equidistant or none.
CameraModel fromMsg(const sensor_msgs::CameraInfo& info, bool rectified);

geometry_msgs::Pose toMsg(const Eigen::Isometry3d& T_parent_child);
Eigen::Isometry3d fromMsg(const geometry_msgs::Pose& pose);
Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& transform);

/// Maps child coordinates into the parent frame.
geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& T_parent_child, const ros::Time& stamp,
                                            const std::string& parent_frame, const std::string& child_frame);

/// Pose of the base in odom, twist of the base in its own frame, both with covariance in the order of ROS: x, y, z,
/// rotation about X, Y, Z; of the pose about the fixed axes of odom, of the twist in the base frame. The velocity is
/// that of the base's origin: body and base turn together.
/// @param T_base_body    body (IMU) frame in the base frame.
/// @param gyro_variance  of one sample per axis [rad^2/s^2], which the angular rate carries besides its bias.
nav_msgs::Odometry toOdometry(const PropagatedState& propagated, const Eigen::Isometry3d& T_base_body,
                              double gyro_variance, const std::string& odom_frame, const std::string& base_link_frame);

/// Pose of the base in map. Of the covariance x, y, z and heading are the map's, roll and pitch those of odometry.
/// @param covariance  of x, y, z of the body in map [m] and heading [rad].
geometry_msgs::PoseWithCovarianceStamped toMapPose(const nav_msgs::Odometry& odometry,
                                                   const Eigen::Isometry3d& T_map_odom,
                                                   const Eigen::Matrix4d& covariance,
                                                   const Eigen::Isometry3d& T_base_body, const std::string& map_frame);

/// Fields x, y, z [m] and intensity (grey level, 0 to 255), each a float.
sensor_msgs::PointCloud2Ptr toPointCloud(const std::vector<MapPoint>& points, const ros::Time& stamp,
                                         const std::string& frame);

/// Its cells must lie along the axes of the frame.
/// @throws std::invalid_argument for an origin that is turned, or another number of cells than the size says.
OccupancyCells fromMsg(const nav_msgs::OccupancyGrid& message);
nav_msgs::OccupancyGridPtr toMsg(const OccupancyCells& grid, const ros::Time& stamp, const std::string& frame);

/// @param picture  CV_8UC1 (mono8) or CV_8UC3 (bgr8); copied.
sensor_msgs::ImagePtr toImage(const cv::Mat& picture, const ros::Time& stamp, const std::string& frame);

}  // namespace pi_slam
