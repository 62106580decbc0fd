#include "ros/vio_calibrator.h"

#include <pi_node/formatting.h>
#include <ros/console.h>
#include <tf2/exceptions.h>

#include <exception>
#include <filesystem>
#include <stdexcept>

#include "ros/conversions.h"

namespace pi_slam
{
namespace
{

using pi_node::sizeText;

/// Compares all but number and stamp.
bool sameCamera(sensor_msgs::CameraInfo a, const sensor_msgs::CameraInfo& b)
{
  a.header.seq = b.header.seq;
  a.header.stamp = b.header.stamp;
  return a == b;
}

}  // namespace

VioCalibrator::VioCalibrator(const VioRosOptions& options, VioPipeline::RuntimePtr runtime, const VioTopics& topics,
                             VioSession* session, pi_node::WarningBoard* warnings)
  : options_(options), runtime_(std::move(runtime)), topics_(topics), session_(*session), warnings_(*warnings)
{
  if (options.calibration.source != CalibrationSource::CAMERA_INFO)
  {
    file_calibration_ = loadCalibrationFiles(options.calibration, options.vio.imu);
    checkStereo(file_calibration_->cameras, std::string("calibration/") + toString(options.calibration.source));
  }
}

void VioCalibrator::setCameraInfo(int camera, const sensor_msgs::CameraInfoConstPtr& info)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (!infos_[camera] || !sameCamera(*infos_[camera], *info))
  {
    infos_[camera] = info;
    infos_changed_ = true;
  }
}

void VioCalibrator::setImuFrame(const std::string& frame)
{
  std::lock_guard<std::mutex> lock(mutex_);
  imu_frame_ = frame;
}

void VioCalibrator::prepare()
{
  const bool runs = session_.pipeline() != nullptr;
  const VioSession::Problem problem = session_.problem();
  sensor_msgs::CameraInfoConstPtr infos[2];
  std::string imu_frame;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (runs && !infos_changed_)
    {
      return;
    }
    if (!runs && problem.failed && !infos_changed_)
    {
      session_.setProblem(problem.text, true);  // the same would come out of it
      return;
    }
    infos[LEFT] = infos_[LEFT];
    infos[RIGHT] = infos_[RIGHT];
    imu_frame = imu_frame_;
  }
  if (!file_calibration_)
  {
    readCameraInfo(infos, imu_frame);
    return;
  }
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  if (mounting(imu_frame, "", &T_base_body, nullptr))
  {
    build(*file_calibration_, T_base_body);
  }
}

void VioCalibrator::readCameraInfo(const sensor_msgs::CameraInfoConstPtr infos[2], const std::string& imu_frame)
{
  for (const int camera : {LEFT, RIGHT})
  {
    if (!infos[camera])
    {
      session_.setProblem("no calibration: nothing on " + topics_.infos[camera].topic +
                              "; start the driver with a calibration, or set calibration/source",
                          false);
      return;
    }
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    infos_changed_ = infos_[LEFT] != infos[LEFT] || infos_[RIGHT] != infos[RIGHT];
  }
  // The messages are checked first: their faults do not depend on where the cameras are.
  FileCalibration result;
  result.imu = options_.vio.imu;
  try
  {
    result.cameras =
        fromCameraInfo(*infos[LEFT], *infos[RIGHT], options_.calibration.rectified, Eigen::Isometry3d::Identity(),
                       topics_.infos[LEFT].topic, topics_.infos[RIGHT].topic);
  }
  catch (const std::invalid_argument& error)
  {
    session_.setProblem(error.what(), true);
    return;
  }
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_body_left = Eigen::Isometry3d::Identity();
  if (!mounting(imu_frame, infos[LEFT]->header.frame_id, &T_base_body, &T_body_left))
  {
    std::lock_guard<std::mutex> lock(mutex_);
    infos_changed_ = true;  // tried again
    return;
  }
  for (MountedCamera* camera : {&result.cameras.left, &result.cameras.right})
  {
    camera->T_body_camera = T_body_left * camera->T_body_camera;
  }
  build(result, T_base_body);
}

bool VioCalibrator::mounting(const std::string& imu_frame, const std::string& left_frame,
                             Eigen::Isometry3d* T_base_body, Eigen::Isometry3d* T_body_left)
{
  const CalibrationOptions& calibration = options_.calibration;
  const bool needs_left = T_body_left != nullptr;
  const bool needs_imu_frame = calibration.imu_in_base.empty() || (needs_left && calibration.left_in_imu.empty());
  if (needs_imu_frame && imu_frame.empty())
  {
    session_.setProblem(
        "no calibration: " + topics_.imu.topic +
            (topics_.imu.messages == 0 ? " has not come yet, whose frame_id tells where the IMU is on tf"
                                       : " has no frame_id, which would tell where the IMU is on tf") +
            "; or set calibration/imu_in_base and calibration/left_in_imu",
        false);
    return false;
  }
  if (!calibration.imu_in_base.empty())
  {
    *T_base_body = parseTransform(calibration.imu_in_base, "calibration/imu_in_base");
  }
  else if (!lookUp(options_.base_link_frame, imu_frame, "calibration/imu_in_base", T_base_body))
  {
    return false;
  }
  if (needs_left && !calibration.left_in_imu.empty())
  {
    *T_body_left = parseTransform(calibration.left_in_imu, "calibration/left_in_imu");
  }
  else if (needs_left && !lookUp(imu_frame, left_frame, "calibration/left_in_imu", T_body_left))
  {
    return false;
  }
  return true;
}

bool VioCalibrator::lookUp(const std::string& parent, const std::string& child, const char* parameter,
                           Eigen::Isometry3d* T_parent_child)
{
  if (!tf_buffer_)
  {
    tf_buffer_ = std::make_unique<tf2_ros::Buffer>();
    tf_listener_ = std::make_unique<tf2_ros::TransformListener>(*tf_buffer_);
  }
  try
  {
    *T_parent_child = fromMsg(tf_buffer_->lookupTransform(parent, child, ros::Time(0)).transform);
    return true;
  }
  catch (const tf2::TransformException&)
  {
    session_.setProblem("no calibration: tf has no transform from " + parent + " to " +
                            (child.empty() ? "the camera, whose camera_info has no frame_id" : child) +
                            "; publish one, or set " + parameter,
                        false);
    return false;
  }
}

void VioCalibrator::build(const FileCalibration& calibration, const Eigen::Isometry3d& T_base_body)
{
  VioPipeline::Ptr pipeline;
  try
  {
    pipeline = VioPipeline::make(options_, runtime_, calibration, T_base_body);
  }
  catch (const std::exception& error)
  {
    session_.setProblem(std::string("this calibration cannot be used: ") + error.what(), true);
    return;
  }
  if (pipeline->mapper && !options_.map_file.empty())
  {
    loadMap(pipeline->mapper.get());
  }
  tf_listener_.reset();
  tf_buffer_.reset();
  const bool replaces = session_.replace(pipeline);
  const Eigen::Vector3d p_left_right =
      (pipeline->cameras.left.T_body_camera.inverse() * pipeline->cameras.right.T_body_camera).translation();
  ROS_INFO_STREAM_NAMED("vio", "calibration complete: "
                                   << sizeText(pipeline->cameras.left.model.width, pipeline->cameras.left.model.height)
                                   << " px, baseline " << p_left_right.norm() << " m");
  if (replaces)
  {
    warnings_.warn(topics_.infos[LEFT].topic + " or " + topics_.infos[RIGHT].topic +
                   " has changed: odometry and map begin anew");
  }
}

void VioCalibrator::loadMap(Mapper* mapper) const
{
  if (options_.save_map && !std::filesystem::exists(options_.map_file))
  {
    ROS_INFO_STREAM_NAMED("vio", "map_file: there is no " << options_.map_file << " yet; it is written at the end");
    return;
  }
  try
  {
    mapper->load(options_.map_file);
    ROS_INFO_STREAM_NAMED("vio", "map loaded from " << options_.map_file);
  }
  catch (const MapError& error)
  {
    ROS_ERROR_STREAM_NAMED("vio", "map_file: " << error.what() << "; goes on with an empty map");
  }
}

}  // namespace pi_slam
