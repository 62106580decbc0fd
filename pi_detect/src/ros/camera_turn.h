#pragma once

#include <pi_detect/picture_motion.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <memory>
#include <mutex>
#include <string>

#include "ros/lens.h"

namespace pi_detect
{

/// How a camera turned between two pictures, from tf and its calibration. The way that it drove is left out: it moves
/// far things little, and how far a thing is, a picture does not tell. All functions may be called by any thread.
class CameraTurn
{
public:
  /// @param node        whose thread takes camera_info.
  /// @param odom_frame  in which the surroundings stand still; empty: tf is not used.
  /// @param info_topic  calibration of the camera.
  /// @param rectified   whether its pictures are rectified.
  CameraTurn(const ros::NodeHandle& node, const std::string& odom_frame, const std::string& info_topic, bool rectified);
  CameraTurn(const CameraTurn&) = delete;
  CameraTurn& operator=(const CameraTurn&) = delete;

  /// Subscribes to tf and camera_info, or ends that.
  void listen(bool wanted);

  /// @param frame  of the camera.
  /// @return empty if tf does not reach from the first to near the second stamp (it is not waited for), or if the
  ///         calibration is missing or wrong.
  PictureMotion between(const ros::Time& before, const ros::Time& now, const std::string& frame) const;

private:
  struct Camera
  {
    Lens lens;
    Eigen::Vector2d size;  ///< [px]
  };
  void onInfo(const sensor_msgs::CameraInfoConstPtr& info);

  ros::NodeHandle node_;
  const std::string odom_frame_;
  const std::string info_topic_;
  const bool rectified_;
  tf2_ros::Buffer buffer_;
  mutable std::mutex mutex_;  ///< of all below
  std::unique_ptr<tf2_ros::TransformListener> listener_;
  ros::Subscriber info_;
  std::shared_ptr<const Camera> camera_;  ///< null: unknown
};

/// Whether the pictures of a topic are rectified, by image_pipeline's names.
bool isRectified(const std::string& image_topic);

}  // namespace pi_detect
