#include "ros/vio_outputs.h"

#include <nav_msgs/Path.h>
#include <sensor_msgs/Image.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>

#include "front_end/stereo_tracker.h"
#include "ros/conversions.h"

namespace pi_slam
{
namespace
{

constexpr size_t EARLIER_FRAMES = 5;  ///< whose tracks are drawn

}  // namespace

VioOutputs::VioOutputs(const VioRosOptions& options, ros::NodeHandle node, ros::NodeHandle private_node,
                       VioSession* session, pi_node::CallbackThread* drawing_thread, pi_node::WarningBoard* warnings)
  : options_(options)
  , session_(*session)
  , drawing_thread_(*drawing_thread)
  , warnings_(*warnings)
  , odometry_(node.advertise<nav_msgs::Odometry>("odometry", static_cast<uint32_t>(options.imu_queue_size)))
  , map_pose_(node.advertise<geometry_msgs::PoseWithCovarianceStamped>("map_pose", 5))
  , path_(node.advertise<nav_msgs::Path>("path", 1))
  , points_(node.advertise<sensor_msgs::PointCloud2>("points", 1))
  , tracks_(private_node.advertise<sensor_msgs::Image>("debug/tracks", 2))
  , imu_answers_("imu", "vio")
  , pair_answers_("pictures", "vio")
{
}

void VioOutputs::publishOdometry(const VioPipeline& pipeline, const PropagatedState& propagated)
{
  const auto odometry = boost::make_shared<nav_msgs::Odometry>(toOdometry(
      propagated, pipeline.T_base_body, pipeline.gyro_variance, options_.odom_frame, options_.base_link_frame));
  const int64_t stamp_ns = propagated.state.stamp_ns;
  session_.addOdometry(pipeline, stamp_ns, fromMsg(odometry->pose.pose));
  odometry_.publish(odometry);
  ++odometries_;
  session_.last_odometry_ns = stamp_ns;

  const int64_t period_ns = options_.tf_rate_hz > 0.0 ? std::llround(1e9 * (1.0 / options_.tf_rate_hz)) : 0;
  const bool jumped = std::abs(stamp_ns - next_tf_ns_) > 2 * period_ns;
  if (stamp_ns >= next_tf_ns_ || jumped)
  {
    next_tf_ns_ = (jumped ? stamp_ns : next_tf_ns_) + period_ns;
    publishTransforms(pipeline, *odometry);
  }
}

void VioOutputs::publishTransforms(const VioPipeline& pipeline, const nav_msgs::Odometry& odometry)
{
  const ros::Time& stamp = odometry.header.stamp;
  std::vector<geometry_msgs::TransformStamped> transforms;
  if (options_.publish_tf)
  {
    transforms.push_back(
        toTransform(fromMsg(odometry.pose.pose), stamp, options_.odom_frame, options_.base_link_frame));
  }
  const VioSession::MapPlace place = session_.mapPlace();
  if (place.covariance && map_pose_.getNumSubscribers() > 0)
  {
    map_pose_.publish(
        toMapPose(odometry, place.T_map_odom, *place.covariance, pipeline.T_base_body, options_.map_frame));
  }
  if (options_.publish_map_tf)
  {
    transforms.push_back(toTransform(place.T_map_odom, stamp, options_.map_frame, options_.odom_frame));
    if (place.T_earth_map)
    {
      transforms.push_back(toTransform(*place.T_earth_map, stamp, options_.earth_frame, options_.map_frame));
    }
  }
  if (!transforms.empty())
  {
    tf_broadcaster_.sendTransform(transforms);
  }
}

void VioOutputs::publishPath()
{
  const VioPipeline::Ptr pipeline = session_.pipeline();
  if (path_.getNumSubscribers() == 0 || !pipeline)
  {
    return;
  }
  VioSession::Path poses = pipeline->mapper ? pipeline->mapper->path() : VioSession::Path();  // T_map_body
  // Only poses of odometry after the map's last keyframe; all of them if that keyframe is from before a jump of time.
  const int64_t from_ns = !poses.empty() && poses.back().first <= session_.last_odometry_ns ? poses.back().first : 0;
  for (const auto& [stamp_ns, T_map_body] : session_.odomPathInMap())
  {
    if (stamp_ns > from_ns)
    {
      poses.emplace_back(stamp_ns, T_map_body);
    }
  }
  if (poses.empty())
  {
    return;
  }
  const Eigen::Isometry3d T_body_base = pipeline->T_base_body.inverse();
  const auto most = static_cast<size_t>(options_.path_length);
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

void VioOutputs::publishPoints()
{
  const VioPipeline::Ptr pipeline = session_.pipeline();
  const int64_t stamp_ns = session_.last_odometry_ns;
  if (points_.getNumSubscribers() > 0 && pipeline && pipeline->mapper && stamp_ns != 0)
  {
    points_.publish(toPointCloud(pipeline->mapper->cloud(), toTime(stamp_ns), options_.map_frame));
  }
}

void VioOutputs::showTracks(const PicturePair& pair, const VioPipeline& pipeline)
{
  if (tracks_.getNumSubscribers() == 0)
  {
    earlier_.clear();
    return;
  }
  Tracks tracks{pair, pipeline.vio->newestFeatures(), {earlier_.begin(), earlier_.end()}};
  earlier_.push_back(tracks.features);
  if (earlier_.size() > EARLIER_FRAMES)
  {
    earlier_.pop_front();
  }
  if (!drawing_.exchange(true))
  {
    drawing_thread_.post([this, tracks = std::move(tracks)] { publishTracks(tracks); });
  }
}

void VioOutputs::publishTracks(const Tracks& tracks)
{
  try
  {
    const cv::Mat picture = drawTracks(tracks.pair.left, tracks.pair.right, tracks.features, tracks.earlier);
    tracks_.publish(toImage(picture, toTime(tracks.pair.stamp_ns), session_.leftFrame()));
  }
  catch (const std::exception& error)
  {
    warnings_.warn(std::string("debug/tracks: ") + error.what());
  }
  drawing_ = false;
}

}  // namespace pi_slam
