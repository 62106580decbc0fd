// The thread obs_worker of ObstaclesRos.

#include <pi_detect/ros/message_picture.h>
#include "ros/obstacles_ros.h"
#include <pi_node/formatting.h>
#include <pthread.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <stdexcept>
#include <utility>

namespace pi_detect
{
namespace
{

using pi_node::sizeText;

/// A camera that has moved by less is where it was.
constexpr double SAME_POSITION_M = 1e-3;
constexpr double SAME_ROTATION_RAD = 1e-3;

double secondsSince(std::chrono::steady_clock::time_point time)
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - time).count();
}

bool samePose(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b)
{
  return (a.translation() - b.translation()).norm() < SAME_POSITION_M &&
         Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle() < SAME_ROTATION_RAD;
}

bool sameGeometry(const StereoGeometry& a, const StereoGeometry& b)
{
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy &&
         a.baseline_m == b.baseline_m && a.cx_difference == b.cx_difference;
}

void requireSize(const std::string& topic, int width, int height, const StereoGeometry& geometry,
                 const std::string& info_topic)
{
  if (width != geometry.width || height != geometry.height)
  {
    throw std::invalid_argument(topic + ": picture is " + sizeText(width, height) + ", but " + info_topic + " is for " +
                                sizeText(geometry.width, geometry.height) + "; ignored until they agree");
  }
}

/// An exception's text with the topic in front.
template <typename Function>
auto named(const std::string& topic, const Function& function)
{
  try
  {
    return function();
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(topic + ": " + error.what());
  }
}

}  // namespace

void ObstaclesRos::work()
{
  pthread_setname_np(pthread_self(), "obs_worker");
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    job_changed_.wait(lock, [this] { return stopping_ || job_; });
    if (stopping_)
    {
      return;
    }
    Job job = std::move(*job_);
    job_.reset();
    job.infos[LEFT] = infos_[LEFT];
    job.infos[RIGHT] = infos_[RIGHT];
    lock.unlock();
    try
    {
      workOn(job);
    }
    catch (const std::invalid_argument& error)
    {
      warnings_.error(error.what());
    }
    catch (const std::exception& error)
    {
      warnings_.error(std::string("a pair cannot be used: ") + error.what());
    }
    lock.lock();
  }
}

void ObstaclesRos::workOn(const Job& job)
{
  if (!prepare(job))
  {
    return;
  }
  PairFigures figures;
  const StereoObstacles::Result result = findObstacles(job, &figures);
  figures.coverage = result.coverage;
  figures.ground_measured = result.ground.measured;
  setProblem("", false);
  if (result.coverage < options_.min_coverage)
  {
    diagnostics_.addPair(figures);  // nothing is published: who sees nothing does not know that the way is free
    return;
  }
  const ros::Time stamp = job.header().stamp;
  const VehicleState vehicle = motionAt(stamp);
  const Clock::time_point begin = Clock::now();
  const std::vector<ObjectTrack> tracks = tracksAt(stamp, &figures.track_age_s);
  const std::vector<Obstacle> obstacles =
      tracker_.update(fromMsg(stamp), vehicle, result.obstacles, tracks, camera_->geometry, T_base_left_);
  figures.track_s = secondsSince(begin);
  publish(job, result, obstacles);

  figures.latency_s = (ros::Time::now() - stamp).toSec();
  figures.obstacles = obstacles.size();
  figures.nearest_m = figures.time_to_collision_s = std::numeric_limits<double>::infinity();
  for (const Obstacle& obstacle : obstacles)
  {
    figures.nearest_m = std::min(figures.nearest_m, obstacle.distance_m);
    figures.time_to_collision_s = std::min(figures.time_to_collision_s, obstacle.time_to_collision_s);
  }
  diagnostics_.addPair(figures);
}

bool ObstaclesRos::prepare(const Job& job)
{
  for (const Side side : {LEFT, RIGHT})
  {
    if (info_inputs_[side].used && !job.infos[side])
    {
      setProblem("no calibration: nothing on " + info_inputs_[side].topic + "; start the driver with a calibration",
                 false);
      return false;
    }
  }
  std::optional<StereoCamera> camera = camera_;
  const auto changed = [this, &job](Side side)
  {
    return info_inputs_[side].used && (!worked_infos_[side] || (worked_infos_[side] != job.infos[side] &&
                                                                !sameCamera(*worked_infos_[side], *job.infos[side])));
  };
  try
  {
    if (job.disparity)
    {
      camera = StereoCamera::fromMsg(*job.infos[LEFT], *job.disparity, info_inputs_[LEFT].topic);
    }
    else if (!camera_ || changed(LEFT) || changed(RIGHT))
    {
      camera = StereoCamera::fromMsg(*job.infos[LEFT], *job.infos[RIGHT], info_inputs_[LEFT].topic,
                                     info_inputs_[RIGHT].topic);
      for (const Side side : {LEFT, RIGHT})
      {
        rectifiers_[side].reset();
        if (options_.source == StereoSource::RAW || (side == LEFT && !options_.tracks_rectified))
        {
          rectifiers_[side] = std::make_unique<Rectifier>(*job.infos[side], info_inputs_[side].topic);
        }
      }
    }
  }
  catch (const std::invalid_argument& error)
  {
    camera_.reset();
    setProblem(std::string(error.what()) + "; no obstacles until this is right", true);
    return false;
  }
  const std::string frame = job.header().frame_id;
  const std::optional<Eigen::Isometry3d> T_base_camera = motion_.mounting(frame);
  if (!T_base_camera)
  {
    setProblem("tf has no transform from " + options_.base_link_frame + " to " +
                   (frame.empty() ? "the left camera, whose pictures have no frame_id" : frame) + "; publish one",
               false);
    return false;
  }
  const Eigen::Isometry3d T_base_left =
      *T_base_camera * Eigen::Isometry3d(Eigen::Quaterniond(camera->R_rectified_left.transpose()));
  if (!stereo_ || !camera_ || !sameGeometry(camera->geometry, camera_->geometry) ||
      !samePose(T_base_left, T_base_left_))
  {
    camera_ = camera;
    T_base_left_ = T_base_left;
    stereo_ = std::make_unique<StereoObstacles>(camera->geometry, T_base_left, options_.stereo);
    const StereoGeometry& geometry = camera->geometry;
    ROS_INFO_STREAM_NAMED(
        "obstacles", "stereo camera: " << sizeText(geometry.width, geometry.height) << " px, baseline "
                                       << geometry.baseline_m << " m, nearest "
                                       << geometry.fx * geometry.baseline_m / options_.stereo.max_disparity_px << " m");
  }
  worked_infos_[LEFT] = job.infos[LEFT];
  worked_infos_[RIGHT] = job.infos[RIGHT];
  return true;
}

StereoObstacles::Result ObstaclesRos::findObstacles(const Job& job, PairFigures* figures)
{
  const StereoGeometry& geometry = camera_->geometry;
  Clock::time_point begin = Clock::now();
  if (job.disparity)
  {
    const cv::Mat disparity = named(disparity_input_.topic, [&job] { return fromMsg(*job.disparity); });
    requireSize(disparity_input_.topic, disparity.cols, disparity.rows, geometry, info_inputs_[LEFT].topic);
    const StereoObstacles::Result result = stereo_->detect(disparity);
    figures->stereo_s = secondsSince(begin);
    return result;
  }
  cv::Mat pictures[2];
  for (const Side side : {LEFT, RIGHT})
  {
    const auto& message = side == LEFT ? *job.pair.left : *job.pair.right;
    pictures[side] = named(picture_inputs_[side].topic, [&message] { return toGrey(message); });
    requireSize(picture_inputs_[side].topic, pictures[side].cols, pictures[side].rows, geometry,
                info_inputs_[side].topic);
    if (options_.source == StereoSource::RAW)
    {
      pictures[side] = rectifiers_[side]->rectify(pictures[side]);
    }
  }
  figures->rectify_s = secondsSince(begin);
  begin = Clock::now();
  const StereoObstacles::Result result = stereo_->detect(pictures[LEFT], pictures[RIGHT]);
  figures->stereo_s = secondsSince(begin);
  return result;
}

std::vector<ObjectTrack> ObstaclesRos::tracksAt(const ros::Time& stamp, std::optional<double>* age_s)
{
  Track2DArrayConstPtr nearest;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    for (const Track2DArrayConstPtr& tracks : recent_tracks_)
    {
      if (!nearest ||
          std::abs((stamp - tracks->header.stamp).toSec()) < std::abs((stamp - nearest->header.stamp).toSec()))
      {
        nearest = tracks;
      }
    }
  }
  if (!nearest)
  {
    return {};
  }
  const double age = (stamp - nearest->header.stamp).toSec();
  if (std::abs(age) > options_.max_track_age_s)
  {
    return {};
  }
  *age_s = age;
  for (const Track2D& track : nearest->tracks)
  {
    labels_[static_cast<int>(track.class_id)] = track.label;
  }
  std::vector<ObjectTrack> tracks = fromMsg(*nearest);
  for (ObjectTrack& track : tracks)
  {
    const auto move_x = static_cast<float>(track.velocity_x * age);
    const auto move_y = static_cast<float>(track.velocity_y * age);
    track.box.x1 += move_x;
    track.box.x2 += move_x;
    track.box.y1 += move_y;
    track.box.y2 += move_y;
    if (!options_.tracks_rectified)
    {
      track.box = rectifiers_[LEFT]->rectify(track.box);
    }
  }
  return tracks;
}

VehicleState ObstaclesRos::motionAt(const ros::Time& stamp)
{
  std::string problem;
  const std::optional<VehicleState> state = motion_.at(stamp, &problem);
  if (!state)
  {
    warnings_.warn(problem +
                   ": velocities of obstacles are relative to the vehicle; start the odometry, or set "
                   "odom_frame");
  }
  else if (!problem.empty())
  {
    warnings_.warn(problem);
  }
  if (worked_with_motion_ != state.has_value())
  {
    worked_with_motion_ = state.has_value();
    tracker_.clear();  // it follows in another frame now
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    motion_problem_ = problem;
    motion_known_ = state.has_value();
  }
  return state.value_or(VehicleState());
}

void ObstaclesRos::publish(const Job& job, const StereoObstacles::Result& result,
                           const std::vector<Obstacle>& obstacles)
{
  std_msgs::Header header;
  header.stamp = job.header().stamp;
  header.frame_id = options_.base_link_frame;
  const ObstacleArrayPtr message = toMsg(obstacles, labels_, header);
  obstacles_.publish(message);
  markers_.publish(marker_maker_.update(*message));
  if (points_.getNumSubscribers() > 0)
  {
    points_.publish(toPointCloud(result.points, header));
  }
  if (disparity_.getNumSubscribers() > 0)
  {
    disparity_.publish(
        toDisparityImage(stereo_->disparity(), camera_->geometry, options_.stereo.max_disparity_px, job.header()));
  }
}

void ObstaclesRos::setProblem(const std::string& problem, bool failed)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    problem_ = problem;
    problem_failed_ = failed;
  }
  if (failed)
  {
    warnings_.error(problem);
  }
  else if (!problem.empty())
  {
    warnings_.warn(problem);
  }
}

}  // namespace pi_detect
