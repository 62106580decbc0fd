#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include "ros/obstacles/stereo_camera.h"

#include <boost/make_shared.hpp>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace pi_detect
{
namespace
{

using pi_node::test_support::messageOf;

constexpr char LEFT[] = "/left/camera_info";
constexpr char RIGHT[] = "/right/camera_info";

sensor_msgs::CameraInfo makeInfo(bool right)
{
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 400;
  info.distortion_model = "plumb_bob";
  info.D = {-0.28, 0.07, 0.0002, 1.8e-05, 0.0};
  info.K = {400.0, 0.0, 318.0, 0.0, 401.0, 203.0, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {390.0, 0.0, 320.0, 0.0, 0.0, 390.0, 200.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  if (right)
  {
    info.P[2] = 317.0;
    info.P[3] = -390.0 * 0.2;
  }
  return info;
}

pi_os_transport::zero_copy::ImageHandle pictureAt(double stamp_s)
{
  const auto picture = boost::make_shared<sensor_msgs::Image>();
  picture->header.stamp = ros::Time(stamp_s);
  return pi_os_transport::zero_copy::toHandle(picture);
}

TEST(StereoCamera, ComesFromBothProjections)
{
  const StereoCamera camera = StereoCamera::fromMsg(makeInfo(false), makeInfo(true), LEFT, RIGHT);
  EXPECT_EQ(640, camera.geometry.width);
  EXPECT_EQ(390.0, camera.geometry.fx);
  EXPECT_EQ(200.0, camera.geometry.cy);
  EXPECT_DOUBLE_EQ(0.2, camera.geometry.baseline_m);
  EXPECT_DOUBLE_EQ(3.0, camera.geometry.cx_difference);
  EXPECT_EQ(Eigen::Matrix3d::Identity(), camera.R_rectified_left);
}

TEST(StereoCamera, OfAPartOfThePicturesIsThatOfThePart)
{
  sensor_msgs::CameraInfo infos[2] = {makeInfo(false), makeInfo(true)};
  for (sensor_msgs::CameraInfo& info : infos)
  {
    info.binning_x = info.binning_y = 2;
    info.roi.x_offset = 100;
    info.roi.y_offset = 40;
    info.roi.width = 400;
    info.roi.height = 300;
  }
  const StereoGeometry geometry = StereoCamera::fromMsg(infos[0], infos[1], LEFT, RIGHT).geometry;
  EXPECT_EQ(200, geometry.width);
  EXPECT_EQ(150, geometry.height);
  EXPECT_EQ(195.0, geometry.fx);
  EXPECT_EQ(110.0, geometry.cx);
  EXPECT_EQ(80.0, geometry.cy);
  EXPECT_DOUBLE_EQ(0.2, geometry.baseline_m);
  EXPECT_DOUBLE_EQ(1.5, geometry.cx_difference);
}

TEST(StereoCamera, ThatIsNoPairIsNamed)
{
  const auto text = [](const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right)
  { return messageOf<std::invalid_argument>([&] { StereoCamera::fromMsg(left, right, LEFT, RIGHT); }); };
  EXPECT_EQ("/left/camera_info: size is 0x0: the camera is not calibrated",
            text(sensor_msgs::CameraInfo(), makeInfo(true)).substr(0, 60));
  EXPECT_NE(std::string::npos, text(makeInfo(true), makeInfo(false)).find("the cameras are swapped"));
  EXPECT_NE(std::string::npos, text(makeInfo(false), makeInfo(false)).find("not calibrated as a pair"));
  sensor_msgs::CameraInfo right = makeInfo(true);
  right.P[3] *= 1000.0;
  EXPECT_NE(std::string::npos, text(makeInfo(false), right).find("baseline = 200 m"));
  right = makeInfo(true);
  right.height = 480;
  EXPECT_NE(std::string::npos, text(makeInfo(false), right).find("is for 640x480, but /left/camera_info for 640x400"));
  right = makeInfo(true);
  right.P[6] = 210.0;
  EXPECT_NE(std::string::npos, text(makeInfo(false), right).find("the pair is not rectified"));
  sensor_msgs::CameraInfo left = makeInfo(false);
  left.R.assign(0.0);
  EXPECT_NE(std::string::npos, text(left, makeInfo(true)).find("R is no rotation"));
}

TEST(StereoCamera, OfADisparityImageHasItsBaseline)
{
  stereo_msgs::DisparityImage disparity;
  disparity.f = 390.0F;
  disparity.T = 0.25F;
  const StereoCamera camera = StereoCamera::fromMsg(makeInfo(false), disparity, LEFT);
  EXPECT_EQ(0.25, camera.geometry.baseline_m);
  EXPECT_EQ(0.0, camera.geometry.cx_difference);
  disparity.f = 700.0F;
  EXPECT_NE(std::string::npos,
            messageOf<std::invalid_argument>([&] { StereoCamera::fromMsg(makeInfo(false), disparity, LEFT); })
                .find("they must be of the same camera"));
}

/// A dark picture with a bright spot where the lens puts a point of the rectified picture.
cv::Point2f rawOf(const sensor_msgs::CameraInfo& info, const cv::Point2f& rectified)
{
  const cv::Matx33d K(info.K.data());
  const std::vector<cv::Point3f> ray = {{static_cast<float>((rectified.x - info.P[2]) / info.P[0]),
                                         static_cast<float>((rectified.y - info.P[6]) / info.P[5]), 1.0F}};
  // Points of the rectified frame in the camera's: the transpose of R.
  const cv::Matx33d R = cv::Matx33d(info.R.data()).t();
  cv::Vec3d rotation;
  cv::Rodrigues(R, rotation);
  std::vector<cv::Point2f> raw;
  if (info.distortion_model == "equidistant")
  {
    cv::fisheye::projectPoints(ray, raw, rotation, cv::Vec3d(), K, info.D);
  }
  else
  {
    cv::projectPoints(ray, rotation, cv::Vec3d(), K, info.D, raw);
  }
  return raw[0];
}

TEST(Rectifier, PutsPointsWhereTheRectifiedCameraSeesThem)
{
  sensor_msgs::CameraInfo plumb_bob = makeInfo(false);
  const double angle = 0.02;
  plumb_bob.R = {std::cos(angle), 0.0, std::sin(angle), 0.0, 1.0, 0.0, -std::sin(angle), 0.0, std::cos(angle)};
  sensor_msgs::CameraInfo rational = plumb_bob;
  rational.distortion_model = "rational_polynomial";
  rational.D = {-0.2, 0.05, 0.0, 0.0, 0.001, 0.01, 0.002, 0.0};
  sensor_msgs::CameraInfo equidistant = plumb_bob;
  equidistant.distortion_model = "equidistant";
  equidistant.D = {0.01, -0.02, 0.003, 0.0};
  for (const sensor_msgs::CameraInfo& info : {plumb_bob, rational, equidistant})
  {
    const Rectifier rectifier(info, LEFT);
    const cv::Point2f expected(450.0F, 130.0F);
    const cv::Point2f raw = rawOf(info, expected);
    cv::Mat picture = cv::Mat::zeros(400, 640, CV_8UC1);
    cv::circle(picture, cv::Point(cvRound(16 * raw.x), cvRound(16 * raw.y)), 6 * 16, cv::Scalar(255), cv::FILLED,
               cv::LINE_AA, 4);
    const cv::Moments moments = cv::moments(rectifier.rectify(picture));
    ASSERT_GT(moments.m00, 0.0) << info.distortion_model;
    // A circle of 6 px is centred to within its distortion.
    EXPECT_NEAR(expected.x, moments.m10 / moments.m00, 0.3) << info.distortion_model;
    EXPECT_NEAR(expected.y, moments.m01 / moments.m00, 0.3) << info.distortion_model;
    const Box box = rectifier.rectify(Box{raw.x - 10.0F, raw.y - 5.0F, raw.x + 10.0F, raw.y + 5.0F});
    EXPECT_NEAR(expected.x, 0.5 * (box.x1 + box.x2), 0.5) << info.distortion_model;
    EXPECT_NEAR(expected.y, 0.5 * (box.y1 + box.y2), 0.5) << info.distortion_model;
    EXPECT_GT(box.width(), 15.0F);
  }
}

TEST(Rectifier, NamesALensThatItDoesNotKnow)
{
  sensor_msgs::CameraInfo info = makeInfo(false);
  info.distortion_model = "barrel";
  EXPECT_NE(std::string::npos,
            messageOf<std::invalid_argument>([&] { Rectifier(info, LEFT); }).find("distortion_model = \"barrel\""));
  info.distortion_model = "plumb_bob";
  info.D.resize(3);
  EXPECT_NE(std::string::npos, messageOf<std::invalid_argument>([&] { Rectifier(info, LEFT); }).find("D has 3 values"));
  info = makeInfo(false);
  info.K[0] = 0.0;
  EXPECT_NE(std::string::npos, messageOf<std::invalid_argument>([&] { Rectifier(info, LEFT); }).find("K[0] = 0"));
}

TEST(StereoPairing, PairsAtOnceWhateverComesFirst)
{
  StereoPairing pairing(5'000'000);
  EXPECT_FALSE(pairing.add(0, pictureAt(1.0)));
  const auto right = pictureAt(1.004);
  const auto pair = pairing.add(1, right);
  ASSERT_TRUE(pair);
  EXPECT_EQ(ros::Time(1.0), pair->first->header.stamp);
  EXPECT_EQ(right, pair->second);
  EXPECT_FALSE(pairing.add(1, pictureAt(1.1)));
  EXPECT_TRUE(pairing.add(0, pictureAt(1.1)));
  EXPECT_EQ(0u, pairing.dropped());
}

TEST(StereoPairing, ForgetsPicturesWhosePartnerDoesNotCome)
{
  StereoPairing pairing(5'000'000);
  pairing.add(0, pictureAt(1.0));
  pairing.add(0, pictureAt(1.1));
  const auto pair = pairing.add(1, pictureAt(1.1));
  ASSERT_TRUE(pair);
  EXPECT_EQ(ros::Time(1.1), pair->first->header.stamp);
  EXPECT_EQ(1u, pairing.dropped());
  EXPECT_FALSE(pairing.add(1, pictureAt(1.2)));
  EXPECT_FALSE(pairing.add(0, pictureAt(1.25)));  // not the same time
  for (int i = 0; i < 20; ++i)
  {
    EXPECT_FALSE(pairing.add(0, pictureAt(2.0 + 0.1 * i)));
  }
  EXPECT_GT(pairing.dropped(), 10u);
}

TEST(StereoPairing, BeginsAnewWhenTimeGoesBack)
{
  StereoPairing pairing(5'000'000);
  pairing.add(0, pictureAt(100.0));
  pairing.add(0, pictureAt(10.0));
  EXPECT_TRUE(pairing.add(1, pictureAt(10.0)));
  EXPECT_FALSE(pairing.add(1, pictureAt(100.0)));
}

}  // namespace
}  // namespace pi_detect
