#include <gtest/gtest.h>
#include <pi_bringup/ros/conversions.h>
#include <pi_bringup/ros/euroc_messages.h>
#include <pi_os_transport/zero_copy/loan.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

using namespace pi_bringup;

namespace
{

/// x, y, z axes of a message's rotation.
Eigen::Matrix3d rotation(const geometry_msgs::Quaternion& q)
{
  return Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
}

}  // namespace

TEST(Conversions, KeepNanosecondsOfTime)
{
  const ros::Time time = toTime(1403636579763555584LL);
  EXPECT_EQ(1403636579U, time.sec);
  EXPECT_EQ(763555584U, time.nsec);
  EXPECT_THROW(toTime(-1), std::invalid_argument);
  EXPECT_THROW(toTime(4294967296LL * 1000000000LL), std::invalid_argument);
}

TEST(Conversions, MovePixelsIntoTheImage)
{
  Frame frame;
  frame.width = 3;
  frame.height = 2;
  frame.channels = 3;
  frame.pixels.assign(18, 7);
  const uint8_t* pixels = frame.pixels.data();
  const sensor_msgs::ImagePtr image = toImage(std::move(frame), ros::Time(1, 2), "left_optical");
  EXPECT_EQ(pixels, image->data.data());
  EXPECT_EQ("bgr8", image->encoding);
  EXPECT_EQ(9U, image->step);
  EXPECT_EQ(3U, image->width);
  EXPECT_EQ(2U, image->height);
  EXPECT_EQ("left_optical", image->header.frame_id);
  EXPECT_EQ(ros::Time(1, 2), image->header.stamp);

  frame = Frame();
  frame.width = 2;
  frame.height = 1;
  frame.channels = 1;
  frame.pixels.assign(2, 7);
  EXPECT_EQ("mono8", toImage(std::move(frame), ros::Time(), "")->encoding);
}

TEST(Conversions, CopyPixelsIntoALoan)
{
  Frame frame;
  frame.width = 30;
  frame.height = 20;
  frame.channels = 3;
  frame.pixels.assign(1800, 7);
  auto image = pi_os_transport::zero_copy::Loan<sensor_msgs::Image>::borrow();
  toImage(frame, ros::Time(1, 2), "left_optical", image.get());
  EXPECT_EQ("bgr8", image->encoding);
  EXPECT_EQ(90U, image->step);
  EXPECT_EQ(30U, image->width);
  EXPECT_EQ(20U, image->height);
  EXPECT_EQ("left_optical", image->header.frame_id);
  EXPECT_EQ(ros::Time(1, 2), image->header.stamp);
  EXPECT_TRUE(std::equal(frame.pixels.begin(), frame.pixels.end(), image->data.begin(), image->data.end()));
}

TEST(Conversions, FillTheCameraInfoRowByRow)
{
  CameraCalibration camera;
  camera.width = 64;
  camera.height = 48;
  camera.intrinsics = {1.0, 2.0, 3.0, 4.0};
  camera.distortion = {5.0, 6.0, 7.0, 8.0};
  Rectification rectification;
  rectification.R << 1, 2, 3, 4, 5, 6, 7, 8, 9;
  rectification.P << 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12;
  const sensor_msgs::CameraInfo info = toCameraInfo(camera, rectification);
  EXPECT_EQ(64U, info.width);
  EXPECT_EQ("plumb_bob", info.distortion_model);
  EXPECT_EQ((std::vector<double>{5.0, 6.0, 7.0, 8.0, 0.0}), info.D);
  EXPECT_EQ(3.0, info.K[2]);
  EXPECT_EQ(2.0, info.K[4]);
  EXPECT_EQ(6.0, info.R[5]);
  EXPECT_EQ(4.0, info.P[3]);
  EXPECT_EQ(12.0, info.P[11]);
}

TEST(Conversions, NominalCameraSpansItsOpeningAngle)
{
  const sensor_msgs::CameraInfo info = nominalCameraInfo(768, 576, M_PI / 2.0);
  EXPECT_DOUBLE_EQ(384.0, info.K[0]);  // 45 degrees to each side
  EXPECT_DOUBLE_EQ(info.K[0], info.K[4]);
  EXPECT_DOUBLE_EQ(383.5, info.K[2]);
}

TEST(Conversions, MarkTheImuAsHavingNoOrientation)
{
  ImuCalibration calibration;
  calibration.rate_hz = 100.0;
  calibration.gyroscope_noise_density = 0.01;
  ImuSample sample;
  sample.angular_velocity = {1, 2, 3};
  sample.linear_acceleration = {4, 5, 6};
  const sensor_msgs::Imu imu = toImu(sample, calibration, ros::Time(), "imu_link");
  EXPECT_EQ(-1.0, imu.orientation_covariance[0]);
  EXPECT_EQ(3.0, imu.angular_velocity.z);
  EXPECT_EQ(4.0, imu.linear_acceleration.x);
  EXPECT_DOUBLE_EQ(0.01, imu.angular_velocity_covariance[4]);
  EXPECT_EQ(0.0, imu.linear_acceleration_covariance[4]);
}

TEST(Conversions, ExpressTheTwistInTheBaseFrame)
{
  GroundTruthPose pose;
  // The MAV flies north with its camera ahead: body z along world y, body x up.
  pose.T_world_body.linear().col(0) = Eigen::Vector3d::UnitZ();
  pose.T_world_body.linear().col(2) = Eigen::Vector3d::UnitY();
  pose.T_world_body.linear().col(1) = Eigen::Vector3d::UnitX();  // right of north is east
  pose.T_world_body.translation() << 1, 2, 3;
  pose.v_world = Eigen::Vector3d(0.0, 2.0, 0.0);
  const nav_msgs::Odometry odometry = toOdometry(pose, EurocFrames().T_base_body(), ros::Time(), "map", "base_link");
  EXPECT_NEAR(2.0, odometry.twist.twist.linear.x, 1e-6);  // forward
  EXPECT_NEAR(0.0, odometry.twist.twist.linear.y, 1e-6);
  EXPECT_EQ(2.0, odometry.pose.pose.position.y);
  const Eigen::Matrix3d R_world_base = rotation(odometry.pose.pose.orientation);
  EXPECT_TRUE(R_world_base.col(0).isApprox(Eigen::Vector3d::UnitY(), 1e-6));   // x ahead
  EXPECT_TRUE(R_world_base.col(1).isApprox(-Eigen::Vector3d::UnitX(), 1e-6));  // y to the left: west
  EXPECT_TRUE(R_world_base.col(2).isApprox(Eigen::Vector3d::UnitZ(), 1e-6));
  EXPECT_EQ(0.0, odometry.twist.covariance[0]);
  EXPECT_EQ(-1.0, odometry.twist.covariance[21]);

  pose.v_world.reset();
  EXPECT_EQ(-1.0, toOdometry(pose, EurocFrames().T_base_body(), ros::Time(), "map", "base_link").twist.covariance[0]);
}

TEST(EurocFrames, NameTheFieldThatIsWrong)
{
  const auto error = [](const EurocFrames& frames) -> std::string
  {
    try
    {
      frames.validate();
    }
    catch (const std::invalid_argument& exception)
    {
      return exception.what();
    }
    return "";
  };
  EurocFrames frames;
  EXPECT_EQ("", error(frames));
  frames.imu_frame = "/imu";
  EXPECT_NE(std::string::npos, error(frames).find("imu_frame = \"/imu\""));
  frames = EurocFrames();
  frames.body_in_base = {0, 0, 0, 0, 0, 0, 2};
  EXPECT_NE(std::string::npos, error(frames).find("norm"));
  frames.body_in_base.pop_back();
  EXPECT_NE(std::string::npos, error(frames).find("must have 7"));
}
