#include <pi_bringup/ros/conversions.h>
#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

namespace pi_bringup
{
namespace
{

/// All but the pixels.
template <typename A>
void describe(const Frame& frame, const ros::Time& stamp, const std::string& frame_id, sensor_msgs::Image_<A>* image)
{
  image->header.stamp = stamp;
  image->header.frame_id = frame_id;
  image->width = static_cast<uint32_t>(frame.width);
  image->height = static_cast<uint32_t>(frame.height);
  image->step = static_cast<uint32_t>(frame.width * frame.channels);
  image->encoding = frame.channels == 1 ? sensor_msgs::image_encodings::MONO8 : sensor_msgs::image_encodings::BGR8;
  image->is_bigendian = 0;
}

}  // namespace

ros::Time toTime(int64_t stamp_ns)
{
  if (stamp_ns < 0 || stamp_ns / 1000000000LL > std::numeric_limits<uint32_t>::max())
  {
    throw std::invalid_argument("stamp " + std::to_string(stamp_ns) + " ns does not fit into ros::Time");
  }
  return ros::Time(static_cast<uint32_t>(stamp_ns / 1000000000LL), static_cast<uint32_t>(stamp_ns % 1000000000LL));
}

sensor_msgs::ImagePtr toImage(Frame&& frame, const ros::Time& stamp, const std::string& frame_id)
{
  auto image = boost::make_shared<sensor_msgs::Image>();
  describe(frame, stamp, frame_id, image.get());
  image->data = std::move(frame.pixels);
  return image;
}

void toImage(const Frame& frame, const ros::Time& stamp, const std::string& frame_id,
             pi_os_transport::zero_copy::Message<sensor_msgs::Image>* image)
{
  describe(frame, stamp, frame_id, image);
  image->data.resize(frame.pixels.size());
  if (!frame.pixels.empty())
  {
    std::memcpy(image->data.data(), frame.pixels.data(), frame.pixels.size());
  }
}

sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& camera, const Rectification& rectification)
{
  sensor_msgs::CameraInfo info;
  info.width = static_cast<uint32_t>(camera.width);
  info.height = static_cast<uint32_t>(camera.height);
  info.distortion_model = sensor_msgs::distortion_models::PLUMB_BOB;
  info.D = {camera.distortion[0], camera.distortion[1], camera.distortion[2], camera.distortion[3], 0.0};
  const auto& [fx, fy, cx, cy] = camera.intrinsics;
  info.K = {fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0};
  for (int row = 0; row < 3; ++row)
  {
    for (int column = 0; column < 3; ++column)
    {
      info.R[static_cast<size_t>(3 * row + column)] = rectification.R(row, column);
    }
    for (int column = 0; column < 4; ++column)
    {
      info.P[static_cast<size_t>(4 * row + column)] = rectification.P(row, column);
    }
  }
  return info;
}

sensor_msgs::CameraInfo nominalCameraInfo(int width, int height, double horizontal_fov_rad)
{
  CameraCalibration camera;
  camera.width = width;
  camera.height = height;
  const double focal_length = 0.5 * width / std::tan(0.5 * horizontal_fov_rad);
  camera.intrinsics = {focal_length, focal_length, 0.5 * (width - 1), 0.5 * (height - 1)};
  return toCameraInfo(camera, rectifyMono(camera));
}

sensor_msgs::Imu toImu(const ImuSample& sample, const ImuCalibration& calibration, const ros::Time& stamp,
                       const std::string& frame_id)
{
  sensor_msgs::Imu imu;
  imu.header.stamp = stamp;
  imu.header.frame_id = frame_id;
  imu.orientation_covariance[0] = -1.0;
  imu.angular_velocity.x = sample.angular_velocity.x();
  imu.angular_velocity.y = sample.angular_velocity.y();
  imu.angular_velocity.z = sample.angular_velocity.z();
  imu.linear_acceleration.x = sample.linear_acceleration.x();
  imu.linear_acceleration.y = sample.linear_acceleration.y();
  imu.linear_acceleration.z = sample.linear_acceleration.z();
  // White noise of density n sampled at rate f has variance n^2 f.
  const double gyroscope_variance =
      calibration.gyroscope_noise_density * calibration.gyroscope_noise_density * calibration.rate_hz;
  const double accelerometer_variance =
      calibration.accelerometer_noise_density * calibration.accelerometer_noise_density * calibration.rate_hz;
  for (const size_t diagonal : {0, 4, 8})
  {
    imu.angular_velocity_covariance[diagonal] = gyroscope_variance;
    imu.linear_acceleration_covariance[diagonal] = accelerometer_variance;
  }
  return imu;
}

nav_msgs::Odometry toOdometry(const GroundTruthPose& pose, const Eigen::Isometry3d& T_base_body, const ros::Time& stamp,
                              const std::string& world_frame, const std::string& base_link_frame)
{
  const Eigen::Isometry3d T_world_base = pose.T_world_body * T_base_body.inverse();
  const Eigen::Quaterniond q_world_base(T_world_base.linear());
  nav_msgs::Odometry odometry;
  odometry.header.stamp = stamp;
  odometry.header.frame_id = world_frame;
  odometry.child_frame_id = base_link_frame;
  odometry.pose.pose.position.x = T_world_base.translation().x();
  odometry.pose.pose.position.y = T_world_base.translation().y();
  odometry.pose.pose.position.z = T_world_base.translation().z();
  odometry.pose.pose.orientation.w = q_world_base.w();
  odometry.pose.pose.orientation.x = q_world_base.x();
  odometry.pose.pose.orientation.y = q_world_base.y();
  odometry.pose.pose.orientation.z = q_world_base.z();
  odometry.twist.covariance[21] = -1.0;
  if (pose.v_world)
  {
    const Eigen::Vector3d v_base = T_world_base.linear().transpose() * *pose.v_world;
    odometry.twist.twist.linear.x = v_base.x();
    odometry.twist.twist.linear.y = v_base.y();
    odometry.twist.twist.linear.z = v_base.z();
  }
  else
  {
    odometry.twist.covariance[0] = -1.0;
  }
  return odometry;
}

geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& T_parent_child, const ros::Time& stamp,
                                            const std::string& parent_frame, const std::string& child_frame)
{
  const Eigen::Quaterniond q_parent_child(T_parent_child.linear());
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = stamp;
  transform.header.frame_id = parent_frame;
  transform.child_frame_id = child_frame;
  transform.transform.translation.x = T_parent_child.translation().x();
  transform.transform.translation.y = T_parent_child.translation().y();
  transform.transform.translation.z = T_parent_child.translation().z();
  transform.transform.rotation.w = q_parent_child.w();
  transform.transform.rotation.x = q_parent_child.x();
  transform.transform.rotation.y = q_parent_child.y();
  transform.transform.rotation.z = q_parent_child.z();
  return transform;
}

}  // namespace pi_bringup
