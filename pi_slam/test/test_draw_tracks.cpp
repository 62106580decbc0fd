#include <gtest/gtest.h>
#include "front_end/stereo_tracker.h"

#include <stdexcept>

using namespace pi_slam;

namespace
{

FeatureObservation makeFeature(int64_t id, uint32_t age, float x, bool both)
{
  FeatureObservation feature;
  feature.id = id;
  feature.age = age;
  feature.seen[LEFT] = true;
  feature.seen[RIGHT] = both;
  feature.pixel[LEFT] = Eigen::Vector2f(x, 20.0F);
  feature.pixel[RIGHT] = Eigen::Vector2f(x - 5.0F, 20.0F);
  return feature;
}

cv::Mat grey()
{
  return cv::Mat(40, 60, CV_8UC1, cv::Scalar(100));
}

const cv::Vec3b BACKGROUND(100, 100, 100);

}  // namespace

TEST(DrawTracks, ColoursByAgeAndHollowsSingleOnes)
{
  FrameFeatures features;
  features.features = {makeFeature(1, 1000, 15.0F, true), makeFeature(2, 0, 40.0F, false)};
  const cv::Mat drawn = drawTracks(grey(), grey(), features, {});
  ASSERT_EQ(drawn.size(), cv::Size(120, 40));
  ASSERT_EQ(drawn.type(), CV_8UC3);
  EXPECT_EQ(drawn.at<cv::Vec3b>(20, 15), cv::Vec3b(255, 0, 0));       // old: blue
  EXPECT_EQ(drawn.at<cv::Vec3b>(20, 60 + 10), cv::Vec3b(255, 0, 0));  // in the right picture, too
  EXPECT_EQ(drawn.at<cv::Vec3b>(20, 40), BACKGROUND);                 // hollow
  const cv::Vec3b rim = drawn.at<cv::Vec3b>(20, 43);
  EXPECT_GT(rim[2], rim[0]);  // new: red
  EXPECT_EQ(drawn.at<cv::Vec3b>(20, 60 + 35), BACKGROUND);
}

TEST(DrawTracks, DrawsThePathOverTheLastFrames)
{
  FrameFeatures now;
  now.features = {makeFeature(3, 2, 45.0F, false)};
  FrameFeatures before;
  before.features = {makeFeature(2, 9, 5.0F, false), makeFeature(3, 1, 25.0F, false)};
  EXPECT_EQ(drawTracks(grey(), grey(), now, {}).at<cv::Vec3b>(20, 33), BACKGROUND);
  EXPECT_NE(drawTracks(grey(), grey(), now, {before}).at<cv::Vec3b>(20, 33), BACKGROUND);
  EXPECT_EQ(drawTracks(grey(), grey(), now, {before}).at<cv::Vec3b>(20, 15), BACKGROUND);
}

TEST(DrawTracks, TakesFeaturesOutsideAndAMissingPicture)
{
  FrameFeatures features;
  features.features = {makeFeature(1, 3, -1e6F, true), makeFeature(2, 3, 500.0F, true)};
  const cv::Mat drawn = drawTracks(grey(), cv::Mat(), features, {});
  EXPECT_EQ(drawn.at<cv::Vec3b>(5, 100), cv::Vec3b(0, 0, 0));
}

TEST(DrawTracks, RefusesPicturesThatDoNotFit)
{
  EXPECT_THROW(drawTracks(cv::Mat(), cv::Mat(), {}, {}), std::invalid_argument);
  EXPECT_THROW(drawTracks(grey(), cv::Mat(10, 10, CV_8UC1), {}, {}), std::invalid_argument);
  EXPECT_THROW(drawTracks(cv::Mat(4, 4, CV_32FC1), cv::Mat(4, 4, CV_32FC1), {}, {}), std::invalid_argument);
}
