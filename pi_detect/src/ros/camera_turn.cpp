#include "ros/camera_turn.h"

#include <pi_detect/ros/conversions.h>
#include <tf2/exceptions.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <optional>
#include <stdexcept>

namespace pi_detect
{
namespace
{

/// tf must reach this part of the way from picture to picture; the rest is extrapolated.
constexpr double LEAST_KNOWN = 0.5;

/// Rotation of a camera from one stamp to a later one, by the fixed frame.
std::optional<Eigen::Matrix3d> rotationBetween(const tf2_ros::Buffer& buffer, const std::string& odom,
                                               const std::string& frame, const ros::Time& before, const ros::Time& now)
{
  try
  {
    const ros::Time newest = buffer.lookupTransform(odom, frame, ros::Time(0)).header.stamp;
    const ros::Time known = newest.isZero() ? now : std::min(newest, now);  // 0: static
    const double part = (known - before).toSec() / (now - before).toSec();
    if (!(part >= LEAST_KNOWN))
    {
      return std::nullopt;
    }
    const Eigen::AngleAxisd turn(fromMsg(buffer.lookupTransform(frame, known, frame, before, odom).transform).linear());
    return Eigen::AngleAxisd(turn.angle() / part, turn.axis()).toRotationMatrix();
  }
  catch (const tf2::TransformException&)
  {
    return std::nullopt;
  }
}

}  // namespace

bool isRectified(const std::string& image_topic)
{
  return image_topic.substr(image_topic.rfind('/') + 1).rfind("image_rect", 0) == 0;
}

CameraTurn::CameraTurn(const ros::NodeHandle& node, const std::string& odom_frame, const std::string& info_topic,
                       bool rectified)
  : node_(node), odom_frame_(odom_frame), info_topic_(info_topic), rectified_(rectified)
{
}

void CameraTurn::listen(bool wanted)
{
  if (odom_frame_.empty())
  {
    return;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (wanted && !listener_)
  {
    const auto no_delay = ros::TransportHints().tcpNoDelay();
    listener_ = std::make_unique<tf2_ros::TransformListener>(buffer_, node_, true, no_delay);
    info_ = node_.subscribe<sensor_msgs::CameraInfo>(
        info_topic_, 1, [this](const sensor_msgs::CameraInfoConstPtr& info) { onInfo(info); }, ros::VoidConstPtr(),
        no_delay);
  }
  else if (!wanted)
  {
    info_.shutdown();
    listener_.reset();
  }
}

void CameraTurn::onInfo(const sensor_msgs::CameraInfoConstPtr& info)
{
  auto camera = std::make_shared<Camera>();
  try
  {
    camera->lens = rectified_ ? Lens::rectified(*info, info_topic_) : Lens(*info, info_topic_);
    const cv::Size size = pictureSize(*info, info_topic_);
    camera->size = Eigen::Vector2d(size.width, size.height);
  }
  catch (const std::invalid_argument&)
  {
    camera = nullptr;  // not calibrated: as if nobody had said anything
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  camera_ = camera;
}

PictureMotion CameraTurn::between(const ros::Time& before, const ros::Time& now, const std::string& frame) const
{
  std::shared_ptr<const Camera> camera;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    camera = listener_ ? camera_ : nullptr;
  }
  if (!camera || before.isZero() || before >= now)
  {
    return nullptr;
  }
  const std::optional<Eigen::Matrix3d> R_now_before = rotationBetween(buffer_, odom_frame_, frame, before, now);
  if (!R_now_before)
  {
    return nullptr;
  }
  return [camera, R = *R_now_before](const Eigen::Vector2d& point) -> Eigen::Vector2d
  {
    // Beyond the picture a lens is not defined: its edge moves what is there.
    const Eigen::Vector2d inside = point.cwiseMax(0.0).cwiseMin(camera->size);
    const Eigen::Vector3d ray = R * camera->lens.ray(inside);
    return ray.z() > 0.0 ? Eigen::Vector2d(point + camera->lens.pixel(ray) - inside) : point;
  };
}

}  // namespace pi_detect
