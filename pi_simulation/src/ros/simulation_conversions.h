#pragma once

#include "vehicle/vehicle_simulation.h"

#include <nav_msgs/Odometry.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_os_transport/zero_copy/message.h>
#include <pi_slam/camera_model.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace pi_simulation
{

/// Pose in map_frame, twist in base_link_frame. Covariances are 0, as this is the truth.
nav_msgs::Odometry toOdometry(const TruePose& pose, const std::string& map_frame, const std::string& base_link_frame);

/// Pose in odom_frame, twist in base_link_frame. Covariances are 0: stock bases tell none, or constants.
nav_msgs::Odometry toOdometry(const BaseOdometry& odometry, const std::string& odom_frame,
                              const std::string& base_link_frame);

/// All obstacles, each with score 1 and the age 0. Label: the class; class_id and track_id -1.
/// @param outline   of the vehicle, in base_link. @param velocity  of the vehicle, along its axes [m/s].
pi_detect::ObstacleArray toObstacles(const std::vector<TrueObstacle>& obstacles, const OrientedBox& outline,
                                     const Eigen::Vector2d& velocity, const ros::Time& stamp,
                                     const std::string& base_link_frame);

/// Without orientation; covariances from the noise densities at the rate.
sensor_msgs::Imu toImu(const pi_slam::ImuSample& sample, const pi_slam::ImuSimulatorOptions& imu,
                       const std::string& frame);

/// mono8 or bgr8, by the number of channels. Copies the pixels.
void toImage(const cv::Mat& picture, const ros::Time& stamp, const std::string& frame,
             pi_os_transport::zero_copy::Message<sensor_msgs::Image>* image);

/// Of a camera without distortion in a rectified pair. Header left empty.
/// @param baseline  0: the left one [m].
sensor_msgs::CameraInfo toCameraInfo(const pi_slam::CameraModel& camera, double baseline);

}  // namespace pi_simulation
