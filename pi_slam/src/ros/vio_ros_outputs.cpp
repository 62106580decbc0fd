// The threads vio_output and vio_service of VioRos.

#include <pi_node/formatting.h>
#include "ros/conversions.h"
#include "ros/vio_ros.h"
#include <tf2/exceptions.h>

#include <boost/make_shared.hpp>
#include <exception>
#include <stdexcept>

namespace pi_slam
{
namespace
{

using pi_node::format;
using pi_node::seconds;
using pi_node::sizeText;

constexpr char NO_ODOMETRY[] = "; no odometry until this is right";

}  // namespace

// --------------------------------------------------------------------------------------------------------- vio_output

void VioRos::tick()
{
  prepare();
  watchInputs();
}

void VioRos::prepare()
{
  sensor_msgs::CameraInfoConstPtr infos[2];
  std::string imu_frame;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (pipeline_ && !infos_changed_)
    {
      return;
    }
    if (!pipeline_ && problem_failed_ && !infos_changed_)
    {
      warnings_.error(problem_ + NO_ODOMETRY);
      return;  // the same would come out of it
    }
    infos[LEFT] = infos_[LEFT];
    infos[RIGHT] = infos_[RIGHT];
    imu_frame = imu_frame_;
  }
  const CalibrationOptions& calibration = options_.calibration;
  const bool cameras_by_message = !file_calibration_;
  for (const int camera : {LEFT, RIGHT})
  {
    if (cameras_by_message && !infos[camera])
    {
      setProblem("no calibration: nothing on " + info_inputs_[camera].topic +
                     "; start the driver with a calibration, or set calibration/source",
                 false);
      return;
    }
  }
  // The messages are judged first: what is wrong with them is wrong wherever the cameras are.
  FileCalibration result;
  if (file_calibration_)
  {
    result = *file_calibration_;
  }
  else
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      infos_changed_ = infos_[LEFT] != infos[LEFT] || infos_[RIGHT] != infos[RIGHT];
    }
    try
    {
      result.imu = options_.vio.imu;
      result.cameras = fromCameraInfo(*infos[LEFT], *infos[RIGHT], calibration.rectified, Eigen::Isometry3d::Identity(),
                                      info_inputs_[LEFT].topic, info_inputs_[RIGHT].topic);
    }
    catch (const std::invalid_argument& error)
    {
      setProblem(error.what(), true);
      return;
    }
  }
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_body_left = Eigen::Isometry3d::Identity();
  if (!mounting(imu_frame, cameras_by_message ? infos[LEFT]->header.frame_id : "", &T_base_body, &T_body_left))
  {
    std::lock_guard<std::mutex> lock(mutex_);
    infos_changed_ = true;  // so that it is tried again
    return;
  }
  if (cameras_by_message)
  {
    for (MountedCamera* camera : {&result.cameras.left, &result.cameras.right})
    {
      camera->T_body_camera = T_body_left * camera->T_body_camera;
    }
  }
  build(result, T_base_body);
}

bool VioRos::mounting(const std::string& imu_frame, const std::string& left_frame, Eigen::Isometry3d* T_base_body,
                      Eigen::Isometry3d* T_body_left)
{
  const CalibrationOptions& calibration = options_.calibration;
  const bool needs_left = !file_calibration_;
  const bool needs_imu_frame = calibration.imu_in_base.empty() || (needs_left && calibration.left_in_imu.empty());
  if (needs_imu_frame && imu_frame.empty())
  {
    setProblem("no calibration: " + imu_input_.topic +
                   (imu_input_.messages == 0 ? " has not come yet, whose frame_id tells where the IMU is on tf"
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

bool VioRos::lookUp(const std::string& parent, const std::string& child, const char* parameter,
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
    setProblem("no calibration: tf has no transform from " + parent + " to " +
                   (child.empty() ? "the camera, whose camera_info has no frame_id" : child) +
                   "; publish one, or set " + parameter,
               false);
    return false;
  }
}

void VioRos::build(const FileCalibration& calibration, const Eigen::Isometry3d& T_base_body)
{
  const auto pipeline = std::make_shared<Pipeline>();
  pipeline->cameras = calibration.cameras;
  pipeline->vio_options = options_.vio;
  pipeline->vio_options.imu = calibration.imu;
  pipeline->T_base_body = T_base_body;
  pipeline->gyro_variance =
      calibration.imu.gyro_noise_density * calibration.imu.gyro_noise_density * calibration.imu.rate_hz;
  try
  {
    if (options_.mapping)
    {
      pipeline->mapper = std::make_shared<Mapper>(calibration.cameras, options_.mapper, runtime_);
    }
    pipeline->vio = makeVio(pipeline->cameras, pipeline->vio_options, pipeline->mapper);
  }
  catch (const std::exception& error)
  {
    setProblem(std::string("this calibration cannot be used: ") + error.what(), true);
    return;
  }
  if (pipeline->mapper && !options_.map_file.empty())
  {
    try
    {
      pipeline->mapper->load(options_.map_file);
      ROS_INFO_STREAM_NAMED("vio", "map loaded from " << options_.map_file);
    }
    catch (const MapError& error)
    {
      ROS_ERROR_STREAM_NAMED("vio", "map_file: " << error.what() << "; goes on with an empty map");
    }
  }
  tf_listener_.reset();
  tf_buffer_.reset();
  std::lock_guard<std::mutex> restart_lock(restart_mutex_);
  const bool replaces = this->pipeline() != nullptr;
  replacePipeline(pipeline);
  const Eigen::Vector3d p_left_right =
      (pipeline->cameras.left.T_body_camera.inverse() * pipeline->cameras.right.T_body_camera).translation();
  ROS_INFO_STREAM_NAMED("vio", "calibration complete: "
                                   << sizeText(pipeline->cameras.left.model.width, pipeline->cameras.left.model.height)
                                   << " px, baseline " << p_left_right.norm() << " m");
  if (replaces)
  {
    warnings_.warn(info_inputs_[LEFT].topic + " or " + info_inputs_[RIGHT].topic +
                   " has changed: odometry and map begin anew");
  }
}

void VioRos::watchInputs()
{
  std::vector<const Input*> inputs = {&imu_input_, &picture_inputs_[LEFT], &picture_inputs_[RIGHT]};
  for (const Input* input : inputs)
  {
    const double silent_s = input->silentSeconds();
    if (silent_s > options_.input_timeout_s)
    {
      warnings_.warn(input->topic + ": nothing for " + format("%.1f", silent_s) +
                     " s; check that the driver runs and that the topic is its");
    }
  }
}

void VioRos::publishPath()
{
  const PipelinePtr pipeline = this->pipeline();
  if (path_.getNumSubscribers() == 0 || !pipeline)
  {
    return;
  }
  std::vector<std::pair<int64_t, Eigen::Isometry3d>> poses;  // T_map_body
  if (pipeline->mapper)
  {
    poses = pipeline->mapper->path();
  }
  std::vector<std::pair<int64_t, Eigen::Isometry3d>> odom_path;
  Eigen::Isometry3d T_map_odom;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    T_map_odom = T_map_odom_;
    odom_path.assign(odom_path_.begin(), odom_path_.end());
  }
  // Where odometry goes on after the map's last keyframe; all of it if that is of another time, before a jump.
  const int64_t from_ns = !poses.empty() && poses.back().first <= last_odometry_ns_ ? poses.back().first : 0;
  for (const auto& [stamp_ns, T_odom_body] : odom_path)
  {
    if (stamp_ns > from_ns)
    {
      poses.emplace_back(stamp_ns, T_map_odom * T_odom_body);
    }
  }
  if (poses.empty())
  {
    return;
  }
  const Eigen::Isometry3d T_body_base = pipeline->T_base_body.inverse();
  const size_t most = static_cast<size_t>(options_.path_length);
  const size_t stride = (poses.size() + most - 1) / most;
  const auto path = boost::make_shared<nav_msgs::Path>();
  path->header.frame_id = options_.map_frame;
  path->header.stamp = toTime(poses.back().first);
  // Counted from the newest pose, which is always there.
  for (size_t i = (poses.size() - 1) % stride; i < poses.size(); i += stride)
  {
    geometry_msgs::PoseStamped pose;
    pose.header.frame_id = options_.map_frame;
    pose.header.stamp = toTime(poses[i].first);
    pose.pose = toMsg(poses[i].second * T_body_base);
    path->poses.push_back(pose);
  }
  path_.publish(path);
}

void VioRos::publishPoints()
{
  const PipelinePtr pipeline = this->pipeline();
  const int64_t stamp_ns = last_odometry_ns_;
  if (points_.getNumSubscribers() == 0 || !pipeline || !pipeline->mapper || stamp_ns == 0)
  {
    return;
  }
  points_.publish(toPointCloud(pipeline->mapper->cloud(), toTime(stamp_ns), options_.map_frame));
}

void VioRos::publishTracks(const Tracks& tracks, const CameraModel& left, const CameraModel& right)
{
  try
  {
    const cv::Mat black_left = cv::Mat::zeros(left.height, left.width, CV_8UC1);
    const cv::Mat black_right = cv::Mat::zeros(right.height, right.width, CV_8UC1);
    const cv::Mat picture =
        drawTracks(tracks.pair.left.empty() ? black_left : tracks.pair.left,
                   tracks.pair.right.empty() ? black_right : tracks.pair.right, tracks.features, tracks.earlier);
    std::string frame;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      frame = left_frame_;
    }
    tracks_.publish(toImage(picture, toTime(tracks.pair.stamp_ns), frame));
  }
  catch (const std::exception& error)
  {
    warnings_.warn(std::string("debug/tracks: ") + error.what());
  }
  drawing_ = false;
}

void VioRos::publishDiagnostics()
{
  VioFigures figures;
  const auto add = [&figures](const Input& input) {
    figures.inputs.push_back({input.topic, input.messages, input.silentSeconds()});
  };
  add(imu_input_);
  add(picture_inputs_[LEFT]);
  add(picture_inputs_[RIGHT]);
  PipelinePtr pipeline;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    pipeline = pipeline_;
    figures.problem = problem_;
    figures.failed = problem_failed_;
    figures.dropped_pairs = dropped_pairs_;
    figures.late_pictures = matcher_.late();
    figures.single_pictures = matcher_.single();
  }
  figures.odometries = odometries_;
  figures.delay_s = seconds(delay_ns_);
  if (pipeline && pipeline->mapper)
  {
    figures.map = pipeline->mapper->statistics();
  }
  diagnostics_.update(figures);
}

void VioRos::setProblem(const std::string& problem, bool failed)
{
  {
    PipelinePtr before;
    std::lock_guard<std::mutex> lock(mutex_);
    if (problem_ != problem)
    {
      waiting_since_ = Clock::now();
    }
    problem_ = problem;
    problem_failed_ = failed;
    if (failed && pipeline_)
    {
      pipeline_.swap(before);
      ++generation_;
      pairs_.clear();
      matcher_.clear();
    }
  }
  if (failed)
  {
    warnings_.error(problem + NO_ODOMETRY);
  }
  else if (std::chrono::duration<double>(Clock::now() - waiting_since_).count() > options_.input_timeout_s)
  {
    warnings_.warn(problem);
  }
}

// -------------------------------------------------------------------------------------------------------- vio_service

std::shared_ptr<Mapper> VioRos::mapperFor(const std::string& file, std::string* problem) const
{
  if (file.empty() || file.front() != '/')
  {
    *problem = "file = \"" + file + "\", must be an absolute path: the node's working folder is not the caller's";
    return nullptr;
  }
  if (!options_.mapping)
  {
    *problem = "mapping = false: there is no map";
    return nullptr;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  if (!pipeline_)
  {
    *problem = "there is no map yet: " + problem_;
    return nullptr;
  }
  return pipeline_->mapper;
}

bool VioRos::saveMap(SaveMap::Request& request, SaveMap::Response& response)
{
  const std::shared_ptr<Mapper> mapper = mapperFor(request.file, &response.message);
  if (!mapper)
  {
    return true;
  }
  try
  {
    mapper->flush();
    const MapStatistics statistics = mapper->statistics();
    mapper->save(request.file);
    response.success = true;
    response.message = std::to_string(statistics.keyframes) + " keyframes with " +
                       std::to_string(statistics.landmarks) + " landmarks written to " + request.file;
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  return true;
}

bool VioRos::loadMap(LoadMap::Request& request, LoadMap::Response& response)
{
  const std::shared_ptr<Mapper> mapper = mapperFor(request.file, &response.message);
  if (!mapper)
  {
    return true;
  }
  try
  {
    mapper->load(request.file);
    response.success = true;
    response.message = std::to_string(mapper->statistics().keyframes) + " keyframes read from " + request.file +
                       "; localised as soon as a place is recognised";
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  return true;
}

bool VioRos::reset(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  if (!pipeline())
  {
    std::lock_guard<std::mutex> lock(mutex_);
    response.message = "there is nothing to reset yet: " + problem_;
    return true;
  }
  restart("~reset: odometry and map begin anew", true);
  response.success = true;
  response.message = "odometry and map begin anew";
  return true;
}

}  // namespace pi_slam
