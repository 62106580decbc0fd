#pragma once

#include <pi_detect/detection.h>
#include <pi_detect/stereo_obstacles.h>
#include <pi_node/ros/time.h>
#include <pi_node/stereo_pairs.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <sensor_msgs/CameraInfo.h>
#include <stereo_msgs/DisparityImage.h>

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

#include "ros/lens.h"

namespace pi_detect
{

/// A rectified stereo camera from camera_info messages. Takes binning and region of interest into account. This is own
/// code because image_geometry does not check that two cameras are calibrated as a pair, which is most of the code.
struct StereoCamera
{
  StereoGeometry geometry;
  /// From the camera's frame (header.frame_id) to the rectified one: R of the left camera_info.
  Eigen::Matrix3d R_rectified_left = Eigen::Matrix3d::Identity();

  /// @param left_name, right_name  of the topics, for messages.
  /// @throws std::invalid_argument naming topic, field, value and way out: not calibrated, swapped, different sizes.
  static StereoCamera fromMsg(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right,
                              const std::string& left_name, const std::string& right_name);
  /// With focal length and baseline of the disparity image.
  static StereoCamera fromMsg(const sensor_msgs::CameraInfo& left, const stereo_msgs::DisparityImage& disparity,
                              const std::string& left_name);
};

/// Compares all but number and stamp.
bool sameCamera(sensor_msgs::CameraInfo a, const sensor_msgs::CameraInfo& b);

/// Rectifies the raw pictures of one camera: plumb_bob, rational_polynomial and equidistant lenses.
class Rectifier
{
public:
  /// @param name  of the topic. @throws std::invalid_argument naming topic, field and value.
  Rectifier(const sensor_msgs::CameraInfo& info, const std::string& name);

  /// @param raw  CV_8UC1 of the camera_info's size.
  cv::Mat rectify(const cv::Mat& raw) const;
  /// The bounding box of a raw picture's box in the rectified one.
  Box rectify(const Box& raw) const;

private:
  Lens lens_;
  cv::Matx33d R_;
  cv::Matx33d P_;   ///< its first three columns
  cv::Mat map_xy_;  ///< fixed point, as cv::remap() likes it
  cv::Mat map_fraction_;
};

/// Two pictures taken at the same time.
struct StereoPair
{
  pi_os_transport::zero_copy::ImageHandle left;
  pi_os_transport::zero_copy::ImageHandle right;
};

struct StampOfPicture
{
  int64_t operator()(const pi_os_transport::zero_copy::ImageHandle& picture) const
  {
    return pi_node::fromMsg(picture->header.stamp);
  }
};
using StereoPairing = pi_node::StereoPairs<pi_os_transport::zero_copy::ImageHandle, StampOfPicture>;

}  // namespace pi_detect
