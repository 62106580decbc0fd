#include "ros/simulation_conversions.h"

#include <pi_node/ros/time.h>
#include <pi_os_transport/zero_copy/shared_image.h>
#include <pi_vehicle/decision/ground_polygon.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_simulation
{
namespace
{

template <typename Message>
void set(Message* message, const Eigen::Vector3d& value)
{
  message->x = value.x();
  message->y = value.y();
  message->z = value.z();
}

/// Half sizes of the box around a box, along the axes of the frame.
Eigen::Vector2d reach(const OrientedBox& box)
{
  const double c = std::abs(std::cos(box.heading));
  const double s = std::abs(std::sin(box.heading));
  return {c * box.half.x() + s * box.half.y(), s * box.half.x() + c * box.half.y()};
}

/// When two boxes along the axes touch, if one of them moves by `velocity` [s]; inf: never.
double timeToCollision(const Eigen::Vector2d& way, const Eigen::Vector2d& reach, const Eigen::Vector2d& velocity)
{
  double enter = 0.0;
  double leave = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 2; ++axis)
  {
    if (std::abs(velocity[axis]) < 1e-6)
    {
      if (std::abs(way[axis]) > reach[axis])
      {
        return std::numeric_limits<double>::infinity();
      }
      continue;
    }
    const double a = (-reach[axis] - way[axis]) / velocity[axis];
    const double b = (reach[axis] - way[axis]) / velocity[axis];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave ? enter : std::numeric_limits<double>::infinity();
}

}  // namespace

nav_msgs::Odometry toOdometry(const TruePose& pose, const std::string& map_frame, const std::string& base_link_frame)
{
  nav_msgs::Odometry message;
  message.header.stamp = pi_node::toTime(pose.stamp_ns);
  message.header.frame_id = map_frame;
  message.child_frame_id = base_link_frame;
  const Eigen::Quaterniond q(pose.T_map_base.linear());
  set(&message.pose.pose.position, pose.T_map_base.translation());
  message.pose.pose.orientation.w = q.w();
  message.pose.pose.orientation.x = q.x();
  message.pose.pose.orientation.y = q.y();
  message.pose.pose.orientation.z = q.z();
  set(&message.twist.twist.linear, pose.velocity);
  set(&message.twist.twist.angular, pose.angular_rate);
  return message;
}

nav_msgs::Odometry toOdometry(const BaseOdometry& odometry, const std::string& odom_frame,
                              const std::string& base_link_frame)
{
  nav_msgs::Odometry message;
  message.header.stamp = pi_node::toTime(odometry.stamp_ns);
  message.header.frame_id = odom_frame;
  message.child_frame_id = base_link_frame;
  message.pose.pose.position.x = odometry.pose.x;
  message.pose.pose.position.y = odometry.pose.y;
  message.pose.pose.orientation.z = std::sin(0.5 * odometry.pose.heading);
  message.pose.pose.orientation.w = std::cos(0.5 * odometry.pose.heading);
  message.twist.twist.linear.x = odometry.speed;
  message.twist.twist.angular.z = odometry.yaw_rate;
  return message;
}

pi_detect::ObstacleArray toObstacles(const std::vector<TrueObstacle>& obstacles, const OrientedBox& outline,
                                     const Eigen::Vector2d& velocity, const ros::Time& stamp,
                                     const std::string& base_link_frame)
{
  pi_detect::ObstacleArray array;
  array.header.stamp = stamp;
  array.header.frame_id = base_link_frame;
  for (const TrueObstacle& obstacle : obstacles)
  {
    pi_detect::Obstacle3D message;
    message.id = obstacle.id;
    message.label = obstacle.class_name;
    message.class_id = -1;
    message.track_id = -1;
    message.score = 1.0;
    const Eigen::Vector2d half = reach(obstacle.box);
    set(&message.position, {obstacle.box.center.x(), obstacle.box.center.y(), 0.5 * obstacle.height});
    set(&message.size, {2.0 * half.x(), 2.0 * half.y(), obstacle.height});
    set(&message.velocity, {obstacle.velocity.x(), obstacle.velocity.y(), 0.0});
    message.moving = obstacle.velocity.norm() > 0.0;
    const pi_vehicle::Pose2 place{obstacle.box.center.x(), obstacle.box.center.y(), obstacle.box.heading};
    const pi_vehicle::GroundPolygon ground = pi_vehicle::GroundPolygon::box(place, obstacle.box.half);
    for (const Eigen::Vector2d& corner : ground.corners())
    {
      geometry_msgs::Point32 point;
      point.x = static_cast<float>(corner.x());
      point.y = static_cast<float>(corner.y());
      message.outline.push_back(point);
    }
    message.distance = distanceTo(obstacle.box, Eigen::Vector2d::Zero());
    message.time_to_collision =
        timeToCollision(obstacle.box.center - outline.center, half + reach(outline), obstacle.velocity - velocity);
    array.obstacles.push_back(message);
  }
  std::sort(array.obstacles.begin(), array.obstacles.end(),
            [](const pi_detect::Obstacle3D& a, const pi_detect::Obstacle3D& b) { return a.distance < b.distance; });
  return array;
}

sensor_msgs::Imu toImu(const pi_slam::ImuSample& sample, const pi_slam::ImuSimulatorOptions& imu,
                       const std::string& frame)
{
  sensor_msgs::Imu message;
  message.header.stamp = pi_node::toTime(sample.stamp_ns);
  message.header.frame_id = frame;
  message.orientation_covariance[0] = -1.0;
  set(&message.angular_velocity, sample.w);
  set(&message.linear_acceleration, sample.f);
  for (size_t i = 0; i < 9; i += 4)
  {
    message.angular_velocity_covariance[i] = imu.gyro_noise_density * imu.gyro_noise_density * imu.rate_hz;
    message.linear_acceleration_covariance[i] = imu.accel_noise_density * imu.accel_noise_density * imu.rate_hz;
  }
  return message;
}

void toImage(const cv::Mat& picture, const ros::Time& stamp, const std::string& frame,
             pi_os_transport::zero_copy::Message<sensor_msgs::Image>* image)
{
  image->header.stamp = stamp;
  image->header.frame_id = frame;
  cv::Mat target = pi_os_transport::zero_copy::resizeImage(
      image, picture.rows, picture.cols,
      picture.channels() == 3 ? sensor_msgs::image_encodings::BGR8 : sensor_msgs::image_encodings::MONO8);
  picture.copyTo(target);
}

sensor_msgs::CameraInfo toCameraInfo(const pi_slam::CameraModel& camera, double baseline)
{
  sensor_msgs::CameraInfo info;
  info.width = static_cast<uint32_t>(camera.width);
  info.height = static_cast<uint32_t>(camera.height);
  info.distortion_model = "plumb_bob";
  info.D.assign(5, 0.0);
  info.K = {camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {camera.fx, 0.0, camera.cx, -camera.fx * baseline, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

}  // namespace pi_simulation
