#pragma once

#include "ros/sensors/stereo_camera_ros_options.h"
#include "sensors/video_source.h"

#include <camera_info_manager/camera_info_manager.h>
#include <pi_node/ros/warning_board.h>
#include <pi_os_transport/zero_copy/publisher.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <array>
#include <memory>
#include <string>

namespace pi_vehicle
{

/// Publishes pairs of pictures as `left/` and `right/image_raw` with `camera_info`. One thread at a time.
class StereoPictures
{
public:
  /// Advertises topics, and services `left/` and `right/set_camera_info`. @param warnings  outlives this object.
  StereoPictures(ros::NodeHandle node, const StereoCameraRosOptions& options, pi_node::WarningBoard* warnings);

  /// @param left, right  of one size. @return the stamp of the left one.
  ros::Time publish(const VideoPicture& left, const VideoPicture& right);

private:
  struct Side
  {
    std::string name;
    std::string frame;
    pi_os_transport::zero_copy::Publisher<sensor_msgs::Image> pictures;
    ros::Publisher infos;
    std::unique_ptr<camera_info_manager::CameraInfoManager> calibration;
  };

  pi_os_transport::zero_copy::Loan<sensor_msgs::Image> toImage(const Side& side, const cv::Mat& picture) const;
  sensor_msgs::CameraInfo cameraInfo(const Side& side, int width, int height) const;

  const StereoCameraRosOptions& options_;
  pi_node::WarningBoard& warnings_;
  std::array<Side, 2> sides_;
};

}  // namespace pi_vehicle
