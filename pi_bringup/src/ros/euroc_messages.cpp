#include <pi_bringup/ros/euroc_messages.h>

#include <cmath>
#include <stdexcept>
#include <utility>

namespace pi_bringup
{

void EurocFrames::validate() const
{
  const std::pair<const char*, const std::string&> names[] = {{"map_frame", map_frame},
                                                              {"base_link_frame", base_link_frame},
                                                              {"imu_frame", imu_frame},
                                                              {"left_frame", left_frame},
                                                              {"right_frame", right_frame}};
  for (const auto& [field, value] : names)
  {
    if (value.empty() || value.front() == '/')
    {
      throw std::invalid_argument(std::string(field) + " = \"" + value + "\", must be a frame name without leading /");
    }
  }
  if (body_in_base.size() != 7)
  {
    throw std::invalid_argument("body_in_base has " + std::to_string(body_in_base.size()) +
                                " numbers, must have 7: x y z qx qy qz qw");
  }
  const double norm = std::sqrt(body_in_base[3] * body_in_base[3] + body_in_base[4] * body_in_base[4] +
                                body_in_base[5] * body_in_base[5] + body_in_base[6] * body_in_base[6]);
  if (!(std::abs(norm - 1.0) < 1e-3))
  {
    throw std::invalid_argument("body_in_base: quaternion has norm " + std::to_string(norm) + ", must have 1");
  }
}

Eigen::Isometry3d EurocFrames::T_base_body() const
{
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  transform.translation() << body_in_base[0], body_in_base[1], body_in_base[2];
  transform.linear() = Eigen::Quaterniond(body_in_base[6], body_in_base[3], body_in_base[4], body_in_base[5])
                           .normalized()
                           .toRotationMatrix();
  return transform;
}

EurocMessages::EurocMessages(const EurocDataset& dataset, const EurocFrames& frames)
  : dataset_(dataset), frames_(frames)
{
  frames_.validate();
  T_base_body_ = frames_.T_base_body();
  if (dataset.right)
  {
    const StereoRectification rectification = rectifyStereo(dataset.left.calibration, dataset.right->calibration);
    left_info_ = toCameraInfo(dataset.left.calibration, rectification.left);
    right_info_ = toCameraInfo(dataset.right->calibration, rectification.right);
  }
  else
  {
    left_info_ = toCameraInfo(dataset.left.calibration, rectifyMono(dataset.left.calibration));
  }
  left_info_.header.frame_id = frames_.left_frame;
  right_info_.header.frame_id = frames_.right_frame;
}

sensor_msgs::ImagePtr EurocMessages::image(bool left, Frame&& frame, const ros::Time& stamp) const
{
  return toImage(std::move(frame), stamp, left ? frames_.left_frame : frames_.right_frame);
}

void EurocMessages::image(bool left, const Frame& frame, const ros::Time& stamp,
                          pi_os_transport::zero_copy::Message<sensor_msgs::Image>* image) const
{
  toImage(frame, stamp, left ? frames_.left_frame : frames_.right_frame, image);
}

sensor_msgs::CameraInfo EurocMessages::cameraInfo(bool left, const ros::Time& stamp) const
{
  sensor_msgs::CameraInfo info = left ? left_info_ : right_info_;
  info.header.stamp = stamp;
  return info;
}

sensor_msgs::Imu EurocMessages::imu(size_t index, const ros::Time& stamp) const
{
  return toImu(dataset_.imu->samples.at(index), dataset_.imu->calibration, stamp, frames_.imu_frame);
}

nav_msgs::Odometry EurocMessages::groundTruth(size_t index, const ros::Time& stamp) const
{
  return toOdometry(dataset_.ground_truth.at(index), T_base_body_, stamp, frames_.map_frame, frames_.base_link_frame);
}

geometry_msgs::TransformStamped EurocMessages::baseTransform(const nav_msgs::Odometry& odometry)
{
  geometry_msgs::TransformStamped transform;
  transform.header = odometry.header;
  transform.child_frame_id = odometry.child_frame_id;
  transform.transform.translation.x = odometry.pose.pose.position.x;
  transform.transform.translation.y = odometry.pose.pose.position.y;
  transform.transform.translation.z = odometry.pose.pose.position.z;
  transform.transform.rotation = odometry.pose.pose.orientation;
  return transform;
}

tf2_msgs::TFMessage EurocMessages::staticTransforms(const ros::Time& stamp) const
{
  tf2_msgs::TFMessage message;
  const auto add = [&](const Eigen::Isometry3d& T_body_sensor, const std::string& frame)
  { message.transforms.push_back(toTransform(T_base_body_ * T_body_sensor, stamp, frames_.base_link_frame, frame)); };
  if (dataset_.imu)
  {
    add(dataset_.imu->calibration.T_body_imu, frames_.imu_frame);
  }
  add(dataset_.left.calibration.T_body_camera, frames_.left_frame);
  if (dataset_.right)
  {
    add(dataset_.right->calibration.T_body_camera, frames_.right_frame);
  }
  return message;
}

}  // namespace pi_bringup
