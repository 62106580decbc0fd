#include "ros/simulation_conversions.h"

#include <gtest/gtest.h>
#include <pi_slam/stereo_calibration.h>

#include <cmath>
#include <opencv2/core.hpp>

namespace pi_simulation
{
namespace
{

const OrientedBox OUTLINE{{0.25, 0.0}, 0.0, {0.75, 0.6}};

pi_detect::Obstacle3D convert(const OrientedBox& box, const Eigen::Vector2d& velocity, double speed)
{
  TrueObstacle obstacle;
  obstacle.id = 7;
  obstacle.class_name = "person";
  obstacle.box = box;
  obstacle.height = 1.8;
  obstacle.velocity = velocity;
  const auto array = toObstacles({obstacle}, OUTLINE, {speed, 0.0}, ros::Time(5, 0), "base_link");
  EXPECT_EQ("base_link", array.header.frame_id);
  return array.obstacles.at(0);
}

TEST(SimulationConversions, ObstacleAheadOfAMovingVehicle)
{
  const auto message = convert({{6.0, 0.2}, 0.0, {0.25, 0.3}}, Eigen::Vector2d::Zero(), 2.0);
  EXPECT_EQ(7, message.id);
  EXPECT_EQ("person", message.label);
  EXPECT_NEAR(0.9, message.position.z, 1e-12);
  EXPECT_NEAR(0.5, message.size.x, 1e-12);
  EXPECT_NEAR(5.75, message.distance, 1e-12);  // from the origin
  EXPECT_NEAR((5.75 - 1.0) / 2.0, message.time_to_collision, 1e-9);
  EXPECT_FALSE(message.moving);
}

TEST(SimulationConversions, WhatGoesBesideTheWayIsNeverHit)
{
  EXPECT_TRUE(std::isinf(convert({{6.0, 3.0}, 0.0, {0.25, 0.3}}, Eigen::Vector2d::Zero(), 2.0).time_to_collision));
  EXPECT_TRUE(std::isinf(convert({{6.0, 0.0}, 0.0, {0.25, 0.3}}, {3.0, 0.0}, 2.0).time_to_collision));
  const auto crossing = convert({{5.0, -4.0}, 0.0, {0.25, 0.25}}, {0.0, 1.0}, 1.0);
  EXPECT_TRUE(crossing.moving);
  EXPECT_NEAR(3.75, crossing.time_to_collision, 1e-9);  // it comes from ahead: at 4.75 m less 1 m of the front
}

TEST(SimulationConversions, TurnedBoxesAreWider)
{
  const auto message = convert({{6.0, 0.0}, M_PI_4, {1.0, 1.0}}, Eigen::Vector2d::Zero(), 0.0);
  EXPECT_NEAR(2.0 * std::sqrt(2.0), message.size.x, 1e-9);
  ASSERT_EQ(4u, message.outline.size());
  for (const geometry_msgs::Point32& corner : message.outline)
  {
    EXPECT_NEAR(std::sqrt(2.0), std::hypot(corner.x - 6.0, corner.y), 1e-5);
    EXPECT_NEAR(0.0, (corner.x - 6.0) * corner.y, 1e-5) << "ahead, behind and beside its middle";
  }
  EXPECT_TRUE(std::isinf(message.time_to_collision));
}

TEST(SimulationConversions, CameraInfoOfTheRightCameraHasTheBaseline)
{
  const auto calibration = pi_slam::StereoCalibration::makeForwardPair(640, 480, 0.12);
  const sensor_msgs::CameraInfo info = toCameraInfo(calibration.right.model, 0.12);
  EXPECT_EQ(640u, info.width);
  EXPECT_NEAR(-0.12 * calibration.right.model.fx, info.P[3], 1e-9);
  EXPECT_NEAR(info.K[0], info.P[0], 1e-12);
}

TEST(SimulationConversions, PicturesKeepTheirPixels)
{
  cv::Mat grey(3, 5, CV_8UC1);
  for (int i = 0; i < 15; ++i)
  {
    grey.data[i] = static_cast<uint8_t>(i);
  }
  pi_os_transport::zero_copy::Message<sensor_msgs::Image> image;
  toImage(grey, ros::Time(1, 2), "left_optical", &image);
  EXPECT_EQ("mono8", image.encoding);
  EXPECT_EQ("left_optical", image.header.frame_id);
  EXPECT_EQ(5u, image.step);
  EXPECT_EQ(14, image.data.at(14));
  toImage(cv::Mat::zeros(2, 2, CV_8UC3), ros::Time(), "a", &image);
  EXPECT_EQ("bgr8", image.encoding);
}

TEST(SimulationConversions, OdometryIsThePose)
{
  TruePose pose;
  pose.stamp_ns = 5'000'000'001;
  pose.T_map_base.translation() << 1.0, 2.0, 3.0;
  pose.T_map_base.linear() = Eigen::AngleAxisd(M_PI_2, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  pose.velocity.x() = 1.5;
  const nav_msgs::Odometry message = toOdometry(pose, "map", "base_link");
  EXPECT_EQ(ros::Time(5, 1), message.header.stamp);
  EXPECT_EQ("base_link", message.child_frame_id);
  EXPECT_EQ(2.0, message.pose.pose.position.y);
  EXPECT_NEAR(std::sqrt(0.5), message.pose.pose.orientation.z, 1e-9);
  EXPECT_EQ(1.5, message.twist.twist.linear.x);
}

}  // namespace
}  // namespace pi_simulation
