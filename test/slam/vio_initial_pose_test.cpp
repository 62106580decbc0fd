// Judge of vio_initial_pose.test.

#include "drive_on_graph.h"

#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <tf2_msgs/TFMessage.h>
#include "ros/conversions.h"

#include <cmath>
#include <string>

namespace pi_slam
{
namespace
{

constexpr double DRIVE_S = 7.0;
constexpr double TIMEOUT_S = 30.0;
constexpr size_t Z_VARIANCE = 14;
constexpr int64_t IMU_NS = 5000000;  ///< between two samples

class VioInitialPose : public testing::Test
{
protected:
  VioInitialPose() : drive_(SyntheticDrive::make(DRIVE_S))
  {
    publisher_ = ros::NodeHandle().advertise<geometry_msgs::PoseWithCovarianceStamped>("initialpose", 10);
  }
  bool send(const geometry_msgs::PoseWithCovarianceStamped& message, const std::string& logged)
  {
    log_.clear();
    publisher_.publish(message);
    return log_.waitForText(logged, TIMEOUT_S);
  }
  /// T_map_odom as tf has it.
  Eigen::Isometry3d newestMapOdom() const
  {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    for (const auto& message : tf_.messages())
    {
      for (const auto& transform : message->transforms)
      {
        T = transform.header.frame_id == "map" ? fromMsg(transform.transform) : T;
      }
    }
    return T;
  }

  DriveOnGraph drive_;
  Collector<nav_msgs::Odometry> odometry_{"odometry", 5000};
  Collector<tf2_msgs::TFMessage> tf_{"/tf", 5000};
  Collector<nav_msgs::Path> path_{"path", 10};
  LogCollector log_;
  ros::Publisher publisher_;
};

TEST_F(VioInitialPose, PutsTheVehicleThereAndRefusesWhatIsNoPose)
{
  ASSERT_TRUE(drive_.waitForListeners(TIMEOUT_S));
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return publisher_.getNumSubscribers() > 0 && odometry_.publishers() > 0; }));
  ASSERT_TRUE(log_.waitForNode(TIMEOUT_S));
  geometry_msgs::PoseWithCovarianceStamped pose;
  pose.header.frame_id = "map";
  pose.pose.pose.orientation.w = 1.0;
  EXPECT_TRUE(send(pose, "/initialpose: the pose came before there is odometry")) << log_.text();

  drive_.play(0.0, 4.0, 1.0);
  const auto odometries = odometry_.messages();
  ASSERT_GT(odometries.size(), 300u) << log_.text();

  geometry_msgs::PoseWithCovarianceStamped wrong = pose;
  wrong.header.frame_id = "odom";
  EXPECT_TRUE(send(wrong, "/initialpose: the pose is in frame \"odom\", must be in map")) << log_.text();
  wrong = pose;
  wrong.pose.pose.position.y = std::nan("");
  EXPECT_TRUE(send(wrong, "/initialpose: the pose has numbers that are not finite")) << log_.text();
  wrong = pose;
  wrong.pose.pose.orientation.w = 0.0;
  EXPECT_TRUE(send(wrong, "/initialpose: the pose has a quaternion of length 0")) << log_.text();

  // At a stamp half a second ago, in motion, with a heading of its own; roll and pitch are not believed.
  const nav_msgs::Odometry then = *odometries[odometries.size() - 100];
  const Eigen::Isometry3d T_odom_base = fromMsg(then.pose.pose);
  const Eigen::Isometry3d said = Eigen::Translation3d(100.0, -50.0, 3.0) *
                                 Eigen::AngleAxisd(2.0, Eigen::Vector3d::UnitZ()) *
                                 Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitX());
  pose.header.stamp = then.header.stamp;
  pose.header.frame_id = "/map";
  pose.pose.pose = toMsg(said);
  pose.pose.covariance[Z_VARIANCE] = 0.01;
  ASSERT_TRUE(send(pose, "by odometry of its stamp")) << log_.text();
  path_.clear();
  tf_.clear();
  drive_.play(4.0, 5.0, 1.0);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return tf_.count() > 0 && path_.count() > 0; }));
  const Eigen::Isometry3d T_map_odom = newestMapOdom();
  const Eigen::Isometry3d there = T_map_odom * T_odom_base;
  EXPECT_LT((there.translation() - said.translation()).norm(), 1e-3);
  EXPECT_NEAR(1.0, T_map_odom.linear()(2, 2), 1e-6);
  // What counts is the turn about the vertical between what odometry had and what was said.
  const Eigen::Vector3d x = said.linear().col(0);
  EXPECT_LT(std::abs(std::remainder(std::atan2(there.linear()(1, 0), there.linear()(0, 0)) - std::atan2(x.y(), x.x()),
                                    2.0 * M_PI)),
            0.02);
  // The path came along.
  for (const auto& on_way : path_.messages().back()->poses)
  {
    EXPECT_NEAR(100.0, on_way.pose.position.x, 15.0);
    EXPECT_NEAR(-50.0, on_way.pose.position.y, 15.0);
  }

  // As rviz says it: in two dimensions, of now. The height stays.
  const Eigen::Isometry3d flat = Eigen::Translation3d(7.0, 8.0, 0.0) * Eigen::Quaterniond::Identity();
  pose.header.stamp = ros::Time();
  pose.pose.pose = toMsg(flat);
  pose.pose.covariance[Z_VARIANCE] = 0.0;
  // The node's newest one: that of the last sample that was played.
  const int64_t played_ns = drive_.drive().imu.front().stamp_ns + 5000000000;
  ASSERT_TRUE(
      until(TIMEOUT_S, [&] { return fromMsg(odometry_.messages().back()->header.stamp) >= played_ns - IMU_NS; }));
  const nav_msgs::Odometry last = *odometry_.messages().back();
  ASSERT_TRUE(send(pose, "by the newest odometry, as it has no stamp")) << log_.text();
  tf_.clear();
  drive_.play(5.0, 5.4, 1.0);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return tf_.count() > 0; }));
  const Eigen::Vector3d p = (newestMapOdom() * fromMsg(last.pose.pose)).translation();
  EXPECT_NEAR(7.0, p.x(), 1e-2);
  EXPECT_NEAR(8.0, p.y(), 1e-2);
  EXPECT_NEAR((T_map_odom * fromMsg(last.pose.pose)).translation().z(), p.z(), 1e-2);
  pose.header.stamp = toTime(fromMsg(last.header.stamp) - 60000000000);
  ASSERT_TRUE(send(pose, "s from its stamp, of which none is known")) << log_.text();
}

}  // namespace
}  // namespace pi_slam

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "vio_initial_pose_test");
  ros::NodeHandle node;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
