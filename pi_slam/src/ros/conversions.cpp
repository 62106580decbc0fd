#include "ros/conversions.h"
#include <cv_bridge/cv_bridge.h>
#include <pi_node/formatting.h>
#include <pi_os_transport/zero_copy/cv_bridge.h>
#include <pi_os_transport/zero_copy/shared_image.h>
#include <pi_slam/so3.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <stdexcept>

namespace pi_slam
{
namespace
{

using pi_node::sizeText;

namespace encodings = sensor_msgs::image_encodings;
namespace zero_copy = pi_os_transport::zero_copy;

constexpr uint32_t MAX_SIDE_PX = 16384;

/// @return the coefficient of the vector, 0 if it is shorter.
double coefficient(const std::vector<double>& values, size_t index)
{
  return index < values.size() ? values[index] : 0.0;
}

void readDistortion(const sensor_msgs::CameraInfo& info, CameraModel* model)
{
  const std::string& name = info.distortion_model;
  const bool zero = std::all_of(info.D.begin(), info.D.end(), [](double value) { return value == 0.0; });
  if (name == "equidistant" || name == "fisheye")
  {
    model->distortion = Distortion::EQUIDISTANT;
    if (info.D.size() != 4)
    {
      throw std::invalid_argument("D has " + std::to_string(info.D.size()) + " values, must have 4 for " + name);
    }
  }
  else if (zero)
  {
    model->distortion = Distortion::NONE;
    return;
  }
  else if (name == "plumb_bob" || name == "rational_polynomial")
  {
    model->distortion = Distortion::RADTAN;
    for (size_t i = model->coefficients.size(); i < info.D.size(); ++i)
    {
      if (info.D[i] != 0.0)
      {
        throw std::invalid_argument("D[" + std::to_string(i) + "] = " + std::to_string(info.D[i]) +
                                    ", must be 0: thin prisms and tilted sensors are not known; calibrate without "
                                    "them, or rectify the pictures and set calibration/rectified");
      }
    }
  }
  else
  {
    throw std::invalid_argument("distortion_model = \"" + name + "\", must be plumb_bob or equidistant");
  }
  for (size_t i = 0; i < model->coefficients.size(); ++i)
  {
    model->coefficients[i] = coefficient(info.D, i);
  }
}

/// @param image  of either form.
template <typename ImagePtr>
cv::Mat greyLevels(const ImagePtr& image)
{
  if (image->width == 0 || image->height == 0 || image->width > MAX_SIDE_PX || image->height > MAX_SIDE_PX)
  {
    throw std::invalid_argument("size " + sizeText(image->width, image->height) + ", must be 1x1 to " +
                                sizeText(MAX_SIDE_PX, MAX_SIDE_PX));
  }
  if (static_cast<size_t>(image->step) * image->height > image->data.size())
  {
    throw std::invalid_argument("step " + std::to_string(image->step) + " and height " + std::to_string(image->height) +
                                " need more than its " + std::to_string(image->data.size()) + " bytes");
  }
  if (image->encoding == encodings::MONO8 || image->encoding == encodings::TYPE_8UC1)
  {
    if (image->step < image->width)
    {
      throw std::invalid_argument("step " + std::to_string(image->step) + ", must be at least the width " +
                                  std::to_string(image->width));
    }
    // OpenCV has no constant pictures; the caller must not write to this one.
    return zero_copy::shareMat(image);
  }
  try
  {
    return zero_copy::toCvShare(image, encodings::MONO8)->image;
  }
  // cv_bridge throws runtime errors of several kinds for encodings it does not know.
  catch (const std::exception& error)
  {
    throw std::invalid_argument("encoding \"" + image->encoding +
                                "\" cannot be turned into grey levels; known are mono8, mono16, bgr8, rgb8, bgra8, "
                                "rgba8 and bayer_* (" +
                                error.what() + ")");
  }
}

}  // namespace

ImuSample fromMsg(const sensor_msgs::Imu& imu)
{
  if (imu.angular_velocity_covariance[0] == -1.0)
  {
    throw std::invalid_argument("angular_velocity_covariance[0] = -1: there is no angular velocity");
  }
  if (imu.linear_acceleration_covariance[0] == -1.0)
  {
    throw std::invalid_argument("linear_acceleration_covariance[0] = -1: there is no acceleration");
  }
  ImuSample sample;
  sample.stamp_ns = fromMsg(imu.header.stamp);
  sample.w << imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z;
  sample.f << imu.linear_acceleration.x, imu.linear_acceleration.y, imu.linear_acceleration.z;
  return sample;
}

WheelSample toWheelSample(const ros::Time& stamp, const geometry_msgs::Twist& twist)
{
  return {fromMsg(stamp), {twist.linear.x, twist.linear.y}, twist.angular.z};
}

cv::Mat fromMsg(const sensor_msgs::ImageConstPtr& image)
{
  return greyLevels(image);
}

cv::Mat fromMsg(const zero_copy::ImageHandle& image)
{
  return greyLevels(image);
}

CameraModel fromMsg(const sensor_msgs::CameraInfo& info, bool rectified)
{
  if (info.width == 0 || info.height == 0 || info.width > MAX_SIDE_PX || info.height > MAX_SIDE_PX)
  {
    throw std::invalid_argument("size is " + sizeText(info.width, info.height) + ": the camera is not calibrated");
  }
  CameraModel model;
  model.fx = rectified ? info.P[0] : info.K[0];
  model.fy = rectified ? info.P[5] : info.K[4];
  model.cx = rectified ? info.P[2] : info.K[2];
  model.cy = rectified ? info.P[6] : info.K[5];
  if (!(model.fx > 0.0) || !(model.fy > 0.0))
  {
    throw std::invalid_argument(std::string(rectified ? "P" : "K") + "[0] = " + std::to_string(model.fx) +
                                ", must be a focal length [px]: the camera is not calibrated");
  }
  if (!rectified)
  {
    readDistortion(info, &model);
  }
  const sensor_msgs::RegionOfInterest& roi = info.roi;
  const bool whole = roi.width == 0 || roi.height == 0;
  const double binning_x = std::max(info.binning_x, 1U);
  const double binning_y = std::max(info.binning_y, 1U);
  model.width = static_cast<int>((whole ? info.width : roi.width) / std::max(info.binning_x, 1U));
  model.height = static_cast<int>((whole ? info.height : roi.height) / std::max(info.binning_y, 1U));
  model.fx /= binning_x;
  model.fy /= binning_y;
  model.cx = (model.cx - (whole ? 0.0 : roi.x_offset)) / binning_x;
  model.cy = (model.cy - (whole ? 0.0 : roi.y_offset)) / binning_y;
  model.validate();
  return model;
}

geometry_msgs::Pose toMsg(const Eigen::Isometry3d& T_parent_child)
{
  const Eigen::Quaterniond q_parent_child(T_parent_child.linear());
  geometry_msgs::Pose pose;
  pose.position.x = T_parent_child.translation().x();
  pose.position.y = T_parent_child.translation().y();
  pose.position.z = T_parent_child.translation().z();
  pose.orientation.w = q_parent_child.w();
  pose.orientation.x = q_parent_child.x();
  pose.orientation.y = q_parent_child.y();
  pose.orientation.z = q_parent_child.z();
  return pose;
}

Eigen::Isometry3d fromMsg(const geometry_msgs::Pose& pose)
{
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  transform.translation() << pose.position.x, pose.position.y, pose.position.z;
  transform.linear() =
      Eigen::Quaterniond(pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z)
          .normalized()
          .toRotationMatrix();
  return transform;
}

Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& transform)
{
  geometry_msgs::Pose pose;
  pose.position.x = transform.translation.x;
  pose.position.y = transform.translation.y;
  pose.position.z = transform.translation.z;
  pose.orientation = transform.rotation;
  return fromMsg(pose);
}

geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& T_parent_child, const ros::Time& stamp,
                                            const std::string& parent_frame, const std::string& child_frame)
{
  const geometry_msgs::Pose pose = toMsg(T_parent_child);
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = stamp;
  transform.header.frame_id = parent_frame;
  transform.child_frame_id = child_frame;
  transform.transform.translation.x = pose.position.x;
  transform.transform.translation.y = pose.position.y;
  transform.transform.translation.z = pose.position.z;
  transform.transform.rotation = pose.orientation;
  return transform;
}

nav_msgs::Odometry toOdometry(const PropagatedState& propagated, const Eigen::Isometry3d& T_base_body,
                              double gyro_variance, const std::string& odom_frame, const std::string& base_link_frame)
{
  const NavState& state = propagated.state;
  const Eigen::Isometry3d T_body_base = T_base_body.inverse();
  const Eigen::Vector3d p_body_base = T_body_base.translation();
  const Eigen::Matrix3d R_odom_body = state.q.toRotationMatrix();
  const Eigen::Matrix3d R_base_body = T_base_body.linear();
  const Eigen::Vector3d v_body = R_odom_body.transpose() * state.v;  // of the body, in its own frame

  nav_msgs::Odometry odometry;
  odometry.header.stamp = toTime(state.stamp_ns);
  odometry.header.frame_id = odom_frame;
  odometry.child_frame_id = base_link_frame;
  odometry.pose.pose = toMsg(state.T_odom_body() * T_body_base);
  const Eigen::Vector3d v_base = R_base_body * (v_body + propagated.w_body.cross(p_body_base));
  const Eigen::Vector3d w_base = R_base_body * propagated.w_body;
  odometry.twist.twist.linear.x = v_base.x();
  odometry.twist.twist.linear.y = v_base.y();
  odometry.twist.twist.linear.z = v_base.z();
  odometry.twist.twist.angular.x = w_base.x();
  odometry.twist.twist.angular.y = w_base.y();
  odometry.twist.twist.angular.z = w_base.z();

  // p_odom_base = p + R r and R exp(d_theta) = exp(R d_theta) R, with r = p_body_base.
  Eigen::Matrix<double, 6, 15> J_pose = Eigen::Matrix<double, 6, 15>::Zero();
  J_pose.block<3, 3>(0, 0).setIdentity();
  J_pose.block<3, 3>(0, 3) = -R_odom_body * hat(p_body_base);
  J_pose.block<3, 3>(3, 3) = R_odom_body;
  // v_base = R_base_body (R^T v + w x r) with w = w_measured - bg - noise.
  Eigen::Matrix<double, 6, 15> J_twist = Eigen::Matrix<double, 6, 15>::Zero();
  J_twist.block<3, 3>(0, 3) = R_base_body * hat(v_body);
  J_twist.block<3, 3>(0, 6) = R_base_body * R_odom_body.transpose();
  J_twist.block<3, 3>(0, 9) = R_base_body * hat(p_body_base);
  J_twist.block<3, 3>(3, 9) = -R_base_body;

  const Matrix6d pose_covariance = J_pose * propagated.covariance * J_pose.transpose();
  const Eigen::Matrix<double, 6, 3> J_noise = J_twist.block<6, 3>(0, 9);
  const Matrix6d twist_covariance =
      J_twist * propagated.covariance * J_twist.transpose() + gyro_variance * J_noise * J_noise.transpose();
  using RowMajor = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  Eigen::Map<RowMajor>(odometry.pose.covariance.data()) = 0.5 * (pose_covariance + pose_covariance.transpose());
  Eigen::Map<RowMajor>(odometry.twist.covariance.data()) = 0.5 * (twist_covariance + twist_covariance.transpose());
  return odometry;
}

geometry_msgs::PoseWithCovarianceStamped toMapPose(const nav_msgs::Odometry& odometry,
                                                   const Eigen::Isometry3d& T_map_odom,
                                                   const Eigen::Matrix4d& covariance,
                                                   const Eigen::Isometry3d& T_base_body, const std::string& map_frame)
{
  const Eigen::Isometry3d T_map_base = T_map_odom * fromMsg(odometry.pose.pose);
  geometry_msgs::PoseWithCovarianceStamped pose;
  pose.header.stamp = odometry.header.stamp;
  pose.header.frame_id = map_frame;
  pose.pose.pose = toMsg(T_map_base);

  // p_map_base = p_map_body + r: an error of heading turns the lever r.
  const Eigen::Vector3d lever = -(T_map_base.linear() * T_base_body.translation());
  Eigen::Matrix4d J = Eigen::Matrix4d::Identity();
  J(0, 3) = -lever.y();
  J(1, 3) = lever.x();
  const Eigen::Matrix4d of_base = J * covariance * J.transpose();
  using RowMajor = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  Eigen::Map<RowMajor> all(pose.pose.covariance.data());
  all.setZero();
  constexpr int HEADING = 5;
  all.topLeftCorner<3, 3>() = of_base.topLeftCorner<3, 3>();
  all.block<3, 1>(0, HEADING) = of_base.block<3, 1>(0, 3);
  all.block<1, 3>(HEADING, 0) = of_base.block<1, 3>(3, 0);
  all(HEADING, HEADING) = of_base(3, 3);
  const Eigen::Map<const RowMajor> by_odometry(odometry.pose.covariance.data());
  all.block<2, 2>(3, 3) = by_odometry.block<2, 2>(3, 3);
  return pose;
}

sensor_msgs::PointCloud2Ptr toPointCloud(const std::vector<MapPoint>& points, const ros::Time& stamp,
                                         const std::string& frame)
{
  const auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header.stamp = stamp;
  cloud->header.frame_id = frame;
  cloud->is_dense = true;
  constexpr int FLOAT = sensor_msgs::PointField::FLOAT32;
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2Fields(4, "x", 1, FLOAT, "y", 1, FLOAT, "z", 1, FLOAT, "intensity", 1, FLOAT);
  modifier.resize(points.size());
  auto* out = reinterpret_cast<float*>(cloud->data.data());
  for (const MapPoint& point : points)
  {
    Eigen::Map<Eigen::Vector4f>(out) << point.p_map, static_cast<float>(point.grey);
    out += 4;
  }
  return cloud;
}

OccupancyCells fromMsg(const nav_msgs::OccupancyGrid& message)
{
  const geometry_msgs::Quaternion& q = message.info.origin.orientation;
  if (std::hypot(q.x, std::hypot(q.y, q.z)) > 1e-3)
  {
    throw std::invalid_argument("info.origin is turned, must lie along the axes of its frame");
  }
  OccupancyCells grid;
  grid.origin = {message.info.origin.position.x, message.info.origin.position.y};
  grid.cell_m = static_cast<double>(message.info.resolution);
  grid.width = static_cast<int>(message.info.width);
  grid.height = static_cast<int>(message.info.height);
  grid.cells = message.data;
  return grid;
}

nav_msgs::OccupancyGridPtr toMsg(const OccupancyCells& grid, const ros::Time& stamp, const std::string& frame)
{
  const auto message = boost::make_shared<nav_msgs::OccupancyGrid>();
  message->header.stamp = stamp;
  message->header.frame_id = frame;
  message->info.map_load_time = stamp;
  message->info.resolution = static_cast<float>(grid.cell_m);
  message->info.width = static_cast<uint32_t>(grid.width);
  message->info.height = static_cast<uint32_t>(grid.height);
  message->info.origin.position.x = grid.origin.x();
  message->info.origin.position.y = grid.origin.y();
  message->info.origin.orientation.w = 1.0;
  message->data = grid.cells;
  return message;
}

sensor_msgs::ImagePtr toImage(const cv::Mat& picture, const ros::Time& stamp, const std::string& frame)
{
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frame;
  return cv_bridge::CvImage(header, picture.channels() == 3 ? encodings::BGR8 : encodings::MONO8, picture).toImageMsg();
}

}  // namespace pi_slam
