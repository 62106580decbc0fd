#include <gtest/gtest.h>
#include <pi_slam/so3.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include "ros/conversions.h"

#include <Eigen/Eigenvalues>
#include <boost/make_shared.hpp>
#include <boost/weak_ptr.hpp>
#include <limits>
#include <random>
#include <stdexcept>

#include "ros/contains.h"

namespace pi_slam
{
namespace
{

template <typename Function>
std::string refusal(const Function& function)
{
  try
  {
    function();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

boost::shared_ptr<sensor_msgs::Image> makeImage(const std::string& encoding, uint32_t width, uint32_t height,
                                                uint32_t step)
{
  const auto image = boost::make_shared<sensor_msgs::Image>();
  image->encoding = encoding;
  image->width = width;
  image->height = height;
  image->step = step;
  image->data.resize(static_cast<size_t>(step) * height);
  for (size_t i = 0; i < image->data.size(); ++i)
  {
    image->data[i] = static_cast<uint8_t>(7 * i);
  }
  return image;
}

sensor_msgs::CameraInfo makeInfo()
{
  sensor_msgs::CameraInfo info;
  info.width = 752;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D = {-0.28, 0.07, 0.0002, 1.8e-05, 0.0};
  info.K = {458.0, 0.0, 367.0, 0.0, 457.0, 248.0, 0.0, 0.0, 1.0};
  info.P = {436.0, 0.0, 364.0, 0.0, 0.0, 435.0, 256.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

PropagatedState makeState()
{
  PropagatedState propagated;
  propagated.state.stamp_ns = 1700000000123456789LL;
  propagated.state.p << 1.0, -2.0, 0.5;
  propagated.state.q = expSo3(Eigen::Vector3d(0.3, -0.2, 1.1));
  propagated.state.v << 1.5, 0.4, -0.1;
  propagated.w_body << 0.2, -0.3, 0.7;
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  Matrix15d root;
  for (int i = 0; i < root.size(); ++i)
  {
    root(i) = 0.01 * normal(random);
  }
  propagated.covariance = root * root.transpose() + 1e-6 * Matrix15d::Identity();
  return propagated;
}

Eigen::Isometry3d makeMounting()
{
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  T_base_body.linear() = expSo3(Eigen::Vector3d(0.1, 1.5, -0.4)).toRotationMatrix();
  T_base_body.translation() << 0.4, -0.2, 0.9;
  return T_base_body;
}

Eigen::Matrix<double, 6, 1> twistOf(const nav_msgs::Odometry& odometry)
{
  const geometry_msgs::Twist& twist = odometry.twist.twist;
  Eigen::Matrix<double, 6, 1> vector;
  vector << twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y, twist.angular.z;
  return vector;
}

/// What toOdometry() says for a state with an error: position and rotation about the axes of odom, and twist.
Eigen::Matrix<double, 12, 1> outputFor(const Vector15d& error)
{
  PropagatedState propagated = makeState();
  propagated.state.boxPlus(error);
  propagated.w_body -= error.segment<3>(9);  // the rate without bias
  const nav_msgs::Odometry odometry = toOdometry(propagated, makeMounting(), 0.0, "odom", "base_link");
  const nav_msgs::Odometry exact = toOdometry(makeState(), makeMounting(), 0.0, "odom", "base_link");
  const Eigen::Isometry3d T = fromMsg(odometry.pose.pose);
  const Eigen::Isometry3d T_exact = fromMsg(exact.pose.pose);
  Eigen::Matrix<double, 12, 1> output;
  output.segment<3>(0) = T.translation() - T_exact.translation();
  output.segment<3>(3) = logSo3(Eigen::Quaterniond(T.linear() * T_exact.linear().transpose()));
  output.segment<6>(6) = twistOf(odometry) - twistOf(exact);
  return output;
}

TEST(RosConversions, StampsAreExact)
{
  EXPECT_EQ(1700000000123456789LL, fromMsg(toTime(1700000000123456789LL)));
  EXPECT_EQ(0, fromMsg(toTime(0)));
  EXPECT_THROW(toTime(-1), std::invalid_argument);
  EXPECT_THROW(toTime(std::numeric_limits<int64_t>::max()), std::invalid_argument);
}

TEST(RosConversions, WheelsKeepSpeedAndYawRate)
{
  geometry_msgs::Twist twist;
  twist.linear.x = 1.5;
  twist.linear.y = -0.1;
  twist.angular.z = 0.3;
  const WheelSample sample = toWheelSample(ros::Time(5, 7), twist);
  EXPECT_EQ(5000000007LL, sample.stamp_ns);
  EXPECT_EQ(Eigen::Vector2d(1.5, -0.1), sample.v);
  EXPECT_EQ(0.3, sample.yaw_rate);
}

TEST(RosConversions, ImuKeepsAxesAndRefusesWhatIsNotThere)
{
  sensor_msgs::Imu imu;
  imu.header.stamp = ros::Time(5, 7);
  imu.angular_velocity.x = 1.0;
  imu.angular_velocity.z = 3.0;
  imu.linear_acceleration.y = 9.0;
  const ImuSample sample = fromMsg(imu);
  EXPECT_EQ(5000000007LL, sample.stamp_ns);
  EXPECT_EQ(Eigen::Vector3d(1.0, 0.0, 3.0), sample.w);
  EXPECT_EQ(Eigen::Vector3d(0.0, 9.0, 0.0), sample.f);
  imu.angular_velocity_covariance[0] = -1.0;
  EXPECT_TRUE(contains(refusal([&] { fromMsg(imu); }), "angular_velocity_covariance[0] = -1"));
}

TEST(RosConversions, GreyPictureSharesTheBufferAndKeepsTheMessage)
{
  auto image = makeImage("mono8", 5, 4, 8);
  const uint8_t* const data = image->data.data();
  const boost::weak_ptr<sensor_msgs::Image> watch = image;
  cv::Mat copy;
  {
    cv::Mat picture = fromMsg(sensor_msgs::ImageConstPtr(image));
    image.reset();
    EXPECT_EQ(data, picture.data);
    EXPECT_EQ(5, picture.cols);
    EXPECT_EQ(4, picture.rows);
    EXPECT_EQ(static_cast<uint8_t>(7 * (2 * 8 + 3)), picture.at<uint8_t>(2, 3));
    copy = picture(cv::Rect(1, 1, 2, 2));
  }
  EXPECT_FALSE(watch.expired());
  EXPECT_EQ(static_cast<uint8_t>(7 * (1 * 8 + 1)), copy.at<uint8_t>(0, 0));
  copy.release();
  EXPECT_TRUE(watch.expired());
}

TEST(RosConversions, AZeroCopyPictureIsReadWhereItLies)
{
  auto image = makeImage("mono8", 5, 4, 8);
  const uint8_t* const data = image->data.data();
  const boost::weak_ptr<sensor_msgs::Image> watch = image;
  pi_os_transport::zero_copy::ImageHandle handle = pi_os_transport::zero_copy::toHandle(image);
  image.reset();
  cv::Mat picture = fromMsg(handle);
  handle.reset();
  EXPECT_EQ(data, picture.data);
  EXPECT_EQ(static_cast<uint8_t>(7 * (2 * 8 + 3)), picture.at<uint8_t>(2, 3));
  picture.release();
  EXPECT_TRUE(watch.expired());

  const auto colour = makeImage("bgr8", 2, 1, 6);
  const cv::Mat standard = fromMsg(sensor_msgs::ImageConstPtr(colour));
  const cv::Mat handled = fromMsg(pi_os_transport::zero_copy::toHandle(colour));
  ASSERT_EQ(standard.size(), handled.size());
  EXPECT_EQ(standard.at<uint8_t>(0, 0), handled.at<uint8_t>(0, 0));
  EXPECT_EQ(standard.at<uint8_t>(0, 1), handled.at<uint8_t>(0, 1));
}

TEST(RosConversions, PicturesInColourBecomeGrey)
{
  const auto image = makeImage("bgr8", 2, 1, 6);
  image->data = {10, 20, 200, 0, 0, 0};
  const cv::Mat from_bgr = fromMsg(sensor_msgs::ImageConstPtr(image));
  ASSERT_EQ(CV_8UC1, from_bgr.type());
  EXPECT_NEAR(0.114 * 10 + 0.587 * 20 + 0.299 * 200, from_bgr.at<uint8_t>(0, 0), 1.0);
  image->encoding = "rgb8";
  EXPECT_NEAR(0.299 * 10 + 0.587 * 20 + 0.114 * 200, fromMsg(sensor_msgs::ImageConstPtr(image)).at<uint8_t>(0, 0), 1.0);

  const auto deep = makeImage("mono16", 2, 1, 4);
  deep->data = {0x00, 0x80, 0xff, 0xff};
  const cv::Mat from_deep = fromMsg(sensor_msgs::ImageConstPtr(deep));
  EXPECT_NEAR(128, from_deep.at<uint8_t>(0, 0), 1.0);
  EXPECT_EQ(255, from_deep.at<uint8_t>(0, 1));

  const auto bayer = makeImage("bayer_rggb8", 8, 8, 8);
  std::fill(bayer->data.begin(), bayer->data.end(), 90);
  EXPECT_NEAR(90, fromMsg(sensor_msgs::ImageConstPtr(bayer)).at<uint8_t>(4, 4), 1.0);
}

TEST(RosConversions, PicturesThatCannotBeAreNamed)
{
  const auto text = [](const boost::shared_ptr<sensor_msgs::Image>& image)
  { return refusal([&] { fromMsg(sensor_msgs::ImageConstPtr(image)); }); };
  EXPECT_TRUE(contains(text(makeImage("jpeg", 4, 4, 4)), "encoding \"jpeg\""));
  EXPECT_TRUE(contains(text(makeImage("", 4, 4, 4)), "encoding \"\""));
  EXPECT_TRUE(contains(text(makeImage("32FC1", 4, 4, 16)), "encoding \"32FC1\""));
  EXPECT_TRUE(contains(text(makeImage("mono8", 0, 0, 0)), "size 0x0"));
  EXPECT_TRUE(contains(text(makeImage("mono8", 4, 4, 3)), "step 3"));
  const auto cut = makeImage("mono8", 4, 4, 4);
  cut->data.resize(15);
  EXPECT_TRUE(contains(text(cut), "15 bytes"));
  const auto huge = makeImage("mono8", 4, 4, 4);
  huge->width = huge->step = std::numeric_limits<uint32_t>::max();
  EXPECT_FALSE(text(huge).empty());
}

TEST(RosConversions, CameraInfoGivesTheRawOrTheRectifiedCamera)
{
  const CameraModel raw = fromMsg(makeInfo(), false);
  EXPECT_EQ(Distortion::RADTAN, raw.distortion);
  EXPECT_EQ(458.0, raw.fx);
  EXPECT_EQ(248.0, raw.cy);
  EXPECT_EQ(-0.28, raw.coefficients[0]);
  const CameraModel rectified = fromMsg(makeInfo(), true);
  EXPECT_EQ(Distortion::NONE, rectified.distortion);
  EXPECT_EQ(435.0, rectified.fy);
  EXPECT_EQ(364.0, rectified.cx);
  sensor_msgs::CameraInfo wide = makeInfo();
  wide.D[4] = -0.0021;
  EXPECT_EQ(-0.0021, fromMsg(wide, false).coefficients[4]);
  wide.distortion_model = "rational_polynomial";
  wide.D = {9.45, -12.6, 4.0e-4, -7.0e-4, 15.8, 9.26, -12.2, 15.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
  EXPECT_EQ(15.5, fromMsg(wide, false).coefficients[7]);
  sensor_msgs::CameraInfo fisheye = makeInfo();
  fisheye.distortion_model = "equidistant";
  fisheye.D = {0.01, -0.02, 0.003, 0.0};
  EXPECT_EQ(Distortion::EQUIDISTANT, fromMsg(fisheye, false).distortion);
}

TEST(RosConversions, CameraInfoOfAPartOfThePictureIsThatOfThePart)
{
  sensor_msgs::CameraInfo info = makeInfo();
  info.binning_x = info.binning_y = 2;
  info.roi.x_offset = 100;
  info.roi.y_offset = 40;
  info.roi.width = 400;
  info.roi.height = 300;
  const CameraModel part = fromMsg(info, false);
  EXPECT_EQ(200, part.width);
  EXPECT_EQ(150, part.height);
  EXPECT_EQ(229.0, part.fx);
  EXPECT_EQ((367.0 - 100.0) / 2, part.cx);
  EXPECT_EQ((248.0 - 40.0) / 2, part.cy);
}

TEST(RosConversions, CameraInfoThatIsNoCalibrationIsNamed)
{
  const auto text = [](const sensor_msgs::CameraInfo& info) { return refusal([&] { fromMsg(info, false); }); };
  EXPECT_TRUE(contains(text(sensor_msgs::CameraInfo()), "not calibrated"));
  sensor_msgs::CameraInfo info = makeInfo();
  info.K[0] = 0.0;
  EXPECT_TRUE(contains(text(info), "K[0] = 0"));
  info = makeInfo();
  info.D.resize(9, 0.0);
  info.D[8] = 0.1;
  EXPECT_TRUE(contains(text(info), "D[8] = 0.1"));
  info = makeInfo();
  info.distortion_model = "barrel";
  EXPECT_TRUE(contains(text(info), "distortion_model = \"barrel\""));
  info = makeInfo();
  info.K[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(text(info).empty());
}

TEST(RosConversions, PosesComeBackAsTheyWere)
{
  const Eigen::Isometry3d T = makeMounting();
  EXPECT_TRUE(fromMsg(toMsg(T)).isApprox(T, 1e-12));
  const geometry_msgs::TransformStamped transform = toTransform(T, ros::Time(1, 2), "map", "odom");
  EXPECT_EQ("map", transform.header.frame_id);
  EXPECT_EQ("odom", transform.child_frame_id);
  EXPECT_TRUE(fromMsg(transform.transform).isApprox(T, 1e-12));
}

TEST(RosConversions, OdometryIsThatOfTheBase)
{
  const PropagatedState propagated = makeState();
  const Eigen::Isometry3d T_base_body = makeMounting();
  const nav_msgs::Odometry odometry = toOdometry(propagated, T_base_body, 0.0, "odom", "base_link");
  EXPECT_EQ("odom", odometry.header.frame_id);
  EXPECT_EQ("base_link", odometry.child_frame_id);
  EXPECT_EQ(propagated.state.stamp_ns, fromMsg(odometry.header.stamp));
  EXPECT_TRUE((fromMsg(odometry.pose.pose) * T_base_body).isApprox(propagated.state.T_odom_body(), 1e-12));

  // The base's velocity from two poses of a body that moves on as it does now.
  const double dt = 1e-6;
  NavState later = propagated.state;
  later.p += dt * later.v;
  later.q = later.q * expSo3(dt * propagated.w_body);
  const Eigen::Isometry3d T_odom_base = propagated.state.T_odom_body() * T_base_body.inverse();
  const Eigen::Isometry3d T_odom_later = later.T_odom_body() * T_base_body.inverse();
  const Eigen::Vector3d v_base =
      T_odom_base.linear().transpose() * (T_odom_later.translation() - T_odom_base.translation()) / dt;
  const Eigen::Vector3d w_base =
      logSo3(Eigen::Quaterniond(T_odom_base.linear().transpose() * T_odom_later.linear())) / dt;
  EXPECT_LT((twistOf(odometry).head<3>() - v_base).norm(), 1e-5);
  EXPECT_LT((twistOf(odometry).tail<3>() - w_base).norm(), 1e-5);
}

TEST(RosConversions, OdometryCovariancesAreThoseOfNumericDifferences)
{
  Eigen::Matrix<double, 12, 15> J;
  const double step = 1e-6;
  for (int i = 0; i < 15; ++i)
  {
    J.col(i) = (outputFor(step * Vector15d::Unit(i)) - outputFor(-step * Vector15d::Unit(i))) / (2.0 * step);
  }
  const Eigen::Matrix<double, 12, 12> expected = J * makeState().covariance * J.transpose();
  const nav_msgs::Odometry odometry = toOdometry(makeState(), makeMounting(), 0.0, "odom", "base_link");
  for (int row = 0; row < 6; ++row)
  {
    for (int column = 0; column < 6; ++column)
    {
      EXPECT_NEAR(expected(row, column), odometry.pose.covariance[6 * row + column], 1e-9);
      EXPECT_NEAR(expected(row + 6, column + 6), odometry.twist.covariance[6 * row + column], 1e-9);
    }
  }
}

TEST(RosConversions, MapPoseHasTheMapsCovarianceAtTheBase)
{
  const Eigen::Isometry3d T_base_body = makeMounting();
  const nav_msgs::Odometry odometry = toOdometry(makeState(), T_base_body, 0.0, "odom", "base_link");
  Eigen::Isometry3d T_map_odom = Eigen::Isometry3d::Identity();
  T_map_odom.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()));
  T_map_odom.translation() << 5.0, -3.0, 0.1;
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
  covariance.diagonal() << 0.04, 0.09, 0.01, 0.0025;
  covariance(0, 3) = covariance(3, 0) = 0.003;

  const geometry_msgs::PoseWithCovarianceStamped pose = toMapPose(odometry, T_map_odom, covariance, T_base_body, "map");
  EXPECT_EQ("map", pose.header.frame_id);
  EXPECT_EQ(odometry.header.stamp, pose.header.stamp);
  const Eigen::Isometry3d T_map_base = fromMsg(pose.pose.pose);
  EXPECT_TRUE(T_map_base.isApprox(T_map_odom * fromMsg(odometry.pose.pose), 1e-9));

  // An error of heading turns the base about the body, which is where the map knows the position.
  const Eigen::Isometry3d T_map_body = T_map_base * T_base_body;
  const auto baseOf = [&](const Eigen::Vector4d& error) -> Eigen::Vector4d
  {
    Eigen::Isometry3d T = T_map_body;
    T.linear() = Eigen::AngleAxisd(error(3), Eigen::Vector3d::UnitZ()) * T.linear();
    T.translation() += error.head<3>();
    const Eigen::Vector3d p = (T * T_base_body.inverse()).translation();
    return {p.x(), p.y(), p.z(), error(3)};
  };
  Eigen::Matrix4d J;
  for (int i = 0; i < 4; ++i)
  {
    const Eigen::Vector4d step = 1e-5 * Eigen::Vector4d::Unit(i);
    J.col(i) = (baseOf(step) - baseOf(-step)) / 2e-5;
  }
  const Eigen::Matrix4d expected = J * covariance * J.transpose();
  const int order[] = {0, 1, 2, 5};
  for (int i = 0; i < 4; ++i)
  {
    for (int j = 0; j < 4; ++j)
    {
      EXPECT_NEAR(expected(i, j), pose.pose.covariance[static_cast<size_t>(6 * order[i] + order[j])], 1e-8);
    }
  }
  EXPECT_EQ(odometry.pose.covariance[21], pose.pose.covariance[21]);  // roll
  EXPECT_EQ(odometry.pose.covariance[28], pose.pose.covariance[28]);
}

TEST(RosConversions, NoiseOfTheGyroReachesTheTwistThroughTheLeverArm)
{
  PropagatedState propagated = makeState();
  propagated.covariance.setZero();
  const double variance = 0.04;
  const nav_msgs::Odometry odometry = toOdometry(propagated, makeMounting(), variance, "odom", "base_link");
  for (int axis = 0; axis < 3; ++axis)
  {
    EXPECT_NEAR(variance, odometry.twist.covariance[7 * (axis + 3)], 1e-12);
    EXPECT_EQ(0.0, odometry.pose.covariance[7 * axis]);
  }
  // The trace of [r]x [r]x^T is 2 |r|^2, whatever the axes.
  const double trace = odometry.twist.covariance[0] + odometry.twist.covariance[7] + odometry.twist.covariance[14];
  EXPECT_NEAR(2.0 * makeMounting().translation().squaredNorm() * variance, trace, 1e-12);
}

TEST(RosConversions, CloudHasPointsWithIntensity)
{
  const auto cloud =
      toPointCloud({{Eigen::Vector3f(1, 2, 3), 200}, {Eigen::Vector3f(4, 5, 6), 7}}, ros::Time(1), "map");
  EXPECT_EQ("map", cloud->header.frame_id);
  ASSERT_EQ(2u, cloud->width);
  ASSERT_EQ(cloud->data.size(), cloud->row_step);
  sensor_msgs::PointCloud2ConstIterator<float> y(*cloud, "y");
  sensor_msgs::PointCloud2ConstIterator<float> intensity(*cloud, "intensity");
  ++y;
  EXPECT_EQ(5.0F, *y);
  EXPECT_EQ(200.0F, *intensity);
  EXPECT_EQ(0u, toPointCloud({}, ros::Time(1), "map")->width);
}

TEST(RosConversions, PicturesBecomeMessagesRowByRow)
{
  cv::Mat wide(4, 10, CV_8UC1);
  for (int i = 0; i < 40; ++i)
  {
    wide.data[i] = static_cast<uint8_t>(i);
  }
  const auto image = toImage(wide(cv::Rect(2, 1, 3, 2)), ros::Time(1), "left");
  EXPECT_EQ("mono8", image->encoding);
  EXPECT_EQ((std::vector<uint8_t>{12, 13, 14, 22, 23, 24}), image->data);
  EXPECT_EQ("bgr8", toImage(cv::Mat::zeros(2, 3, CV_8UC3), ros::Time(1), "left")->encoding);
}

}  // namespace
}  // namespace pi_slam
