#include "ros/obstacles/obstacle_finder.h"

#include <pi_detect/ros/conversions.h>
#include <pi_detect/ros/message_picture.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <ros/console.h>

#include <stdexcept>
#include <utility>

namespace pi_detect
{
namespace
{

using pi_node::secondsSince;

using pi_node::sizeText;

/// A camera that has moved by less is where it was.
constexpr double SAME_POSITION_M = 1e-3;
constexpr double SAME_ROTATION_RAD = 1e-3;

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

/// Converts a message. @throws std::invalid_argument naming the topic, also for another size than that of camera_info.
template <typename Convert>
cv::Mat pictureOf(const std::string& topic, const StereoGeometry& geometry, const std::string& info_topic,
                  const Convert& convert)
{
  cv::Mat picture;
  try
  {
    picture = convert();
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(topic + ": " + error.what());
  }
  if (picture.cols != geometry.width || picture.rows != geometry.height)
  {
    throw std::invalid_argument(topic + ": picture is " + sizeText(picture.cols, picture.rows) + ", but " + info_topic +
                                " is for " + sizeText(geometry.width, geometry.height) + "; ignored until they agree");
  }
  return picture;
}

}  // namespace

ObstacleFinder::ObstacleFinder(const ObstaclesRosOptions& options, StereoTopics topics, const VehicleMotion* motion,
                               std::shared_ptr<StereoStages> stages)
  : options_(options), topics_(std::move(topics)), motion_(motion), stages_(std::move(stages))
{
}

bool ObstacleFinder::hasChanged(Side side, const StereoJob& job) const
{
  return usesInfo(side) &&
         (!infos_[side] || (infos_[side] != job.infos[side] && !sameCamera(*infos_[side], *job.infos[side])));
}

StereoCamera ObstacleFinder::cameraOf(const StereoJob& job)
{
  if (job.disparity)
  {
    return StereoCamera::fromMsg(*job.infos[LEFT], *job.disparity, topics_.infos[LEFT]);
  }
  if (camera_ && !hasChanged(LEFT, job) && !hasChanged(RIGHT, job))
  {
    return *camera_;
  }
  const StereoCamera camera =
      StereoCamera::fromMsg(*job.infos[LEFT], *job.infos[RIGHT], topics_.infos[LEFT], topics_.infos[RIGHT]);
  for (const Side side : {LEFT, RIGHT})
  {
    rectifiers_[side].reset();
    if (options_.source == StereoSource::RAW || (side == LEFT && !options_.tracks_rectified))
    {
      rectifiers_[side] = std::make_unique<Rectifier>(*job.infos[side], topics_.infos[side]);
    }
  }
  return camera;
}

ObstacleProblem ObstacleFinder::prepare(const StereoJob& job)
{
  for (const Side side : {LEFT, RIGHT})
  {
    if (usesInfo(side) && !job.infos[side])
    {
      return {"no calibration: nothing on " + topics_.infos[side] + "; start the driver with a calibration", false};
    }
  }
  StereoCamera camera;
  try
  {
    camera = cameraOf(job);
  }
  catch (const std::invalid_argument& error)
  {
    camera_.reset();
    return {std::string(error.what()) + "; no obstacles until this is right", true};
  }
  const std::string frame = job.header().frame_id;
  const std::optional<Eigen::Isometry3d> T_base_camera = motion_->mounting(frame);
  if (!T_base_camera)
  {
    return {"tf has no transform from " + options_.base_link_frame + " to " +
                (frame.empty() ? "the left camera, whose pictures have no frame_id" : frame) + "; publish one",
            false};
  }
  const Eigen::Isometry3d T_base_left =
      *T_base_camera * Eigen::Isometry3d(Eigen::Quaterniond(camera.R_rectified_left.transpose()));
  if (!stereo_ || !camera_ || !sameGeometry(camera.geometry, camera_->geometry) || !samePose(T_base_left, T_base_left_))
  {
    camera_ = camera;
    T_base_left_ = T_base_left;
    stereo_ = std::make_unique<StereoObstacles>(camera.geometry, T_base_left, options_.stereo, stages_);
    ROS_INFO_STREAM_NAMED("obstacles", "stereo camera: " << sizeText(camera.geometry.width, camera.geometry.height)
                                                         << " px, baseline " << camera.geometry.baseline_m << " m");
  }
  infos_[LEFT] = job.infos[LEFT];
  infos_[RIGHT] = job.infos[RIGHT];
  return {};
}

StereoObstacles::Result ObstacleFinder::find(const StereoJob& job, const StereoObstacles::PoseSource& pose,
                                             PairFigures* figures)
{
  const StereoObstacles::Result result = job.disparity ? findIn(*job.disparity, pose) : findIn(job.pair, pose, figures);
  const double forward = T_base_left_.linear()(0, 2);
  figures->nearest_visible_m =
      std::max(0.0, min_depth_m_ * forward + T_base_left_.translation().x() - options_.stereo.footprint.front);
  figures->stereo_s = result.disparity_s + result.ground_s + result.clusters_s;
  figures->coverage = result.coverage;
  figures->ground_measured = result.ground.measured;
  return result;
}

StereoObstacles::Result ObstacleFinder::findIn(const stereo_msgs::DisparityImage& disparity,
                                               const StereoObstacles::PoseSource& pose)
{
  min_depth_m_ = disparity.max_disparity > 0.0F ? disparity.f * disparity.T / disparity.max_disparity : 0.0;
  return stereo_->detect(
      pictureOf(topics_.disparity, geometry(), topics_.infos[LEFT], [&disparity] { return fromMsg(disparity); }), pose);
}

StereoObstacles::Result ObstacleFinder::findIn(const StereoPair& pair, const StereoObstacles::PoseSource& pose,
                                               PairFigures* figures)
{
  const auto begin = std::chrono::steady_clock::now();
  min_depth_m_ = stereo_->minDepth();
  cv::Mat pictures[2];
  for (const Side side : {LEFT, RIGHT})
  {
    const auto& message = side == LEFT ? *pair.left : *pair.right;
    pictures[side] = pictureOf(topics_.pictures[side], geometry(), topics_.infos[side],
                               [this, &message] { return toGrey(message, &used_bits_); });
    if (options_.source == StereoSource::RAW)
    {
      pictures[side] = rectifiers_[side]->rectify(pictures[side]);
    }
  }
  figures->rectify_s = secondsSince(begin);
  return stereo_->detect(pictures[LEFT], pictures[RIGHT], pose);
}

}  // namespace pi_detect
