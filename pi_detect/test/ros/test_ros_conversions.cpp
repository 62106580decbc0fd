#include <gtest/gtest.h>
#include <pi_detect/ros/conversions.h>
#include <pi_detect/ros/message_picture.h>
#include <pi_node/test_support/message_of.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include "ros/obstacles/obstacle_markers.h"

#include <boost/make_shared.hpp>
#include <boost/weak_ptr.hpp>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "contains.h"

namespace pi_detect
{
namespace
{

using pi_node::test_support::messageOf;
using visualization_msgs::Marker;

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

std_msgs::Header makeHeader()
{
  std_msgs::Header header;
  header.stamp = ros::Time(100, 5);
  header.frame_id = "camera";
  return header;
}

Obstacle makeObstacle(int64_t id)
{
  Obstacle obstacle;
  obstacle.id = id;
  obstacle.class_id = 1;
  obstacle.score = 0.75F;
  obstacle.track_id = 7;
  obstacle.position << 5.0, -1.0, 0.6;
  obstacle.size << 0.5, 0.8, 1.2;
  obstacle.position_covariance << 1, 2, 3, 2, 5, 6, 3, 6, 9;
  obstacle.velocity << 1.5, 0.5, 0.0;
  obstacle.velocity_covariance << 9, 8, 7, 8, 5, 4, 7, 4, 1;
  obstacle.moving = true;
  obstacle.distance_m = 4.2;
  obstacle.time_to_collision_s = 3.1;
  obstacle.first_seen_ns = 98000000000LL;
  obstacle.last_seen_ns = 99900000000LL;
  return obstacle;
}

const Labels LABELS = {{1, "person"}};

TEST(RosConversions, StampsAreExact)
{
  EXPECT_EQ(1700000000123456789LL, fromMsg(ros::Time(1700000000, 123456789)));
}

TEST(RosConversions, DetectionsComeBackAsTheyWere)
{
  const Detections detections = {{1, 0.5F, {10.0F, 20.0F, 50.0F, 100.0F}}, {17, 0.25F, {0.0F, 0.5F, 1.0F, 2.0F}}};
  const Detection2DArrayPtr message = toMsg(detections, makeHeader());
  EXPECT_EQ("camera", message->header.frame_id);
  ASSERT_EQ(2u, message->detections.size());
  EXPECT_EQ(message->header.stamp, message->detections[1].header.stamp);
  ASSERT_EQ(1u, message->detections[0].results.size());
  EXPECT_EQ(30.0, message->detections[0].bbox.center.x);
  EXPECT_EQ(60.0, message->detections[0].bbox.center.y);
  EXPECT_EQ(80.0, message->detections[0].bbox.size_y);
  EXPECT_EQ(0.0, message->detections[0].bbox.center.theta);
  const Detections again = fromMsg(*message);
  ASSERT_EQ(2u, again.size());
  EXPECT_EQ(17, again[1].class_id);
  EXPECT_EQ(0.25F, again[1].score);
  EXPECT_EQ(50.0F, again[0].box.x2);
  EXPECT_EQ(20.0F, again[0].box.y1);
}

TEST(RosConversions, DetectionsOfOthersGiveTheirBestResult)
{
  Detection2DArray message;
  message.detections.resize(2);  // the second one without result
  message.detections[0].results.resize(2);
  message.detections[0].results[0].score = 0.2;
  message.detections[0].results[1].score = 0.6;
  message.detections[0].results[1].id = 4;
  const Detections detections = fromMsg(message);
  ASSERT_EQ(1u, detections.size());
  EXPECT_EQ(4, detections[0].class_id);
  EXPECT_TRUE(toMsg(Detections(), makeHeader())->detections.empty());
}

TEST(RosConversions, TracksComeBackAsTheyWere)
{
  ObjectTrack track;
  track.id = 42;
  track.class_id = 1;
  track.score = 0.5F;
  track.box = {-10.0F, 20.0F, 30.0F, 60.0F};
  track.velocity_x = 12.5F;
  track.velocity_y = -3.0F;
  track.first_seen_ns = 98000000005LL;
  track.last_seen_ns = 99500000005LL;
  const Track2DArrayPtr message = toMsg({track}, LABELS, makeHeader());
  ASSERT_EQ(1u, message->tracks.size());
  EXPECT_EQ("person", message->tracks[0].label);
  EXPECT_EQ(ros::Duration(2.0), message->tracks[0].age);
  EXPECT_EQ(ros::Duration(0.5), message->tracks[0].since_seen);
  const std::vector<ObjectTrack> again = fromMsg(*message);
  ASSERT_EQ(1u, again.size());
  EXPECT_EQ(42, again[0].id);
  EXPECT_EQ(-10.0F, again[0].box.x1);
  EXPECT_EQ(-3.0F, again[0].velocity_y);
  EXPECT_EQ(track.first_seen_ns, again[0].first_seen_ns);
  EXPECT_EQ(track.last_seen_ns, again[0].last_seen_ns);
}

TEST(RosConversions, ObstaclesComeBackAsTheyWere)
{
  const Obstacle obstacle = makeObstacle(3);
  const ObstacleArrayPtr message = toMsg({obstacle}, LABELS, makeHeader());
  ASSERT_EQ(1u, message->obstacles.size());
  EXPECT_EQ("person", message->obstacles[0].label);
  EXPECT_EQ(6.0, message->obstacles[0].position_covariance[5]);
  const std::vector<Obstacle> again = fromMsg(*message);
  ASSERT_EQ(1u, again.size());
  EXPECT_EQ(3, again[0].id);
  EXPECT_EQ(1, again[0].class_id);
  EXPECT_EQ(7, again[0].track_id);
  EXPECT_EQ(obstacle.position, again[0].position);
  EXPECT_EQ(obstacle.size, again[0].size);
  EXPECT_EQ(obstacle.velocity, again[0].velocity);
  EXPECT_EQ(obstacle.position_covariance, again[0].position_covariance);
  EXPECT_EQ(obstacle.velocity_covariance, again[0].velocity_covariance);
  EXPECT_TRUE(again[0].moving);
  EXPECT_EQ(4.2, again[0].distance_m);
  EXPECT_EQ(3.1, again[0].time_to_collision_s);
  EXPECT_EQ(obstacle.first_seen_ns, again[0].first_seen_ns);
}

TEST(RosConversions, OutlinesComeBackAsTheyWere)
{
  Obstacle obstacle = makeObstacle(3);
  EXPECT_TRUE(toMsg({obstacle}, LABELS, makeHeader())->obstacles[0].outline.empty());
  obstacle.outline = {{4.75, -1.5}, {5.25, -1.0}, {5.0, 0.5}};
  const ObstacleArrayPtr message = toMsg({obstacle}, LABELS, makeHeader());
  ASSERT_EQ(3u, message->obstacles[0].outline.size());
  EXPECT_EQ(5.25F, message->obstacles[0].outline[1].x);
  EXPECT_NEAR(0.0, message->obstacles[0].outline[1].z, 1e-6) << "the bottom of the box";
  EXPECT_EQ(obstacle.outline, fromMsg(*message)[0].outline);
}

TEST(RosConversions, ObstaclesWithoutClassHaveNoLabel)
{
  Obstacle obstacle = makeObstacle(3);
  obstacle.class_id = -1;
  obstacle.time_to_collision_s = std::numeric_limits<double>::infinity();
  const ObstacleArrayPtr message = toMsg({obstacle}, LABELS, makeHeader());
  EXPECT_EQ("", message->obstacles[0].label);
  EXPECT_EQ(-1, message->obstacles[0].class_id);
  EXPECT_TRUE(std::isinf(message->obstacles[0].time_to_collision));
}

TEST(RosConversions, LabelsAreThoseOfTheModel)
{
  ModelDescription model;
  model.name = "made";
  model.labels = {{1, "person"}, {44, "bottle"}};
  model.tracker = {0.5, 0.25};
  const LabelArray labels = toMsg(model);
  EXPECT_EQ("made", labels.model);
  EXPECT_EQ((std::vector<int64_t>{1, 44}), labels.ids);
  EXPECT_EQ((std::vector<std::string>{"person", "bottle"}), labels.names);
  EXPECT_EQ(0.5, scoresOf(labels).high);
  EXPECT_EQ(0.25, scoresOf(labels).low);
  EXPECT_EQ(TrackerScores().high, scoresOf(LabelArray()).high) << "of a publisher that does not know them";
}

TEST(RosConversions, CloudHasThePoints)
{
  const auto cloud = toPointCloud({Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(4, 5, 6)}, makeHeader());
  ASSERT_EQ(2u, cloud->width);
  ASSERT_EQ(cloud->data.size(), cloud->row_step);
  sensor_msgs::PointCloud2ConstIterator<float> z(*cloud, "z");
  EXPECT_EQ(3.0F, *z);
  ++z;
  EXPECT_EQ(6.0F, *z);
  EXPECT_EQ(0u, toPointCloud({}, makeHeader())->width);
}

TEST(RosConversions, DisparityComesBackAsItWas)
{
  StereoGeometry geometry;
  geometry.fx = 400.0;
  geometry.baseline_m = 0.2;
  geometry.cx_difference = 2.0;  // StereoObstacles has subtracted it
  const cv::Mat disparity = (cv::Mat_<float>(1, 3) << 18.0F, -1.0F, 34.5F);
  const auto message = toDisparityImage(disparity, geometry, 0.8, makeHeader());
  EXPECT_EQ(400.0F, message->f);
  EXPECT_EQ(0.2F, message->T);
  EXPECT_FLOAT_EQ(100.0F, message->max_disparity);
  const cv::Mat again = fromMsg(*message);
  EXPECT_EQ(18.0F, again.at<float>(0, 0));
  EXPECT_EQ(-1.0F, again.at<float>(0, 1));
  EXPECT_EQ(34.5F, again.at<float>(0, 2));
}

TEST(RosConversions, DisparitiesBelowTheSmallestAreUnknown)
{
  StereoGeometry geometry;
  geometry.fx = 400.0;
  geometry.baseline_m = 0.2;
  const cv::Mat disparity = (cv::Mat_<float>(1, 3) << 15.0F, 16.0F, std::nanf(""));
  const auto message = toDisparityImage(disparity, geometry, 0.8, makeHeader());
  reinterpret_cast<float*>(message->image.data.data())[2] = std::nanf("");
  message->min_disparity = 16.0F;
  const cv::Mat again = fromMsg(*message);
  EXPECT_EQ(-1.0F, again.at<float>(0, 0));
  EXPECT_EQ(16.0F, again.at<float>(0, 1));
  EXPECT_EQ(-1.0F, again.at<float>(0, 2));
}

TEST(RosConversions, DisparityThatCannotBeIsNamed)
{
  StereoGeometry geometry;
  geometry.fx = 400.0;
  geometry.baseline_m = 0.2;
  const auto message = toDisparityImage(cv::Mat::ones(2, 3, CV_32FC1), geometry, 0.8, makeHeader());
  stereo_msgs::DisparityImage wrong = *message;
  wrong.image.encoding = "16SC1";
  EXPECT_TRUE(contains(messageOf<std::invalid_argument>([&] { fromMsg(wrong); }), "encoding \"16SC1\""));
  wrong = *message;
  wrong.image.data.resize(20);
  EXPECT_TRUE(contains(messageOf<std::invalid_argument>([&] { fromMsg(wrong); }), "20 bytes"));
  wrong = *message;
  wrong.T = 0.0F;
  EXPECT_TRUE(contains(messageOf<std::invalid_argument>([&] { fromMsg(wrong); }), "T = 0"));
}

TEST(MessagePicture, LiesInTheMessageAndKeepsIt)
{
  for (const char* encoding : {"mono8", "8UC1", "bgr8", "8UC3", "rgb8"})
  {
    const bool grey = std::string(encoding) == "mono8" || std::string(encoding) == "8UC1";
    auto image = makeImage(encoding, 5, 4, grey ? 8 : 24);
    const uint8_t* const data = image->data.data();
    const boost::weak_ptr<sensor_msgs::Image> watch = image;
    {
      const MessagePicture picture(image);
      image.reset();
      EXPECT_EQ(data, picture.view().data) << encoding;
      EXPECT_EQ(5, picture.view().width);
      EXPECT_EQ(4, picture.view().height);
      EXPECT_EQ(grey ? 8u : 24u, picture.view().stride);
      EXPECT_EQ(grey                              ? PictureView::Format::MONO8
                : std::string(encoding) == "rgb8" ? PictureView::Format::RGB8
                                                  : PictureView::Format::BGR8,
                picture.view().format);
      EXPECT_FALSE(watch.expired());
    }
    EXPECT_TRUE(watch.expired());
  }
}

TEST(MessagePicture, LiesInAZeroCopyMessageAndKeepsIt)
{
  auto image = makeImage("bgr8", 4, 4, 12);
  const uint8_t* const data = image->data.data();
  const boost::weak_ptr<const sensor_msgs::Image> watch = image;
  {
    const MessagePicture picture(pi_os_transport::zero_copy::toHandle(image));
    image.reset();
    EXPECT_EQ(data, picture.view().data);
    EXPECT_EQ(4u, picture.message().width);
    EXPECT_FALSE(watch.expired());
  }
  EXPECT_TRUE(watch.expired());
}

TEST(MessagePicture, ConvertsWhatTheDetectorDoesNotKnow)
{
  const auto rgba = makeImage("rgba8", 1, 1, 4);
  rgba->data = {10, 20, 30, 255};
  const MessagePicture colour(rgba);
  ASSERT_EQ(PictureView::Format::BGR8, colour.view().format);
  EXPECT_EQ(30, colour.view().data[0]);
  EXPECT_EQ(10, colour.view().data[2]);

  const auto deep = makeImage("mono16", 2, 1, 4);
  deep->data = {0x00, 0x80, 0xff, 0xff};
  const MessagePicture grey(deep);
  ASSERT_EQ(PictureView::Format::MONO8, grey.view().format);
  EXPECT_NEAR(128, grey.view().data[0], 1);
  EXPECT_EQ(255, grey.view().data[1]);

  const auto bayer = makeImage("bayer_rggb8", 8, 8, 8);
  std::fill(bayer->data.begin(), bayer->data.end(), 90);
  const MessagePicture mosaic(bayer);
  ASSERT_EQ(PictureView::Format::BGR8, mosaic.view().format);
  EXPECT_EQ(90, mosaic.view().data[4 * mosaic.view().stride + 12]);

  const auto yuv = makeImage("yuv422", 4, 2, 8);
  std::fill(yuv->data.begin(), yuv->data.end(), 128);
  const MessagePicture video(yuv);
  ASSERT_EQ(PictureView::Format::BGR8, video.view().format);
  EXPECT_NEAR(130, video.view().data[0], 3);
}

TEST(MessagePicture, DeepGreyIsScaledByTheBitsThatTheCameraUses)
{
  const auto grey = [](uint16_t darker, uint16_t brighter, UsedBits* used_bits)
  {
    const auto deep = makeImage("mono16", 2, 1, 4);
    deep->data = {static_cast<uint8_t>(darker & 0xff), static_cast<uint8_t>(darker >> 8),
                  static_cast<uint8_t>(brighter & 0xff), static_cast<uint8_t>(brighter >> 8)};
    const cv::Mat levels = toGrey(*deep, used_bits);
    const MessagePicture picture(deep, used_bits);
    EXPECT_EQ(levels.at<uint8_t>(0, 0), picture.view().data[0]);
    EXPECT_EQ(levels.at<uint8_t>(0, 1), picture.view().data[1]);
    return std::pair<int, int>(levels.at<uint8_t>(0, 0), levels.at<uint8_t>(0, 1));
  };
  EXPECT_EQ((std::pair<int, int>(128, 255)), grey(512, 1023, nullptr));     // 10 bits
  EXPECT_EQ((std::pair<int, int>(128, 255)), grey(2048, 4095, nullptr));    // 12
  EXPECT_EQ((std::pair<int, int>(128, 255)), grey(8192, 16383, nullptr));   // 14
  EXPECT_EQ((std::pair<int, int>(128, 255)), grey(32768, 65535, nullptr));  // 16
  UsedBits used_bits;
  EXPECT_EQ((std::pair<int, int>(128, 255)), grey(2048, 4095, &used_bits));
  EXPECT_EQ((std::pair<int, int>(32, 64)), grey(512, 1023, &used_bits));  // a dark picture of the same camera
}

TEST(MessagePicture, PicturesThatCannotBeAreNamed)
{
  const auto text = [](const boost::shared_ptr<sensor_msgs::Image>& image)
  { return messageOf<std::invalid_argument>([&] { MessagePicture picture(image); }); };
  EXPECT_TRUE(contains(text(makeImage("jpeg", 4, 4, 4)), "encoding \"jpeg\""));
  EXPECT_TRUE(contains(text(makeImage("", 4, 4, 4)), "encoding \"\""));
  EXPECT_TRUE(contains(text(makeImage("32FC1", 4, 4, 16)), "encoding \"32FC1\""));
  EXPECT_TRUE(contains(text(makeImage("bgr8", 0, 0, 0)), "size 0x0"));
  EXPECT_TRUE(contains(text(makeImage("bgr8", 4, 4, 11)), "step 11, must be at least 12"));
  EXPECT_TRUE(contains(text(makeImage("yuv422", 4, 4, 7)), "step 7, must be at least 8"));
  const auto cut = makeImage("rgb8", 4, 4, 12);
  cut->data.resize(47);
  EXPECT_TRUE(contains(text(cut), "47 bytes"));
  const auto huge = makeImage("mono8", 4, 4, 4);
  huge->width = huge->step = std::numeric_limits<uint32_t>::max();
  EXPECT_FALSE(text(huge).empty());
}

TEST(MessagePicture, GreyLevelsShareGreyMessagesAndAreMadeFromColour)
{
  const auto grey = makeImage("mono8", 5, 4, 8);
  EXPECT_EQ(grey->data.data(), toGrey(*grey).data);
  for (const char* encoding : {"bgr8", "8UC3"})
  {
    const auto colour = makeImage(encoding, 2, 1, 6);
    colour->data = {10, 20, 200, 0, 0, 0};
    const cv::Mat converted = toGrey(*colour);
    ASSERT_EQ(CV_8UC1, converted.type());
    EXPECT_NEAR(0.114 * 10 + 0.587 * 20 + 0.299 * 200, converted.at<uint8_t>(0, 0), 1.0) << encoding;
  }
  EXPECT_TRUE(
      contains(messageOf<std::invalid_argument>([&] { toGrey(*makeImage("32FC1", 4, 4, 16)); }), "encoding \"32FC1\""));
}

TEST(ObstacleMarkers, ShowBoxTextAndArrow)
{
  ObstacleMarkers markers(0.5);
  const auto array = markers.update(*toMsg({makeObstacle(3)}, LABELS, makeHeader()));
  ASSERT_EQ(3u, array->markers.size());
  const Marker& box = array->markers[0];
  EXPECT_EQ(Marker::CUBE, box.type);
  EXPECT_EQ(3, box.id);
  EXPECT_EQ("camera", box.header.frame_id);
  EXPECT_EQ(5.0, box.pose.position.x);
  EXPECT_EQ(1.2, box.scale.z);
  EXPECT_EQ(ros::Duration(0.5), box.lifetime);
  EXPECT_EQ("#3 person 4.2 m 3.1 s", array->markers[1].text);
  const Marker& arrow = array->markers[2];
  ASSERT_EQ(2u, arrow.points.size());
  EXPECT_EQ(6.5, arrow.points[1].x);
  EXPECT_EQ(-0.5, arrow.points[1].y);
}

TEST(ObstacleMarkers, ShowTheOutlineAsAPrism)
{
  Obstacle obstacle = makeObstacle(3);
  obstacle.outline = {{4.0, 0.0}, {6.0, -1.0}, {6.0, 1.0}};
  ObstacleMarkers markers(0.5);
  const Marker body = markers.update(*toMsg({obstacle}, LABELS, makeHeader()))->markers[0];
  EXPECT_EQ(Marker::TRIANGLE_LIST, body.type);
  ASSERT_EQ(3u * (3 * 2 + 1), body.points.size()) << "two triangles for each side, one for the top";
  double low = 1e9;
  double high = -1e9;
  for (const geometry_msgs::Point& point : body.points)
  {
    EXPECT_TRUE(pi_detect::contains(obstacle.outline, Eigen::Vector2d(point.x, point.y), 1e-6));
    low = std::min(low, point.z);
    high = std::max(high, point.z);
  }
  EXPECT_NEAR(obstacle.position.z() - 0.5 * obstacle.size.z(), low, 1e-6);
  EXPECT_NEAR(obstacle.position.z() + 0.5 * obstacle.size.z(), high, 1e-6);
  EXPECT_EQ(0.0, body.pose.position.x);
  EXPECT_EQ(1.0, body.scale.x);
}

TEST(ObstacleMarkers, WithoutClassAreGreyAndWithoutCollisionHaveNoTime)
{
  Obstacle obstacle = makeObstacle(3);
  obstacle.class_id = -1;
  obstacle.moving = false;
  obstacle.time_to_collision_s = std::numeric_limits<double>::infinity();
  ObstacleMarkers markers(0.5);
  const auto array = markers.update(*toMsg({obstacle}, LABELS, makeHeader()));
  ASSERT_EQ(2u, array->markers.size());
  EXPECT_EQ(array->markers[0].color.r, array->markers[0].color.b);
  EXPECT_EQ("#3 4.2 m", array->markers[1].text);
}

TEST(ObstacleMarkers, OfVanishedObstaclesAreDeleted)
{
  ObstacleMarkers markers(0.5);
  markers.update(*toMsg({makeObstacle(3), makeObstacle(4)}, LABELS, makeHeader()));
  const auto array = markers.update(*toMsg({makeObstacle(4)}, LABELS, makeHeader()));
  int deleted = 0;
  for (const Marker& marker : array->markers)
  {
    EXPECT_EQ(marker.action == Marker::DELETE ? 3 : 4, marker.id);
    deleted += marker.action == Marker::DELETE ? 1 : 0;
  }
  EXPECT_EQ(3, deleted);
  EXPECT_EQ(3u, markers.update(*toMsg(std::vector<Obstacle>(), LABELS, makeHeader()))->markers.size());
  EXPECT_TRUE(markers.update(*toMsg(std::vector<Obstacle>(), LABELS, makeHeader()))->markers.empty());
}

}  // namespace
}  // namespace pi_detect
