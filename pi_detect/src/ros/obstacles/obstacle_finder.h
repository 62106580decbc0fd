#pragma once

#include <pi_detect/object_tracker.h>
#include <pi_detect/ros/message_picture.h>
#include <pi_detect/stereo_obstacles.h>
#include <sensor_msgs/CameraInfo.h>
#include <stereo_msgs/DisparityImage.h>

#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <string>

#include "ros/obstacles/obstacles_diagnostics.h"
#include "ros/obstacles/obstacles_ros_options.h"
#include "ros/obstacles/stereo_camera.h"
#include "ros/obstacles/vehicle_motion.h"

namespace pi_detect
{

enum Side
{
  LEFT,
  RIGHT,
};

/// Resolved names of the inputs, for messages.
struct StereoTopics
{
  std::string pictures[2];
  std::string infos[2];
  std::string disparity;
};

/// A stereo pair or a disparity image, with the calibration that is known.
struct StereoJob
{
  StereoPair pair;
  stereo_msgs::DisparityImageConstPtr disparity;
  sensor_msgs::CameraInfoConstPtr infos[2];

  std_msgs::Header header() const
  {
    return disparity ? disparity->header : pi_os_transport::zero_copy::standardHeader(pair.left->header);
  }
};

/// Why there can be no obstacles.
struct ObstacleProblem
{
  std::string text;     ///< empty: there can
  bool failed = false;  ///< an error, not something to wait for
};

/// Finds obstacles in single stereo pairs. Keeps what is built on calibration and mounting as long as they stay.
/// Not thread safe.
class ObstacleFinder
{
public:
  /// @param options, motion  outlive it.
  ObstacleFinder(const ObstaclesRosOptions& options, StereoTopics topics, const VehicleMotion* motion,
                 std::shared_ptr<StereoStages> stages);

  /// Takes calibration and mounting of the cameras over. @return the problem if they are not known or not usable.
  ObstacleProblem prepare(const StereoJob& job);
  /// After prepare() without problem. @throws std::invalid_argument naming the topic whose picture cannot be used.
  StereoObstacles::Result find(const StereoJob& job, const StereoObstacles::PoseSource& pose, PairFigures* figures);

  // After prepare() without problem:
  const StereoGeometry& geometry() const { return camera_->geometry; }
  const Eigen::Isometry3d& T_base_left() const { return T_base_left_; }  ///< left rectified optical frame
  const cv::Mat& disparity() const { return stereo_->disparity(); }      ///< of the last pair
  double minDepth() const { return min_depth_m_; }  ///< from which on the last pair was measured, along the axis [m]
  /// A box of the left raw picture in the rectified one. Only without tracks_rectified.
  Box rectify(const Box& raw) const { return rectifiers_[LEFT]->rectify(raw); }

private:
  bool usesInfo(Side side) const { return side == LEFT || options_.source != StereoSource::DISPARITY; }
  bool hasChanged(Side side, const StereoJob& job) const;
  /// @throws std::invalid_argument for a wrong calibration.
  StereoCamera cameraOf(const StereoJob& job);
  StereoObstacles::Result findIn(const stereo_msgs::DisparityImage& disparity, const StereoObstacles::PoseSource& pose);
  StereoObstacles::Result findIn(const StereoPair& pair, const StereoObstacles::PoseSource& pose, PairFigures* figures);

  const ObstaclesRosOptions& options_;
  const StereoTopics topics_;
  const VehicleMotion* const motion_;
  const std::shared_ptr<StereoStages> stages_;
  sensor_msgs::CameraInfoConstPtr infos_[2];
  std::optional<StereoCamera> camera_;
  std::unique_ptr<Rectifier> rectifiers_[2];
  Eigen::Isometry3d T_base_left_ = Eigen::Isometry3d::Identity();
  std::unique_ptr<StereoObstacles> stereo_;
  double min_depth_m_ = 0.0;
  UsedBits used_bits_;  ///< of both cameras
};

}  // namespace pi_detect
