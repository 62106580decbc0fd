#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Imu.h>
#include <topic_tools/shape_shifter.h>

#include <cstdint>
#include <vector>

#include "ros/vio_calibrator.h"
#include "ros/vio_outputs.h"
#include "ros/vio_session.h"
#include "ros/vio_topics.h"

namespace pi_slam
{

/// Subscribes to IMU, wheels, pictures and camera_info, checks their stamps and hands them on. A message with a fault
/// is logged and not used. Odometry restarts when time goes back.
class VioInputs
{
public:
  /// The callbacks come on the queues of the handles. All other arguments outlive it.
  VioInputs(const VioRosOptions& options, ros::NodeHandle imu_node, ros::NodeHandle input_node, VioTopics* topics,
            VioSession* session, VioCalibrator* calibrator, VioOutputs* outputs, pi_node::WarningBoard* warnings,
            VioDiagnostics* diagnostics);

private:
  void onImu(const sensor_msgs::ImuConstPtr& message);
  void onWheels(const topic_tools::ShapeShifter::ConstPtr& message);
  /// Notes the stamp; odometry restarts if it goes back.
  void watchImuTime(int64_t stamp_ns);
  void onImage(int camera, const pi_os_transport::zero_copy::ImageHandle& message);
  void watchPictureTime(int camera, int64_t stamp_ns);
  /// Throws std::invalid_argument for a picture that cannot be used.
  cv::Mat read(int camera, const pi_os_transport::zero_copy::ImageHandle& message, const VioPipeline& pipeline) const;

  const VioRosOptions& options_;
  VioTopics& topics_;
  VioSession& session_;
  VioCalibrator& calibrator_;
  VioOutputs& outputs_;
  pi_node::WarningBoard& warnings_;
  VioDiagnostics& diagnostics_;
  int64_t last_picture_ns_[2] = {0, 0};  ///< of each camera, as one may lag behind the other; 0: none
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace pi_slam
