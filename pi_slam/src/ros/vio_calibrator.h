#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "ros/calibration_loader.h"
#include "ros/vio_session.h"
#include "ros/vio_topics.h"

namespace pi_slam
{

/// Collects the calibration from files or camera_info, and from parameters or tf, and starts odometry when it is
/// complete or has changed.
class VioCalibrator
{
public:
  /// Reads the files. All arguments outlive it. @throws CalibrationError, std::invalid_argument for files.
  VioCalibrator(const VioRosOptions& options, VioPipeline::RuntimePtr runtime, const VioTopics& topics,
                VioSession* session, pi_node::WarningBoard* warnings);

  void setCameraInfo(int camera, const sensor_msgs::CameraInfoConstPtr& info);  ///< any thread
  void setImuFrame(const std::string& frame);                                   ///< any thread

  /// Starts odometry if the calibration is complete; else reports what is missing. One thread, several times a second.
  void prepare();

private:
  void readCameraInfo(const sensor_msgs::CameraInfoConstPtr infos[2], const std::string& imu_frame);
  /// Where the sensors are, by parameters or tf. @return false if that is not known yet.
  bool mounting(const std::string& imu_frame, const std::string& left_frame, Eigen::Isometry3d* T_base_body,
                Eigen::Isometry3d* T_body_left);
  bool lookUp(const std::string& parent, const std::string& child, const char* parameter,
              Eigen::Isometry3d* T_parent_child);
  void build(const FileCalibration& calibration, const Eigen::Isometry3d& T_base_body);
  void loadMap(Mapper* mapper) const;

  const VioRosOptions& options_;
  const VioPipeline::RuntimePtr runtime_;
  const VioTopics& topics_;
  VioSession& session_;
  pi_node::WarningBoard& warnings_;
  std::optional<FileCalibration> file_calibration_;
  std::unique_ptr<tf2_ros::Buffer> tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;

  std::mutex mutex_;  ///< of all below
  sensor_msgs::CameraInfoConstPtr infos_[2];
  bool infos_changed_ = false;
  std::string imu_frame_;
};

}  // namespace pi_slam
