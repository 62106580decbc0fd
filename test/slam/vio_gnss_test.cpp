// Judge of vio_gnss.test.

#include "drive_on_graph.h"

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/NavSatFix.h>
#include <tf2_msgs/TFMessage.h>
#include "map/earth.h"
#include "ros/conversions.h"

#include <string>

namespace pi_slam
{
namespace
{

constexpr double DRIVE_S = 8.0;
constexpr double STEP_S = 0.2;
constexpr double TIMEOUT_S = 30.0;

class VioGnssTest : public testing::Test
{
protected:
  VioGnssTest() : drive_(SyntheticDrive::make(DRIVE_S))
  {
    publisher_ = ros::NodeHandle().advertise<sensor_msgs::NavSatFix>("fix", 100);
  }

  /// Of the world of the drive, in the frame of the earth.
  Eigen::Isometry3d T_local_world() const
  {
    return Eigen::Translation3d(40.0, -25.0, 6.0) * Eigen::AngleAxisd(2.3, Eigen::Vector3d::UnitZ());
  }
  Eigen::Isometry3d T_world_base(double time_s) const
  {
    const auto sample = static_cast<size_t>(time_s * 200.0);
    return drive_.drive().T_world_body[sample] * DriveOnGraph::T_base_body().inverse();
  }
  sensor_msgs::NavSatFix fixAt(double time_s) const
  {
    const Eigen::Vector3d antenna(0.3, -0.2, 0.9);
    const map::GeoPoint point = local_.toGeo(T_local_world() * (T_world_base(time_s) * antenna));
    sensor_msgs::NavSatFix fix;
    fix.header.stamp = toTime(drive_.drive().imu[static_cast<size_t>(time_s * 200.0)].stamp_ns);
    fix.header.frame_id = "gnss";
    fix.latitude = point.latitude_deg;
    fix.longitude = point.longitude_deg;
    fix.altitude = point.height_m;
    fix.position_covariance_type = sensor_msgs::NavSatFix::COVARIANCE_TYPE_APPROXIMATED;
    fix.position_covariance[0] = fix.position_covariance[4] = fix.position_covariance[8] = 0.05 * 0.05;
    return fix;
  }
  bool refused(const sensor_msgs::NavSatFix& fix, const std::string& logged)
  {
    log_.clear();
    publisher_.publish(fix);
    return log_.waitForText(logged, TIMEOUT_S);
  }
  /// Of the last message with that parent.
  static std::optional<Eigen::Isometry3d> newest(const Collector<tf2_msgs::TFMessage>& tf, const std::string& parent)
  {
    std::optional<Eigen::Isometry3d> T;
    for (const auto& message : tf.messages())
    {
      for (const auto& transform : message->transforms)
      {
        T = transform.header.frame_id == parent ? fromMsg(transform.transform) : T;
      }
    }
    return T;
  }

  DriveOnGraph drive_;
  const map::LocalFrame local_{{47.3769, 8.5417, 408.0}};
  Collector<nav_msgs::Odometry> odometry_{"odometry", 5000};
  Collector<tf2_msgs::TFMessage> tf_{"/tf", 5000};
  LogCollector log_;
  ros::Publisher publisher_;
};

TEST_F(VioGnssTest, PlacesTheMapOnEarth)
{
  ASSERT_TRUE(drive_.waitForListeners(TIMEOUT_S));
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return publisher_.getNumSubscribers() > 0 && odometry_.publishers() > 0; }));
  ASSERT_TRUE(log_.waitForNode(TIMEOUT_S));
  for (double from_s = 0.0; from_s + STEP_S < DRIVE_S; from_s += STEP_S)
  {
    drive_.play(from_s, from_s + STEP_S, 1.0);
    publisher_.publish(fixAt(from_s));  // later than the pictures, as receivers are
  }
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return newest(tf_, "earth").has_value(); })) << log_.text();
  const Eigen::Isometry3d T_earth_base =
      *newest(tf_, "earth") * *newest(tf_, "map") * fromMsg(odometry_.messages().back()->pose.pose);
  const Eigen::Isometry3d truth = local_.T_earth_local() * T_local_world() * T_world_base(DRIVE_S - STEP_S);
  EXPECT_LT((T_earth_base.translation() - truth.translation()).norm(), 0.5);
  EXPECT_LT(Eigen::AngleAxisd(truth.linear().transpose() * T_earth_base.linear()).angle(), 0.1);

  sensor_msgs::NavSatFix wrong = fixAt(1.0);
  wrong.status.status = sensor_msgs::NavSatStatus::STATUS_NO_FIX;
  EXPECT_TRUE(refused(wrong, "/fix: the receiver has no fix")) << log_.text();
  wrong = fixAt(1.0);
  wrong.header.stamp = ros::Time();
  EXPECT_TRUE(refused(wrong, "/fix: stamp is 0")) << log_.text();
  wrong = fixAt(1.0);
  wrong.latitude = 91.0;
  EXPECT_TRUE(refused(wrong, "/fix: GNSS: latitude 91")) << log_.text();
}

}  // namespace
}  // namespace pi_slam

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "vio_gnss_test");
  ros::NodeHandle node;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
